"""Local HTTP server of the page, and the page in a notebook."""

from __future__ import annotations

import json
import os
import sys
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler
from pathlib import Path
from socketserver import ThreadingTCPServer
from typing import Any

from numpy.typing import ArrayLike

from ... import __version__
from ..._checks import instance
from ..._docs import filled
from ..._engine.arguments import BodyIn3D
from .parameters import PRESETS, STEPS, Parameters, parse_query, query_of
from .scene import scene

_ADDRESS = "127.0.0.1"
_PAGE = Path(__file__).with_name("page")
_HEADERS = {
    "Cache-Control": "no-store",
    # The browser refuses whatever the page would load from elsewhere.
    "Content-Security-Policy": "default-src 'self'; img-src data:",
}
_REFUSALS = {403: "requests of other pages are refused", 404: "no such page"}
_SETTINGS = {
    "version": __version__,
    "longest": STEPS,
    "presets": [{"name": name, "parameters": each._asdict()} for name, each in PRESETS.items()],
}


class Server(ThreadingTCPServer):
    """HTTP server of the page on a local port; 0 selects a free one."""

    daemon_threads = True
    # On POSIX a second server on the same port is an error nevertheless.
    allow_reuse_address = os.name == "posix"

    def __init__(self, port: int) -> None:
        super().__init__((_ADDRESS, port), partial(_Handler, directory=_PAGE))
        self.port = self.server_address[1]
        self.url = f"http://{_ADDRESS}:{self.port}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Report an error, unless the browser has closed the connection."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)


class _Handler(SimpleHTTPRequestHandler):
    server: Server
    # Seconds; browsers open connections that they may never use.
    timeout = 10.0

    def do_GET(self) -> None:
        """Send a file of the page or numbers for it."""
        path, _, query = self.path.partition("?")
        hosts = [f"{name}:{self.server.port}" for name in (_ADDRESS, "localhost")]
        if self.headers.get("Host") not in hosts:  # a name elsewhere that leads here
            self.send_error(403)
        elif path in ("/settings", "/scene"):
            value = _SETTINGS if path == "/settings" else answer(query)
            text = json.dumps(value, allow_nan=False, separators=(",", ":"))
            self._send(200, text, "application/json")
        else:
            super().do_GET()

    def do_HEAD(self) -> None:
        self.send_error(501)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Answer in one line; but for two codes the request was not a GET."""
        self.close_connection = True
        text = _REFUSALS.get(code, "expected a GET request")
        self._send(code, f"suslov-fast: {text}\n", "text/plain; charset=utf-8")

    def _send(self, status: int, text: str, kind: str) -> None:
        body = text.encode()
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def end_headers(self) -> None:
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        super().end_headers()

    def log_message(self, format: str, *arguments: Any) -> None:
        """Log nothing: the page shows errors."""


def answer(query: str) -> dict[str, Any]:
    """Return the numbers for a query, or a message that the page shows."""
    try:
        return scene(parse_query(query))
    except ValueError as error:
        # A message begins with the names of the fields that it is about.
        named = str(error).partition(":")[0].split(", ")
        fields = [name for name in named if name in Parameters._fields]
        return {"error": str(error), "fields": fields}
    except ArithmeticError:
        expected = "parameters: expected numbers of which a picture can be drawn"
        return {"error": f"{expected}, got some that are too far apart", "fields": []}


class Page:
    """A page that a server in this process serves until :meth:`close`; notebooks display it."""

    def __init__(self, server: Server, query: str) -> None:
        self._server = server
        self.url = f"{server.url}?{query}"

    def __repr__(self) -> str:
        return f"<Page {self.url}>"

    def _repr_html_(self) -> str:
        address = self.url.replace("&", "&amp;")
        return f'<iframe src="{address}" width="100%" height="760" style="border: 0"></iframe>'

    def close(self) -> None:
        """Stop the server."""
        self._server.shutdown()
        self._server.server_close()


@filled
def explore(
    body: BodyIn3D, omega0: ArrayLike = (1.0, 0.5), eps: float = 0.1, steps: int = 300
) -> Page:
    """Show an orbit on the page of `suslov-fast explore`, in a notebook.

    The value of a notebook's cell is displayed as the page. This process serves it, to browsers on
    this machine only; elsewhere :func:`plot_phase` and :func:`animate_body` draw pictures.

    Parameters
    ----------
    body : Suslov3D or SuslovGyrostat
        A single body.
    omega0 : array_like(float, shape=(2,))
        Initial angular velocity (Omega1, Omega2).
    eps : float
        Step size.
    steps : int
        Number of steps, from 1 to 5000.

    Returns
    -------
    Page
        Its attribute `url` is the address of the page, and its method `close` ends the server,
        which otherwise ends with the process.

    %(Raises: invalid)s

    Examples
    --------
    >>> from suslov_fast import Suslov3D, explore
    >>> page = explore(Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3), [-0.9, 1.3], eps=0.2)
    >>> page.url.startswith("http://127.0.0.1:")
    True
    >>> page.close()
    """
    instance("body", body, BodyIn3D)
    query = query_of(body, eps, omega0, steps)
    server = Server(0)
    serve: Any = server.serve_forever
    threading.Thread(target=serve, args=[0.1], daemon=True).start()
    return Page(server, query)
