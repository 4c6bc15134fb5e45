"""`suslov-fast pictures`, `suslov-fast animate` and `suslov-fast explore`."""

from __future__ import annotations

import argparse
import sys
import threading
import webbrowser

from .._bodies.paper import PICTURES
from .._runs.files import replacing
from .._show import plots
from .._show.explore.parameters import query_of_link
from .._show.explore.server import Server
from .._show.style import style
from .flags import CommandError
from .problem import body_and_step_of, orientation_of
from .terminal import about, progress_bar, require_new


def draw_pictures(options: argparse.Namespace) -> str:
    """Draw the pictures of the paper, and return their names."""
    paths = [options.output / f"picture{number}.{options.format}" for number in PICTURES]
    for path in paths:
        require_new(path, options.force)
    with about(options.output), progress_bar("drawing") as progress:
        options.output.mkdir(parents=True, exist_ok=True)
        for k, (path, picture) in enumerate(zip(paths, PICTURES.values(), strict=True)):
            progress(k, len(paths))
            with replacing(path) as new:
                axes = plots.plot_phase(*picture, letter="abcd"[k] if options.letters else None)
                axes.figure.savefig(new, format=options.format, dpi=options.dpi)
    return "\n".join(map(str, paths))


def draw_animation(options: argparse.Namespace) -> str:
    """Write an animation, and return its name."""
    body, eps, _ = body_and_step_of(options)
    orientation = orientation_of(options)
    path = options.output
    with style():  # which raises a helpful error without Matplotlib
        from matplotlib import animation
    suffix = path.suffix.lower()
    writer = animation.PillowWriter if suffix == ".gif" else animation.FFMpegWriter
    if not writer.isAvailable():
        raise CommandError(f"{path}: expected ffmpeg on the PATH, got none; use .gif")
    require_new(path, options.force)
    with about(path), replacing(path) as new, progress_bar("drawing") as progress:
        with about("animate"):
            moving = plots.animate_body(body, options.omega0, eps, options.steps, R0=orientation)
        part = new.with_suffix(suffix)  # Matplotlib chooses the format by the suffix
        moving.save(str(part), writer=writer(fps=25), dpi=options.dpi, progress_callback=progress)
        part.rename(new)
    return str(path)


def serve(options: argparse.Namespace) -> None:
    """Serve the page until a signal ends it."""
    with about("argument LINK"):
        query = f"?{query_of_link(options.link)}" if options.link is not None else ""
    try:
        server = Server(options.port)
    except OSError as error:
        expected = f"expected a free port, got {options.port}: {error.strerror or error}"
        raise CommandError(f"argument --port: {expected}") from error
    try:
        with server:
            address = server.url + query
            print(address, flush=True)
            print("suslov-fast: Ctrl-C ends the server", file=sys.stderr, flush=True)
            if not options.no_browser:  # which may block its thread
                threading.Thread(target=webbrowser.open, args=[address], daemon=True).start()
            server.serve_forever(poll_interval=0.1)
    except KeyboardInterrupt:
        return
