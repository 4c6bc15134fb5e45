"""`suslov-fast pictures` and `suslov-fast animate`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from typing import Any

from .._bodies.paper import PICTURES
from .._bodies.three import Suslov3D
from .._runs.replacing import replacing
from .._show import plots
from .options import CommandError, usage_error
from .problem import orientation_of, problem_of, start_of
from .work import Work, checking, require_new, writing

# Text stays text in vector formats, and the same picture is the same file.
_STYLE = {"pdf.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": "suslov_fast"}
_DATES: dict[str, Any] = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
# Step size of animated pictures: those of the paper are too long for the eye.
_EPS = 0.05


def _phase(number: int, letters: bool) -> Any:
    return plots.plot_phase(*PICTURES[number], letter="abcd"[number - 1] if letters else None)


def _panels(plot: Callable[..., Any], names: str, letters: bool) -> Any:
    return plot(letters=names if letters else None)[0]


# Each takes True to write the letters of panels, and returns axes.
DRAWINGS: dict[str, Callable[[bool], Any]] = {
    **{f"picture{number}": partial(_phase, number) for number in PICTURES},
    "regimes": partial(_panels, plots.plot_regimes, "abc"),
    "convergence": lambda letters: plots.plot_convergence(),
    "four_dimensions": partial(_panels, plots.plot_four_dimensions, "ab"),
    "scattering": partial(_panels, plots.plot_scattering, "ab"),
}


def pictures(options: argparse.Namespace) -> None:
    """Draw all pictures."""
    _require_matplotlib("pictures")
    from matplotlib import rc_context

    try:
        options.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CommandError(
            f"{options.folder}: expected a folder or a name for one, got: {error.strerror}"
        ) from error
    paths = {name: options.folder / f"{name}.{options.format}" for name in DRAWINGS}
    for path in paths.values():
        require_new(path, options.force)
    with Work() as work:
        report = work.phase("drawing")
        for k, (name, draw) in enumerate(DRAWINGS.items()):
            report(k, len(DRAWINGS))
            with rc_context(_STYLE), writing(paths[name]), replacing(paths[name]) as new:
                draw(options.letters).figure.savefig(
                    new, format=options.format, dpi=options.dpi, metadata=_DATES[options.format]
                )
    print(*paths.values(), sep="\n")


def animate(options: argparse.Namespace) -> str:
    """Write an animation, and return its name."""
    body, eps, _ = problem_of(options, _EPS)
    if not isinstance(body, Suslov3D):
        raise usage_error(
            f"animate: expected a three-dimensional body, got one for n = {body.dimension + 1}"
        )
    start = None if options.omega0 is None else start_of(options.omega0, body)
    orientation = orientation_of(options, 3)
    path = options.output
    writers = {".gif": "PillowWriter", ".mp4": "FFMpegWriter"}
    suffix = path.suffix.lower()
    if suffix not in writers:
        raise usage_error(f"{path}: expected a name that ends in .gif or .mp4, got {suffix!r}")
    _require_matplotlib("animate")
    from matplotlib import animation

    writer = getattr(animation, writers[suffix])
    if not writer.isAvailable():
        raise CommandError(f"{path}: expected ffmpeg to write it with, got none; use .gif")
    require_new(path, options.force)
    with Work(path) as work, writing(path), replacing(path) as new:
        report = work.phase("drawing")
        with checking("animate"):
            moving = plots.animate_body(body, start, eps, options.steps, R0=orientation)
        moving.save(
            str(new.with_suffix(suffix)),
            writer=writer(fps=25),
            dpi=options.dpi,
            progress_callback=report,
        )
        new.with_suffix(suffix).rename(new)
    return str(path)


def _require_matplotlib(command: str) -> None:
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise CommandError(
            f"{command}: expected matplotlib, got none; pip install 'suslov_fast[plots]'"
        ) from error
