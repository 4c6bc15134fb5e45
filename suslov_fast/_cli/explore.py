"""`suslov-fast explore`: move a body, a step size and a start on a page, and see what happens."""

from __future__ import annotations

import argparse
import sys
import threading
from functools import partial
from typing import Any

from .errors import UserError
from .values import integer

_PORTS = 2**16


def add_to(commands: Any) -> None:
    """Add the command to a parser."""
    parser = commands.add_parser(
        "explore",
        help="move a body, a step size and a start on a page in the browser",
        description=(
            "Serve a page to the browser of this machine, on which the body, the step size and "
            "the start are moved, and the orbit, its regime and the body in space are seen at "
            "once. Nothing is sent to or fetched from elsewhere. Ctrl-C ends it."
        ),
    )
    parser.set_defaults(command=explore)
    add = partial(parser.add_argument)
    add(
        "link",
        nargs="?",
        metavar="LINK",
        help="a link copied from the page: begin with what it shows",
    )
    add("--port", type=_port, default=0, metavar="N", help="of 127.0.0.1 (one that is free)")
    add("--no-browser", action="store_true", help="print the address, and open nothing")


def _port(text: str) -> int:
    port = integer(0)(text)
    if port >= _PORTS:
        raise argparse.ArgumentTypeError(f"expected an integer below {_PORTS}, got {text!r}")
    return port


def explore(options: argparse.Namespace) -> None:
    """Carry out the command, until a signal ends it."""
    from .._show.explore.parameters import query_of_link
    from .._show.explore.server import Server

    try:
        query = f"?{query_of_link(options.link)}" if options.link is not None else ""
    except ValueError as error:
        raise UserError(f"argument LINK: {error}") from error
    try:
        server = Server(options.port)
    except OSError as error:
        raise UserError(
            f"argument --port: expected a port that is free, got {options.port}: {error.strerror}"
        ) from error
    try:
        with server:
            print(server.url + query, flush=True)
            if sys.stderr.isatty():
                print("suslov-fast: Ctrl-C ends it", file=sys.stderr, flush=True)
            if not options.no_browser:
                threading.Thread(target=_show, args=(server.url + query,), daemon=True).start()
            server.serve_forever(poll_interval=0.1)
    except KeyboardInterrupt:
        # How one leaves it.
        return


def _show(url: str) -> None:
    """Open a browser, which may stay in the foreground of its thread."""
    import webbrowser

    webbrowser.open(url)
