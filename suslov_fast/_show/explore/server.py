"""Local HTTP server that accepts only requests of its own page."""

from __future__ import annotations

import json
import os
import socket
import sys
import threading
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from socketserver import TCPServer
from typing import Any

from ... import __version__
from .parameters import PRESETS, STEPS, Parameters, read, split
from .scene import scene

_ADDRESS = "127.0.0.1"
# Timeout in seconds; browsers open connections that they may never use.
_PATIENCE = 10.0
# Time in seconds in which a client sends a request, and that in which it takes the answer.
_TOTAL = 20.0
_ASSETS = {"index.html": "html", "style.css": "css", "explore.js": "javascript"}
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    ),
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
_SETTINGS = {
    "version": __version__,
    "longest": STEPS,
    "presets": [{"name": name, "parameters": each._asdict()} for name, each in PRESETS.items()],
}


class Server(ThreadingHTTPServer):
    """HTTP server of the page on a local port; 0 selects a free one."""

    daemon_threads = True
    block_on_close = False
    # A second server on the same port is an error.
    allow_reuse_port = False
    allow_reuse_address = os.name == "posix"

    def __init__(self, port: int, parents: str = "'none'") -> None:
        super().__init__((_ADDRESS, port), _Handler)
        # The pages that may show this one in a frame.
        policy = f"{_HEADERS['Content-Security-Policy']}; frame-ancestors {parents}"
        self.headers = {**_HEADERS, "Content-Security-Policy": policy}
        self.hosts = {f"{name}:{self.server_port}" for name in (_ADDRESS, "localhost")}
        folder = resources.files(__package__) / "page"
        self.assets = {
            "/" + name: ((folder / name).read_bytes(), f"text/{kind}; charset=utf-8")
            for name, kind in _ASSETS.items()
        }
        self.assets["/"] = self.assets.pop("/index.html")

    def server_bind(self) -> None:
        """Bind without a DNS lookup of the name of the address."""
        TCPServer.server_bind(self)
        self.server_name, self.server_port = _ADDRESS, self.socket.getsockname()[1]

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Report an error, unless the browser has closed the connection."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)

    @property
    def url(self) -> str:
        """The address of the page."""
        return f"http://{_ADDRESS}:{self.server_port}/"


class _Handler(BaseHTTPRequestHandler):
    server: Server
    protocol_version = "HTTP/1.1"
    server_version = f"suslov-fast/{__version__}"
    sys_version = ""
    timeout = _PATIENCE
    # Header and body are sent immediately in one packet.
    wbufsize = -1
    disable_nagle_algorithm = True

    def handle_one_request(self) -> None:
        """Answer a request, unless the client is too slow."""
        self._clock = self._limit()
        try:
            super().handle_one_request()
        finally:
            self._clock.cancel()

    def finish(self) -> None:
        """Close the connection, also one that was cut off with an answer in the buffer."""
        try:
            super().finish()
        except OSError:
            self.rfile.close()

    def _limit(self) -> threading.Timer:
        """Close the connection after a time: each byte may come in time, and all of them never."""

        def end() -> None:
            with suppress(OSError):  # it is closed already
                self.connection.shutdown(socket.SHUT_RDWR)

        clock = threading.Timer(_TOTAL, end)
        clock.daemon = True
        clock.start()
        return clock

    def do_GET(self) -> None:
        """Send a file of the page or numbers for it."""
        self._clock.cancel()  # the first numbers may wait for the compiler
        if not self._from_own_page():
            self._send(403, b"suslov-fast: requests of other pages are refused\n")
            return
        path, _, query = self.path.partition("?")
        if path in self.server.assets:
            self._send(200, *self.server.assets[path])
        elif path in ("/settings", "/scene"):
            status, value = (200, _SETTINGS) if path == "/settings" else answer(query)
            text = json.dumps(value, allow_nan=False, separators=(",", ":"))
            self._send(status, text.encode(), "application/json")
        else:
            self._send(404, b"suslov-fast: no such page\n")

    do_HEAD = do_GET

    def _from_own_page(self) -> bool:
        """Return False for requests from pages of other sites.

        Their name may resolve to this machine (DNS rebinding), but the Host header reveals it.
        """
        if self.headers.get_all("Host", []) not in [[host] for host in self.server.hosts]:
            return False
        origin = self.headers.get("Origin")
        return origin is None or origin in {f"http://{host}" for host in self.server.hosts}

    def _send(self, status: int, body: bytes, kind: str = "text/plain; charset=utf-8") -> None:
        self._clock = self._limit()
        self.send_response(status)
        for name, value in self.server.headers.items():
            self.send_header(name, value)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def log_message(self, format: str, *arguments: Any) -> None:
        """Log nothing: the page shows errors."""


def answer(query: str) -> tuple[int, dict[str, Any]]:
    """Return the HTTP status and the numbers for a query, or a message that the page shows."""
    status = 400
    try:
        texts, status = split(query), 200
        return status, scene(read(texts))
    except ValueError as error:
        # A message begins with the names of the fields that it is about.
        named = str(error).partition(":")[0].split(", ")
        fields = [name for name in named if name in Parameters._fields]
        return status, {"error": str(error), "fields": fields}
