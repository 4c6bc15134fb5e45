"""A headless browser, driven by the DevTools protocol, and the page of `explore` in it."""

import contextlib
import functools
import itertools
import json
import shutil
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from tornado import ioloop, websocket

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
OPTIONS = (
    "--headless=new --remote-debugging-port=0 --no-sandbox --disable-gpu --no-first-run "
    "--disable-dev-shm-usage --disable-background-networking --disable-sync"
)
# Seconds; the first picture may wait for the compiler on a busy machine.
TIMEOUT = 120.0


def wait(function):
    """Wait until a function returns a true value, and return the value."""
    end = time.monotonic() + TIMEOUT
    while not (found := function()):
        assert time.monotonic() < end, "timed out"
        time.sleep(0.02)
    return found


@contextlib.contextmanager
def serve(server):
    """Serve in a thread."""
    with server:
        thread = threading.Thread(target=server.serve_forever, args=(0.02,))
        thread.start()
        yield server
        server.shutdown()
        thread.join()


class Browser:
    """A browser with one page; skips the test if there is no browser."""

    def __init__(self, folder):
        path = next(filter(None, map(shutil.which, NAMES)), None)
        if path is None:
            pytest.skip("no Chromium or Chrome here")
        options = [*OPTIONS.split(), f"--user-data-dir={folder}", "about:blank"]
        nowhere = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
        self._process = subprocess.Popen([path, *options], **nowhere)
        place = Path(folder, "DevToolsActivePort")  # its lines: port, path
        place = wait(lambda: place.exists() and place.read_text().split("\n", 1)[1:] and place)
        address = "ws://127.0.0.1:" + place.read_text().replace("\n", "", 1)
        self._loop = ioloop.IOLoop(make_current=False)
        connect = functools.partial(websocket.websocket_connect, max_message_size=2**28)
        self._socket = self._loop.run_sync(lambda: connect(address), TIMEOUT)
        self._numbers, self._session, self.events = itertools.count(1), {}, []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = {"sessionId": attached["sessionId"]}
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def close(self):
        """End the browser, whatever has failed before."""
        try:
            self._loop.run_sync(self._end, TIMEOUT)
            self._loop.close(all_fds=True)
        finally:
            self._process.kill()
            self._process.wait()

    async def _end(self):
        self._socket.close()  # inside the loop: it schedules the closing handshake
        while await self._socket.read_message():
            pass

    def call(self, method, **parameters):
        number = next(self._numbers)
        message = {"id": number, "method": method, "params": parameters, **self._session}
        self._loop.run_sync(lambda: self._socket.write_message(json.dumps(message)))
        while message := self._loop.run_sync(self._socket.read_message, TIMEOUT):
            answer = json.loads(message)
            if answer.get("id") == number:
                assert "error" not in answer, (method, answer)
                return answer["result"]
            self.events.append(answer)
        raise AssertionError("the browser has ended")

    def value(self, script):
        options = {"returnByValue": True, "awaitPromise": True}
        answer = self.call("Runtime.evaluate", expression=script, **options)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def wait(self, script):
        return wait(lambda: self.value(script))

    def look(self, width, height):
        """Set the size of the window, without animations."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        still = {"name": "prefers-reduced-motion", "value": "reduce"}
        self.call("Emulation.setEmulatedMedia", features=[still])

    def open(self, url):
        self.call("Page.navigate", url=url)
        self.wait("document.readyState === 'complete' && document.documentElement !== null")


def settle(browser):
    root = "document.documentElement"
    script = f"{root}.querySelector('dt') !== null && {root}.dataset.busy === undefined"
    browser.wait(script)


def show(browser, url, *modules):
    """Open an address anew, and make the names of modules of the page global."""
    browser.open("about:blank")
    browser.open(url)
    settle(browser)
    for name in modules:
        browser.value(f"import('/{name}.js').then((found) => void Object.assign(window, found))")


def put(browser, field, value, event="input"):
    """Write a number into a field, move its slider, or choose."""
    place, event = f"document.getElementById({field!r})", f"new Event({event!r}, {{bubbles: true}})"
    browser.value(f"{place}.value = {str(value)!r}; {place}.dispatchEvent({event})")
    settle(browser)


def pixels(browser):
    return browser.value("document.getElementById('plane').toDataURL()")


def text(browser, name):
    return browser.value(f"document.getElementById({name!r}).textContent")


def check_silence(browser, url):
    errors = {"Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded"}
    for event in browser.events:
        assert event.get("method") not in errors, event
        if event.get("method") == "Network.requestWillBeSent":
            address = event["params"]["request"]["url"]
            assert address.startswith((url, "data:", "blob:", "about:")), address


def exported(browser, folder):
    """Save the numbers and the picture, and return the table and the text of the picture."""
    browser.call("Page.setDownloadBehavior", behavior="allow", downloadPath=str(folder))
    for kind in ("csv", "svg", "png"):
        browser.value(f"byId('save-{kind}').click()")
        browser.wait(f"byId('copied').textContent === 'Saved suslov-orbit.{kind}'")
    files = [folder / f"suslov-orbit.{kind}" for kind in ("csv", "svg", "png")]
    wait(lambda: all(path.exists() and path.stat().st_size for path in files))
    assert files[2].read_bytes().startswith(b"\x89PNG")
    return np.loadtxt(files[0], delimiter=",", skiprows=1), files[1].read_text("utf-8")


def rows(found, size=2):
    """States of a scene, in which one that does not exist is None."""
    return np.array([[np.nan] * size if row is None else row for row in found])
