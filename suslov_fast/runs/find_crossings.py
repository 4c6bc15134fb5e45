"""The function `crossings`, which checks its arguments and starts the search."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.classes import BodyOrField
from ..checks import integer, one_of
from ..engine.problem import check, warn_of_times
from ..engine.random_starts import RandomStarts
from ..engine.stretches import March, Progress, reporter
from ..keywords import public
from ..maps import map_of
from .crossings import Crossings, searched
from .failures import ON_SINGULAR, OnSingular
from .search import Search, Surface, check_surface


@public
def crossings(
    body: BodyOrField,
    omega0: ArrayLike | RandomStarts,
    /,
    eps: ArrayLike,
    steps: int,
    surface: Surface,
    *,
    direction: int = 1,
    transient: int = 0,
    most: int | None = None,
    method: str = "auto",
    threads: int | None = None,
    on_singular: OnSingular = "warn",
    progress: Progress = None,
) -> Crossings:
    """Find where orbits cross a surface s(x) = 0: Poincaré sections, maxima, escapes, basins.

    The states are those of :func:`iterate`, bit for bit; only the crossings are kept. With
    a = s(x_n) and b = s(x_{n+1}), an orbit crosses upwards between states n and n + 1 if
    a < 0 <= b, and downwards if b < 0 <= a: 0 counts as positive.

    Parameters
    ----------
    body, omega0, eps
        As in :func:`iterate`.
    steps : int
        Number of steps after the transient, 0 or more.
    surface : callable
        The function s: it takes states (..., D) and returns real values (...), each value from its
        own state alone. It uses NumPy, or is compiled by Numba. A section:
        ``lambda x: x[..., 2] - 27``; an escape: ``lambda x: (x**2).sum(-1) - 4``. It is called with
        read-only pieces (rows, ..., D) of the run, which later pieces overwrite: copy states that
        you keep. For methods above order 2 it is also called, at most 20 times for a piece, with
        states between those of the run, NaN where there is none. A value of s that is NaN or
        infinite makes no crossing.
    direction : {1, -1, 0}
        Upwards, downwards, or both, in the order of n. SciPy's events have the default 0.
    transient : int
        Number of steps taken first, in which crossings are ignored.
    most : int, optional
        The number of crossings, 1 or more, at which a trajectory ends; the run ends when all
        trajectories have ended or failed.
    method, threads
        As in :func:`iterate`.
    on_singular : {"warn", "raise", "ignore"}
        As in :func:`iterate`; the error holds the result as `crossings`.
    progress : bool or callable, optional
        As in :func:`iterate`, called with the steps of the transient included;
        :meth:`Crossings.extend` continues a run that it ended.

    Returns
    -------
    Crossings
        Its points are as accurate as the states. For methods of order 2 they lie on the straight
        lines between consecutive states; for higher orders they are the states, with s = 0, after
        a step of the length fraction * eps from `before`, unless the step has a pole within its
        length (`over_pole`), over which the chord leads. If eps is too large for the map to follow
        the motion, use `before` or `after` instead.

    Raises
    ------
    TypeError, ValueError
        As :func:`iterate`; also if `surface` does not return a real value for each state.

    Examples
    --------
    The section of the Lorenz attractor at x3 = 27, and the successive maxima of x3:

    >>> from suslov_fast import QuadraticField, crossings, vector_field
    >>> def lorenz(x, rho):
    ...     return 10 * (x[1] - x[0]), x[0] * (rho - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]
    >>> field = QuadraticField.from_function(lorenz, 3, rho=28)
    >>> starts = [[1.0, 1.0, 20.0], [-2.0, 1.0, 20.0]]
    >>> section = crossings(field, starts, 1 / 64, 2000, lambda x: x[..., 2] - 27, transient=500)
    >>> bool(abs(section.states[:, 2] - 27).max() < 1e-13)
    True
    >>> peaks = crossings(field, starts, 1 / 64, 2000, lambda x: -vector_field(field, x)[..., 2])
    >>> peaks.of(0).states[:3, 2].round(1)
    array([40.5, 38.7, 44. ])
    """
    map = map_of(body, method)
    problem = check(map, body, omega0, eps, threads, name="omega0")
    steps, transient = integer("steps", steps, 0), integer("transient", transient, 0)
    direction = integer("direction", direction, -1, "1, -1 or 0", 1)
    if most is not None:
        most = integer("most", most, 1, "None or an integer of at least 1")
    one_of("on_singular", on_singular, ON_SINGULAR)
    reports = reporter(progress, transient + steps)
    check_surface(surface)
    warn_of_times(problem)
    if type(problem.eps) is not float:  # copied, because the result keeps it
        problem = problem._replace(eps=np.array(problem.eps))
    search = Search(March(problem, method), surface, direction, most)
    return searched(search, steps, transient, method, on_singular, reports)
