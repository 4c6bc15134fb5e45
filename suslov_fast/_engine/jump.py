"""Runs by the method "auto", which evaluates the closed form if possible."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .._bodies.reduction import is_solved
from .._checks import FloatArray
from .._kernels import codes, maps_3d
from .._kernels.closed_form import NOT_FOUND
from .closed_form import (
    Ends,
    Orbits,
    Rows,
    fill_rows,
    fill_states,
    none_missing,
    slices,
    with_rotor,
)
from .iterate import iterate, iterate_nd
from .layout import for_kernel
from .progress import reporter
from .reduction import Reduced, of_n_3, reduce
from .run import Results, Run, not_computed, run_some, worst

# Number of steps from which on the closed form is faster if only the last state is saved.
JUMP = 32
# Number of three-dimensional states of a run in n dimensions in memory at a time.
_TOGETHER = 2**19
_NONE = np.empty(0, np.intp)


Driver = Callable[[Run], Results]


def run_3d(run: Run, by_steps: Driver) -> Results:
    """Return the last states and the statuses; fill the saved states."""
    if not _may_jump(run) or _is_short(run):
        return by_steps(run)
    results = _solve(run, by_steps)
    _report_all(run)
    return results


def run_nd(run: Run) -> Results:
    """Compute a run in n dimensions like `run_3d`.

    The choice between closed form and iteration for a trajectory does not depend on the others.
    """
    if _may_jump(run) and _is_short(run):
        # From step 0: the division of a run must not decide where the closed form is used.
        run = replace(run, start=0, resume={}) if run.start else run
        # Near a pole the closed form is more accurate than elimination.
        return iterate_nd(run, _closed_form_or_iteration)
    return _closed_form_or_iteration(run)


def _closed_form_or_iteration(run: Run) -> Results:
    """Compute the trajectories of solved bodies by the closed form, and iterate the others."""
    J, I, _ = run.parameters
    if not (run.size and _may_jump(run)) or not (solved := is_solved(J, I)).any():
        return iterate_nd(run)
    reduced = reduce(run.parameters, run.omega0, run.threads)
    jumping = reduced.fits & solved
    if jumping.all():
        results = _jump_nd(run, reduced)
        _report_all(run)
        return results
    if not jumping.any():
        return iterate_nd(run)
    size = run.size
    ends = np.empty(size, np.int8), np.empty(size, np.int64)
    results = Results(np.empty(run.omega0.shape), *ends, {})
    steps, done = run.steps - run.start, 0
    with reporter(run.progress, steps) as report:
        for driver, chosen in ((_jump_nd, jumping), (iterate_nd, ~jumping)):
            some = np.flatnonzero(chosen)

            def progress(made: int, before: int = done, count: int = some.size) -> None:
                report((before * steps + made * count) // size)

            reports = progress if run.progress else None
            run_some(run, some, driver, results, report=reports)
            done += some.size
    return results


def _may_jump(run: Run) -> bool:
    """Return True if the closed form may be used."""
    return run.method == "auto" and run.orientation is None and run.steps > 0


def _is_short(run: Run) -> bool:
    """Return True if iteration is faster: few steps, of which only the last state is saved.

    Runs that save more states use the closed form for any number of steps, so that their states do
    not depend on the division of a run.
    """
    return run.save_every is None and run.steps < JUMP


def _report_all(run: Run) -> None:
    if run.progress:
        steps = run.steps - run.start
        with reporter(run.progress, steps) as report:
            report(steps)


def canonical_or_printed(run: Run) -> Results:
    """Iterate a body without a rotor."""
    return iterate(run, maps_3d.printed if run.method == "ds2" else maps_3d.canonical)


def _solve(run: Run, by_steps: Driver) -> Results:
    """Evaluate all states, and iterate the orbits that the closed form leaves."""
    results, left = _jump(run)
    if left.size:
        run_some(run, left, by_steps, results, anew=True)
    return results


def _jump(run: Run) -> tuple[Results, NDArray[np.intp]]:
    """Evaluate all states; return the results, and which orbits must be iterated."""
    status, failed_at = not_computed(run.size), np.empty(run.size, np.int64)
    ends: Ends = status, failed_at, float(run.steps)
    orbits = Orbits(with_rotor(run.parameters), run.omega0, False, ends, run.threads)
    missing = none_missing()
    if len(run.saved):
        first = run.rows_before
        rows = Rows(1.0, 0.0, float(run.every), first, first + len(run.saved), -first, 1)
        fill_rows(orbits, rows, run.saved, missing)
    if run.saves_last:
        final = run.saved[-1]
    else:
        last = np.empty((1, run.size, 2))
        fill_states(orbits, 1.0, np.array([ends[2]]), np.zeros(1, np.intp), last, missing)
        final = last[0]
    left = np.flatnonzero(status == NOT_FOUND) if worst(status) == NOT_FOUND else _NONE
    return Results(final, status, failed_at, {}), left


def _jump_nd(run: Run, reduced: Reduced | None = None) -> Results:
    """Evaluate all states from those in three dimensions; all trajectories must be reducible."""
    J, I, eps = run.parameters
    size, m = run.omega0.shape
    if m == 2:
        three = *map(for_kernel, of_n_3(J, I)), eps
        results = _solve(replace(run, parameters=three), canonical_or_printed)
    else:
        reduced = reduced or reduce(run.parameters, run.omega0, run.threads)
        ends = np.empty(size, np.int8), np.empty(size, np.int64)
        results = Results(np.empty((size, m)), *ends, {})
        for lanes, rows in slices(size, max(len(run.saved), 1), _TOGETHER):
            _jump_some(run, reduced, lanes, rows, results)
        if len(run.saved) and run.start == 0:  # a copy of the input
            exists = (results.status >= 0) | (results.failed_at != 0)
            np.copyto(run.saved[0], run.omega0, where=exists[:, np.newaxis])
    # In n dimensions there is no status for t >= 1: most bodies have no t.
    np.minimum(results.status, codes.OK, out=results.status)
    return results


def _jump_some(
    run: Run, reduced: Reduced, lanes: tuple[int, int], rows: tuple[int, int], results: Results
) -> None:
    """Fill rows of the saved states of some trajectories, and their last states."""
    (begin, end), (row, stop) = lanes, rows
    stop = min(stop, len(run.saved))
    # The rows before belong to steps before the part.
    before, last = run.rows_before - 1, stop == len(run.saved)
    states: FloatArray = np.empty((stop - row, end - begin, 2))
    part = replace(
        run,
        batch=(end - begin,),
        omega0=reduced.state[begin:end],
        parameters=tuple(for_kernel(each) for each in reduced.three[begin:end].T),
        start=(row + before) * run.every if row else run.start,
        steps=run.steps if last else (stop + before) * run.every,
        saved=states,
    )
    found = _solve(part, canonical_or_printed)
    final, results.status[begin:end], results.failed_at[begin:end] = found[:3]
    if len(states):
        reduced.expand(states, run.saved[row:stop], begin, run.threads)
    reduced.expand(final[np.newaxis], results.final[np.newaxis], begin, run.threads)
