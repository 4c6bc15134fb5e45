"""`suslov-fast explore`: serve the page."""

from __future__ import annotations

import argparse
import sys
import threading
import webbrowser

from .._show.explore.parameters import query_of_link
from .._show.explore.server import Server
from .flags import CommandError
from .terminal import about


def explore(options: argparse.Namespace) -> None:
    """Serve the page until a signal ends it."""
    with about("argument LINK"):
        query = f"?{query_of_link(options.link)}" if options.link is not None else ""
    try:
        server = Server(options.port)
    except (OSError, OverflowError) as error:
        expected = f"expected a free port, got {options.port}: {error}"
        raise CommandError(f"argument --port: {expected}") from error
    try:
        with server:
            address = server.url + query
            print(address, flush=True)
            if sys.stderr is not None and sys.stderr.isatty():
                print("suslov-fast: Ctrl-C ends the server", file=sys.stderr, flush=True)
            if not options.no_browser:  # which may block its thread
                threading.Thread(target=webbrowser.open, args=[address], daemon=True).start()
            server.serve_forever(poll_interval=0.1)
    except KeyboardInterrupt:
        return
