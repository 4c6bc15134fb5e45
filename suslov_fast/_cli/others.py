"""`suslov-fast info` and `suslov-fast explore`."""

from __future__ import annotations

import argparse
import sys
import threading

from .options import CommandError, UsageError
from .work import about


def info(options: argparse.Namespace) -> str:
    """Return what a saved run is and what came of it."""
    from .._runs.trajectories import Trajectories
    from .summary import as_json, as_text, facts_of, facts_of_store

    path = options.file
    with about(path):
        in_store = (path / "progress" / "zarr.json").exists()
        facts = facts_of_store(path) if in_store else facts_of(Trajectories.load(path))
    return as_json(facts) if options.json else as_text(facts)


def explore(options: argparse.Namespace) -> None:
    """Serve the page until a signal ends it."""
    from .._show.explore.parameters import query_of_link
    from .._show.explore.server import Server

    with about("argument LINK", UsageError):
        query = f"?{query_of_link(options.link)}" if options.link is not None else ""
    try:
        server = Server(options.port)
    except OSError as error:
        raise CommandError(
            f"argument --port: expected a port that is free, got {options.port}: {error.strerror}"
        ) from error
    try:
        with server:
            print(server.url + query, flush=True)
            if sys.stderr is not None and sys.stderr.isatty():
                print("suslov-fast: Ctrl-C ends it", file=sys.stderr, flush=True)
            if not options.no_browser:
                threading.Thread(target=_show, args=(server.url + query,), daemon=True).start()
            server.serve_forever(poll_interval=0.1)
    except KeyboardInterrupt:
        return


def _show(url: str) -> None:
    """Open a browser, which may stay in the foreground of its thread."""
    import webbrowser

    webbrowser.open(url)
