// Requests for numbers: by HTTP, or by messages to the kernel of a notebook through the widget.
//
// A transport has begin() -> the first query; scene(query) -> numbers, or { error, fields };
// remember(query), which stores the view; address, the part of a link before the query; and
// waiting(seconds) -> { words, lost }, the text shown during a request.

const GONE = "suslov-fast does not answer: start it again and reload this page.";

const compiling = (seconds) =>
  ({ words: `Compiling the kernels, once per installation. ${seconds} s`, lost: false });

function overHttp() {
  return {
    address: `${location.origin}/`,
    begin: async () => location.search,
    scene: async (query) => {
      try {
        return await (await fetch(`/scene?${query}`)).json();
      } catch {
        throw new Error(GONE);
      }
    },
    remember: (query) => history.replaceState(null, "", `?${query}`),
    waiting: compiling,
  };
}

const NEVER =
  "No kernel answers, so this page cannot move. If the kernel is busy with another cell, it " +
  "answers when that ends; in a saved notebook, or after a restart, run this cell again.";
const NO_MORE =
  "The kernel does not answer any more. If it is busy with another cell, it answers when that " +
  "ends; if it was stopped or restarted, run this cell again.";

// A message to the widget has an id and a request. The answers have the same id: first `heard`, when
// the kernel has read the request, then the value. The widget itself answers the first request.
function overMessages(around = window.parent) {
  const pending = new Map();
  const page = Math.random(); // in ids, because all views of a widget get all answers
  let asked = 0, patience = 0, heard = false, ever = false;
  addEventListener("message", ({ source, data }) => {
    if (source !== around || !pending.has(data?.id)) return;
    if (data.heard) {
      heard = ever = true;
      return;
    }
    pending.get(data.id)(data.value);
    pending.delete(data.id);
  });
  const ask = (request) => new Promise((resolve) => {
    const id = `${page} ${++asked}`;
    heard = false;
    pending.set(id, resolve);
    around.postMessage({ id, ...request }, "*");
  });
  return {
    address: "http://127.0.0.1:8000/", // `suslov-fast explore --port 8000` serves it
    begin: async () => {
      const first = await ask({ begin: true });
      patience = first.patience;
      return first.query;
    },
    scene: (query) => ask({ query }),
    remember: (query) => around.postMessage({ remember: query }, "*"),
    waiting: (seconds) => {
      if (heard) return compiling(seconds);
      if (seconds >= patience) return { words: ever ? NO_MORE : NEVER, lost: true };
      return { words: `Waiting for the kernel. ${seconds} s`, lost: false };
    },
  };
}

// In a notebook the page is a document without an address.
export const fromHere = () => (location.protocol === "about:" ? overMessages() : overHttp());
