"""The page of `explore` in a notebook: a widget whose messages Python answers."""

import http.server
import json

import pytest
from browser import check_silence, pixels, put, serve, settle, text

import suslov_fast as sf

# A page that mounts the widget as a notebook does, with the Python handler behind its model.
NOTEBOOK = """<!doctype html><link rel="icon" href="data:,"><script type="module">
const state = await (await fetch("/state")).json(), listeners = new Set();
const { default: widget } = await import(`data:text/javascript,${encodeURIComponent(state._esm)}`);
window.model = {
  get: (name) => state[name],
  set: (name, value) => { state[name] = value; },
  save_changes() {},
  on: (event, listener) => listeners.add(listener),
  off: (event, listener) => listeners.delete(listener),
  async send(message) {
    const replies = await fetch("/kernel", { method: "POST", body: JSON.stringify(message) });
    for (const reply of await replies.json()) for (const each of listeners) each(reply);
  },
};
window.stop = widget.render({ model, el: document.body });
</script>"""


class Notebook(http.server.BaseHTTPRequestHandler):
    """Sends the widget and its state, and gives messages to a widget in Python."""

    def do_GET(self):
        state = {**self.server.widget.get_state(), "_patience": self.server.patience}
        self.answer(json.dumps(state) if self.path == "/state" else NOTEBOOK)

    def do_POST(self):
        message = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self.server.sent.clear()
        if self.server.alive:
            self.server.widget._handle_custom_msg(message, [])
        self.answer(json.dumps(self.server.sent))

    def answer(self, text):
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(text.encode())

    def log_message(self, *arguments):
        pass


@pytest.fixture
def notebook(browser, monkeypatch):
    """A notebook that shows a page of a body with a rotor."""
    page = sf.explore(sf.SuslovGyrostat(4, 2, -0.5, -0.3, 0.7), [-0.9, 1.3], eps=0.2, steps=50)
    bundle, _ = page._repr_mimebundle_()
    assert "application/vnd.jupyter.widget-view+json" in bundle
    assert "run this cell" in bundle["text/plain"]
    with serve(http.server.ThreadingHTTPServer(("127.0.0.1", 0), Notebook)) as running:
        running.widget, running.sent, running.alive, running.patience = page._widget, [], True, 10
        monkeypatch.setattr(page._widget, "send", running.sent.append)
        running.url = f"http://127.0.0.1:{running.server_address[1]}/"
        browser.look(1280, 800)
        browser.events.clear()
        yield running
    check_silence(browser, running.url)


def test_notebook(browser, notebook):
    browser.open(notebook.url)
    frame = browser.frame()
    settle(browser, **frame)
    assert "I1=4" in browser.value("model.get('query')")
    assert (text(browser, "status", **frame), text(browser, "message", **frame)) == ("OK", "")
    before = pixels(browser, **frame)
    put(browser, "I1", "2.5", **frame)
    assert pixels(browser, **frame) != before
    browser.wait("model.get('query').includes('I1=2.5')")
    put(browser, "I1", "0", **frame)
    assert text(browser, "message", **frame).startswith("I1 must")
    # The frame can neither read the notebook nor load anything.
    for script in ("parent.document.body", "localStorage.length", "fetch('data:,')"):
        refused = f"(async () => {{ try {{ await {script}; }} catch {{ return true; }} }})()"
        assert browser.value(refused, **frame) is True, script
    browser.events[:] = [each for each in browser.events if "Log" not in each.get("method", "")]
    assert browser.value("stop(); model.send({ id: 'x', query: '' })") is None


@pytest.mark.slow
def test_notebook_without_a_kernel(browser, notebook):
    """Words say so, also where there never was one, and a kernel that answers later is heard."""
    notebook.patience = 0
    browser.open(notebook.url)
    frame = browser.frame()
    settle(browser, **frame)
    notebook.alive = False
    slider = "document.getElementById('I1-slider')"
    browser.value(f"{slider}.stepUp(); {slider}.dispatchEvent(new Event('input'))", **frame)
    words = "document.getElementById('message')?.textContent.includes('run this cell again')"
    browser.wait(words, **frame)
    assert "any more" in text(browser, "message", **frame)
    browser.events.clear()
    browser.open(notebook.url)
    frame = browser.frame()
    browser.wait(words, **frame)
    assert "saved notebook" in text(browser, "message", **frame)
