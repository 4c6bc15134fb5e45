"""The local HTTP server of the page, and `explore`, which shows the page in a notebook."""

from __future__ import annotations

import json
import os
import sys
import threading
from http.server import BaseHTTPRequestHandler
from socketserver import ThreadingTCPServer
from typing import Any
from urllib.parse import unquote, urlencode

from numpy.typing import ArrayLike

from ...bodies.classes import BodyOrField
from ...bodies.fields.general import Field
from ...bodies.rigid import Suslov3D, SuslovGyrostat
from ...checks import states, wrong
from ...engine.starts import RTOL, either_map_or_motion
from ...keywords import public
from ...maps import map_of
from .fields import FieldScene
from .scene import PAGE, Parameters, answer, parse_query

_ADDRESS = "127.0.0.1"
_FILES = {f"/{file.name}": file for file in PAGE.iterdir()}
_TYPES = {".css": "text/css", ".html": "text/html", ".js": "text/javascript"}


class Server(ThreadingTCPServer):
    """HTTP server of the page on a local port; port 0 selects a free one."""

    daemon_threads = True  # so that the end does not wait for slow clients
    request_queue_size = 128
    # Only on POSIX, where a second server on the same port is still an error.
    allow_reuse_address = os.name == "posix"

    def __init__(self, port: int, field: FieldScene | None = None) -> None:
        self._field = field
        self.files = _FILES | {"/": PAGE / ("field.html" if field else "index.html")}
        super().__init__((_ADDRESS, port), Handler)
        self.port = self.server_address[1]
        self.url = f"http://{_ADDRESS}:{self.port}/"

    def answer(self, query: str) -> Any:
        """Return the numbers for a query."""
        return self._field.answer(query) if self._field else answer(query)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Report an error, unless the browser has closed the connection."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)


class Handler(BaseHTTPRequestHandler):
    """Answers to requests: files of the page, and numbers as JSON."""

    server: Server
    # Seconds until an unused connection is closed: browsers open some that they never use.
    timeout = 10.0

    def do_GET(self) -> None:
        """Send the numbers of a scene, or a file of the page."""
        path, _, query = self.path.partition("?")
        # Refused: pages of other sites that ask for numbers, and host names of other sites that
        # resolve to this machine.
        hosts = [f"{name}:{self.server.port}" for name in (_ADDRESS, "localhost")]
        site = self.headers.get("Sec-Fetch-Site", "none")
        is_foreign = path == "/scene" and site not in ("none", "same-origin")
        if is_foreign or self.headers.get("Host") not in hosts:
            self.send_error(403)
        elif path == "/scene":
            text = json.dumps(self.server.answer(query), allow_nan=False, separators=(",", ":"))
            self._send("application/json", text.encode())
        elif file := self.server.files.get(path):
            self._send(_TYPES[os.path.splitext(file.name)[1]], file.read_bytes())
        else:
            self.send_error(400 if "\0" in unquote(path) else 404)

    def _send(self, kind: str, content: bytes) -> None:
        """Send a content of a MIME type."""
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def end_headers(self) -> None:
        """Forbid the browser to keep copies, and to load anything from elsewhere."""
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", "default-src 'self'; img-src data:")
        super().end_headers()

    def log_message(self, format: str, *arguments: Any) -> None:
        """Log nothing: the page shows errors."""


class Page:
    """The page of orbits, which a notebook displays; see `explore`."""

    def __init__(self, query: str, field: FieldScene | None = None) -> None:
        self._query, self._field = query, field
        self._server: Server | None = None

    def serve(self, port: int) -> Server:
        """Return a server of the page."""
        return Server(port, self._field)

    @property
    def url(self) -> str:
        """The address of the page; its first use starts a server in a thread."""
        if self._server is None:
            self._server = self.serve(0)
            threading.Thread(target=self._server.serve_forever, args=[0.1], daemon=True).start()
        return self.address(self._server)

    def address(self, server: Server) -> str:
        """Return the address of the page at a server."""
        return f"{server.url}?{self._query}" if self._query else server.url

    def close(self) -> None:
        """Stop serving the page."""
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
            self._server = None

    def __repr__(self) -> str:
        return f"<Page {self.url}>"

    def _repr_html_(self) -> str:
        address = self.url.replace("&", "&amp;")
        return f'<iframe src="{address}" width="100%" height="860" style="border: 0"></iframe>'


