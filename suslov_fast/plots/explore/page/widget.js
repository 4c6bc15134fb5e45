// The widget of a notebook: a frame with the page, whose messages it passes to the kernel and back.
// The frame is sandboxed, so it cannot read the notebook, and its page may load nothing.

function render({ model, el }) {
  const frame = document.createElement("iframe");
  frame.sandbox = "allow-scripts allow-downloads";
  frame.title = "suslov_fast explore";
  frame.style = "width: 100%; height: 860px; border: 0";
  frame.srcdoc = model.get("_html");
  const down = (message) => frame.contentWindow?.postMessage(message, "*");
  const begin = ({ id }) =>
    down({ id, value: { query: model.get("query"), patience: model.get("_patience") } });
  const remember = (query) => {
    model.set("query", query);
    model.save_changes();
  };
  const up = ({ source, data }) => {
    if (source !== frame.contentWindow) return;
    try {
      if (data.begin) begin(data);
      else if ("remember" in data) remember(data.remember);
      else model.send({ id: data.id, query: data.query });
    } catch {
      // Some notebooks raise an error without a kernel; the page reports a missing answer.
    }
  };
  addEventListener("message", up);
  model.on("msg:custom", down);
  el.append(frame);
  return () => {
    removeEventListener("message", up);
    model.off("msg:custom", down);
  };
}

export default { render };
