"""`suslov-fast pictures` and `suslov-fast animate`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from .._bodies.paper import PICTURES
from .._bodies.three import Suslov3D
from .._engine.memory import require
from .._runs.replacing import replacing
from .._runs.trajectories import SingularStepError
from .._show import plots
from .._show.style import style
from .options import CommandError, UsageError
from .problem import orientation_of, problem_of, start_of
from .terminal import about, progress_bar, require_new

# Files are reproducible, and text in them remains text.
_SETTINGS = {"svg.fonttype": "none", "svg.hashsalt": "suslov_fast"}
_DATES: dict[str, Any] = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
# Step size of animated pictures: those of the paper are too long for a smooth animation.
_EPS = 0.05
# Size of a step: angular velocity, orientation, and a point of the path.
_BYTES = 8 * (2 + 9 + 3)

# The function of each picture, and the arguments for the letters of its panels.
DRAWINGS: dict[str, tuple[Callable[..., Any], dict[str, str]]] = {
    f"picture{number}": (partial(plots.plot_phase, *picture), {"letter": "abcd"[number - 1]})
    for number, picture in PICTURES.items()
}
DRAWINGS |= {
    "regimes": (plots.plot_regimes, {"letters": "abc"}),
    "convergence": (plots.plot_convergence, {}),
    "four_dimensions": (plots.plot_four_dimensions, {"letters": "ab"}),
    "scattering": (plots.plot_scattering, {"letters": "ab"}),
}


def pictures(options: argparse.Namespace) -> str:
    """Draw all pictures, and return their names."""
    with style(), about(options.output):
        from matplotlib import rcParams

        rcParams.update(_SETTINGS)
        options.output.mkdir(parents=True, exist_ok=True)
        paths = {name: options.output / f"{name}.{options.format}" for name in DRAWINGS}
        for path in paths.values():
            require_new(path, options.force)
        saving = {"format": options.format, "dpi": options.dpi, "metadata": _DATES[options.format]}
        with progress_bar("drawing") as report:
            for k, (name, (draw, letters)) in enumerate(DRAWINGS.items()):
                report(k, len(DRAWINGS))
                with replacing(paths[name]) as new:
                    axes = draw(**letters if options.letters else {})
                    np.ravel(axes)[0].figure.savefig(new, **saving)
    return "\n".join(map(str, paths.values()))


def animate(options: argparse.Namespace) -> str:
    """Write an animation, and return its name."""
    body, eps, _ = problem_of(options, _EPS)
    if not isinstance(body, Suslov3D):
        raise UsageError(f"animate: expected a body of Suslov3D, got a {type(body).__name__}")
    start = None if options.omega0 is None else start_of(options.omega0, 2)
    orientation = orientation_of(options, 3)
    require(_BYTES * options.steps, "lower --steps")
    path = options.output
    with style():  # which raises a helpful error without Matplotlib
        from matplotlib import animation
    suffix = path.suffix.lower()
    writer = animation.PillowWriter if suffix == ".gif" else animation.FFMpegWriter
    if not writer.isAvailable():
        raise CommandError(f"{path}: expected ffmpeg on the PATH, got none; use .gif")
    require_new(path, options.force)
    with about(path), replacing(path) as new, progress_bar("drawing") as report:
        try:
            with about("animate"):
                moving = plots.animate_body(body, start, eps, options.steps, R0=orientation)
        except SingularStepError as error:
            raise CommandError(f"animate: {error}") from error
        part = new.with_suffix(suffix)  # Matplotlib chooses the format by the suffix
        moving.save(str(part), writer=writer(fps=25), dpi=options.dpi, progress_callback=report)
        part.rename(new)
    return str(path)