@public
def explore(
    field: BodyOrField | None = None,
    x0: ArrayLike | None = None,
    /,
    eps: float | None = None,
    steps: int | None = None,
    method: str = "auto",
    *,
    time: float | None = None,
    rtol: float = RTOL,
) -> Page:
    """Return an interactive page of orbits: a plane of two components, sliders, statuses.

    A notebook displays it. This process serves the page, to browsers on this machine only.

    For a field, the components of the plane are chosen on the page, and a click in the plane is a
    start. A field made from a function has a slider for each named parameter, and a family one for
    each of its axes, along the values of the parameters there. With `time`, and for a `Field`, the
    page shows the motion, at 2001 times, and has sliders for the last time and `rtol`. For a body
    in three dimensions there are sliders for its moments, and the body in space.

    Parameters
    ----------
    field : QuadraticField, Field, SuslovND, Suslov3D or SuslovGyrostat, optional
        A field or a family of fields, or a single body. Without it, a body in three dimensions.
    x0 : array_like(float, shape=(D,)), optional
        The start, (Omega1, Omega2) of a body in three dimensions; for a field also several, (B, D),
        up to 20. By default (1, 0.5, 0.5, ...).
    eps, steps, method : float, int, str
        As in :func:`iterate`, with 1 to 5000 steps. By default 300 steps of 0.1 for a body in three
        dimensions, else 2000 of 0.01; the method "auto".
    time : float, optional
        The last time of a motion, in place of `eps`, `steps` and `method`; 20 for a `Field`.
    rtol : float
        As in :func:`flow`.

    Returns
    -------
    Page
        Its `url` is an address on this machine, served from its first use until ``page.close()``.

    Raises
    ------
    TypeError, ValueError
        If a batch of bodies in three dimensions is passed, or too many steps or starts, or
        arguments of a map and of a motion.

    Examples
    --------
    >>> import numpy as np
    >>> from suslov_fast import QuadraticField, explore
    >>> def lorenz(v, rho):
    ...     x, y, z = v
    ...     return 10 * (y - x), x * (rho - z) - y, x * y - 8 / 3 * z
    >>> family = QuadraticField.from_function(lorenz, "x y z", rho=np.linspace(10, 30, 81))
    >>> page = explore(family, [1, 1, 20], eps=0.01)
    >>> page  # in a notebook: the page itself  # doctest: +SKIP
    >>> page.url.startswith("http://127.0.0.1:")
    True
    >>> page.close()
    """
    if field is None:
        field = Suslov3D(4, 2, -0.5, -0.3)
    is_plane = isinstance(field, (Suslov3D, SuslovGyrostat))
    if isinstance(field, Field):
        time = 20.0 if time is None else time
    elif time is None:
        map_of(field)  # raises an error for anything else
        defaults = (0.1, 300) if is_plane else (0.01, 2000)
        eps, steps = defaults[0] if eps is None else eps, defaults[1] if steps is None else steps
    if either_map_or_motion("explore", eps, steps, time, method=method, rtol=rtol):
        scene = FieldScene(field, x0, time=time, rtol=rtol)
        return Page(scene.first.query, scene)
    if not is_plane:
        scene = FieldScene(field, x0, eps=eps, steps=steps, method=method)
        return Page(scene.first.query, scene)
    if method != "auto":
        raise wrong("method", '"auto" for a body in three dimensions', repr(method))
    constants = field.constants
    state = states("omega0", (1.0, 0.5) if x0 is None else x0, field.labels)
    if field.shape or state.ndim != 1:
        received = f"a body of shape {field.shape} and states of shape {state.shape}"
        raise wrong("body, omega0", "a single body and a single state", received)
    extent = 1.5 * float(abs(state).max()) or 1.0
    parameters = *map(float, constants), eps, *state.tolist(), steps, extent
    query = urlencode(Parameters(*parameters)._asdict())
    parse_query(query)  # raises an error if a number is wrong
    return Page(query)
