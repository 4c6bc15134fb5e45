"""`suslov-fast pictures` and `suslov-fast animate`."""

from __future__ import annotations

import argparse
from typing import Any

from .._bodies.paper import PICTURES
from .._runs.replacing import replacing
from .._show import plots
from .._show.style import style
from .flags import CommandError
from .problem import orientation_of, problem_of
from .terminal import about, progress_bar, require_new

# Files are reproducible, and text in them remains text.
_SETTINGS = {"svg.fonttype": "none", "svg.hashsalt": "suslov_fast"}
_DATES: dict[str, Any] = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}


def pictures(options: argparse.Namespace) -> str:
    """Draw the pictures of the paper, and return their names."""
    with style(), about(options.output):
        from matplotlib import rcParams

        rcParams.update(_SETTINGS)
        options.output.mkdir(parents=True, exist_ok=True)
        paths = {n: options.output / f"picture{n}.{options.format}" for n in PICTURES}
        for path in paths.values():
            require_new(path, options.force)
        saving = {"format": options.format, "dpi": options.dpi, "metadata": _DATES[options.format]}
        with progress_bar("drawing") as progress:
            for k, (number, picture) in enumerate(PICTURES.items()):
                progress(k, len(PICTURES))
                with replacing(paths[number]) as new:
                    letter = "abcd"[k] if options.letters else None
                    plots.plot_phase(*picture, letter=letter).figure.savefig(new, **saving)
    return "\n".join(map(str, paths.values()))


def animate(options: argparse.Namespace) -> str:
    """Write an animation, and return its name."""
    body, eps, _ = problem_of(options)
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
