"""The page of `suslov-fast explore` in a notebook."""

from __future__ import annotations

import threading
from typing import Any

from numpy.typing import ArrayLike

from ..._bodies.body_3d import Suslov3D
from ..._bodies.body_gyrostat import SuslovGyrostat
from ..._checks import instance
from .parameters import query_of
from .server import Server

# Notebooks in a browser, and those of editors.
_NOTEBOOKS = "http://localhost:* http://127.0.0.1:* https://localhost:* vscode-webview: file:"


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


def explore(
    body: Suslov3D | SuslovGyrostat,
    omega0: ArrayLike = (1.0, 0.5),
    eps: float = 0.1,
    steps: int = 300,
) -> Page:
    """Show an orbit on the page of `suslov-fast explore`, in a notebook.

    The value of a notebook's cell is displayed as the page, with fields for all parameters. The
    page is served by this process on 127.0.0.1, to browsers on this machine only; elsewhere
    :func:`plot_phase` and :func:`animate_body` draw pictures.

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

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, explore
    >>> page = explore(Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3), [-0.9, 1.3], eps=0.2)
    >>> page.url.startswith("http://127.0.0.1:")
    True
    >>> page.close()
    """
    instance("body", body, (Suslov3D, SuslovGyrostat))
    query = query_of(body, eps, omega0, steps)
    server = Server(0, _NOTEBOOKS)
    serve: Any = server.serve_forever
    threading.Thread(target=serve, args=[0.1], daemon=True).start()
    return Page(server, query)
