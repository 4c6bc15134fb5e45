"""The crossings of a surface: sections, maxima, exits, returns."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.classes import BodyOrField
from ..checks import integer, one_of
from ..engine.problem import check
from ..engine.random_starts import RandomStarts
from ..engine.status import ON_SINGULAR, OnSingular
from ..engine.stretches import March, Progress, reporter
from ..maps import map_of
from .crossings import Crossings, searched
from .search import Search, Surface, check_surface


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
    """Find where orbits cross a surface s(x) = 0, and keep no other states.

    Poincaré sections, maxima, times of escape and basins are crossings. States are those of
    :func:`iterate`, bit for bit. With a = s(x_n) and
    b = s(x_{n+1}), an orbit crosses between states n and n + 1 upwards if a < 0 <= b, and downwards
    if b < 0 <= a. So 0 counts as positive: an orbit that starts on the surface does not cross it
    upwards there, and crosses it downwards at once if b < 0.

    Parameters
    ----------
    body, omega0, eps, method, threads
        As in :func:`iterate`.
    steps : int
        Number of steps after the transient, 0 or more: transient <= n < transient + steps.
    surface : callable
        The function s, which takes states (..., D) and returns real numbers (...), each from its
        own state alone, with NumPy or compiled by Numba. A section:
        ``lambda x: x[..., 2] - 27``; a maximum of a component:
        ``lambda x: -vector_field(field, x)[..., 2]``; an exit: ``lambda x: (x**2).sum(-1) - 4``.
        It is called in the calling thread, once with the initial states before any step, then with
        read-only pieces (rows, ..., D) of the run, in which the batch keeps its shape; the next
        piece overwrites them, so copy what you keep. There is no crossing next to a value that is
        NaN or infinite, or to a state that is NaN.
    direction : {1, -1, 0}
        Crossings upwards, downwards, or both, in the order of n, also for a negative step size.
        Unlike events of SciPy's `solve_ivp`, the default is upwards.
    transient : int
        Number of steps that are taken first, in which crossings are ignored.
    most : int, optional
        The number of crossings, 1 or more, at which a trajectory ends: ``most=1`` for first
        returns, times of escape and basins. The run ends when all trajectories have ended or
        failed.
    on_singular : {"warn", "raise", "ignore"}
        What to do if trajectories fail: one :class:`SingularStepWarning` for all, a
        :class:`SingularStepError` that holds the result as `crossings`, or nothing. Of
        poles that are passed one :class:`PoleWarning` tells, unless this is "ignore".
    progress : bool or callable, optional
        True shows a bar (needs tqdm); a callable is called as ``progress(done, transient +
        steps)``. If it returns False, the run ends at the state `done`, with the crossings so far;
        :meth:`Crossings.extend` continues it.

    Returns
    -------
    Crossings

    Notes
    -----
    The points :attr:`Crossings.states` lie on the straight line between two states of the map. If
    eps is so small that the map approximates the flow, a point differs from the crossing of the
    flow by O(eps**2), as a state of the map at a fixed time does. For larger eps points between two
    states have no meaning: use `before` or `after`. Where the status is PASSED_POLE, crossings with
    n + 1 >= failed_at lie beyond a pole; most often the motion ended before.

    Memory: the crossings, and one piece of about 4 MB, or a few states of each trajectory.

    Examples
    --------
    The section of the Lorenz system at x3 = 27, and successive maxima of x3:

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
    if type(problem.eps) is not float:  # a copy, for the result
        problem = problem._replace(eps=np.array(problem.eps))
    search = Search(March(problem, method), surface, direction, most)
    return searched(search, steps, transient, method, on_singular, reports)
