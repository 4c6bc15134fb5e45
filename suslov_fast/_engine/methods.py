"""The choice of the drivers that compute a run.

A driver computes what it can, and leaves the other trajectories to the next:

"auto" in 3D    closed form (leaves orbits near overflow, and some with t >= 1), steps from step 0
"auto" in nD    closed form of the reduced 3D body (leaves bodies that are not solved, and what the
                closed form in 3D leaves), steps of the reduced body from step 0 (leave bodies that
                are not solved), rank 2, rank 2 or elimination
"canonical"     steps in canonical coordinates, or of the gyrostat
"ds2"           steps as printed
"rank2"         rank 2: steps in O(n) (leaves trajectories with a step that needs elimination),
                rank 2 or elimination
"gauss"         elimination

With orientations "auto" uses no closed form. If only the last of less than JUMP states is saved, it
uses none in 3D, and in nD only for what rank 2 leaves.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from .._bodies.body_nd import is_solved
from .._kernels import blocks, blocks_nd, codes
from .closed_form_runs import Rows, fill_rows, fill_states, orbits_of, slices
from .layout import for_kernel
from .problem import Driver, Indices, Output, Problem, Span
from .reduced_runs import Reduced, of_n_3, reduce
from .stepping import iterate, iterate_nd

# Number of steps from which on the closed form is faster if only the last state is saved.
JUMP = 32
# Number of three-dimensional states of a run in n dimensions in memory at a time.
_EXPANDED = 2**19

canonical_steps = partial(iterate, kernel=blocks.canonical)
printed_steps = partial(iterate, kernel=blocks.printed)
gyrostat_steps = partial(iterate, kernel=blocks.gyrostat, step=2.0)
by_rank2 = partial(iterate_nd, kernel=blocks_nd.rank2)
# If every step needs elimination, a stretch takes some 0.3 s.
by_rank2_or_elimination = partial(iterate_nd, kernel=blocks_nd.rank2, elimination=1.0 / 48.0)
by_elimination = partial(iterate_nd, kernel=blocks_nd.gauss, elimination=1.0 / 3.0)


def drivers_3d(
    problem: Problem, span: Span, by_steps: Callable[..., Indices] = canonical_steps
) -> tuple[Driver, ...]:
    """Return the drivers of a run of a body in three dimensions."""
    if problem.method == "ds2":
        by_steps = printed_steps
    if _may_jump(problem, span) and not _is_short(span):
        return Driver(closed_form, keeps=False), Driver(by_steps, from_0=True, keeps=False)
    return (Driver(by_steps),)


def drivers_nd(problem: Problem, span: Span) -> tuple[Driver, ...]:
    """Return the drivers of a run in n dimensions.

    The choice for a trajectory does not depend on the others.
    """
    if problem.method == "gauss":
        return (Driver(by_elimination),)
    steps = by_rank2, by_rank2_or_elimination
    if not _may_jump(problem, span) or not is_solved(*problem.parameters[:2]).any():
        return tuple(map(Driver, steps))
    jump = Driver(closed_form_nd, keeps=False), Driver(reduced_steps, from_0=True, keeps=False)
    if _is_short(span):
        # From step 0: the division of a run must not decide where the closed form is used, which is
        # more accurate next to a pole than elimination.
        first, last = (Driver(each, from_0=True) for each in steps)
        return first, *(each._replace(from_0=True) for each in jump), last
    return *jump, *map(Driver, steps)


def _may_jump(problem: Problem, span: Span) -> bool:
    """Return True if the closed form may be used."""
    return problem.method == "auto" and problem.orientation is None and span.steps > 0


def _is_short(span: Span) -> bool:
    """Return True if iteration is faster: few steps, of which only the last state is saved.

    Runs that save more states use the closed form for any number of steps, so that their states do
    not depend on the division of a run.
    """
    return span.save_every is None and span.steps < JUMP


def closed_form(problem: Problem, span: Span, output: Output) -> Indices:
    """Evaluate all states; return the orbits that must be iterated."""
    last = float(span.steps)
    ends = output.status, output.failed_at, last
    orbits = orbits_of(problem.parameters, problem.omega0, False, problem.threads, ends)
    if rows := len(output.saved):
        first, every = span.rows_before, float(span.every)
        fill_rows(orbits, Rows(every, first, first + rows, -first), output.saved)
    if not span.saves_last:
        to = np.zeros(1, np.intp)
        fill_states(orbits, 1.0, np.array([last]), to, output.final[np.newaxis])
    return output.with_status(codes.NEEDS_STEPS)


def closed_form_nd(problem: Problem, span: Span, output: Output) -> Indices:
    """Evaluate all states of solved bodies from those in three dimensions; return the others."""
    three, reduced = _in_3d(problem)
    if reduced is None:
        left = closed_form(three, span, output)
    else:
        leaves = ~reduced.fits
        if leaves.all():
            return np.flatnonzero(leaves)
        for lanes, rows in slices(problem.size, max(len(output.saved), 1), _EXPANDED):
            leaves[slice(*lanes)] |= _expand(three, span, output, reduced, lanes, rows)
        left = np.flatnonzero(leaves)
    _as_in_nd(problem, span, output)
    return left


def reduced_steps(problem: Problem, span: Span, output: Output) -> Indices:
    """Iterate solved bodies in three dimensions, and return the others."""
    three, reduced = _in_3d(problem)
    if reduced is None:
        left = canonical_steps(three, span, output)
    else:
        left = np.flatnonzero(~reduced.fits)
        if left.size == problem.size:
            return left
        found = Output.of_part(three, span)
        found = found._replace(status=output.status, failed_at=output.failed_at)
        canonical_steps(three, span, found)
        reduced.expand(found.saved, output.saved, 0, problem.threads)
        reduced.expand(found.final[np.newaxis], output.final[np.newaxis], 0, problem.threads)
    _as_in_nd(problem, span, output)
    return left


def _in_3d(problem: Problem) -> tuple[Problem, Reduced | None]:
    """Return the problem of the 3D bodies, and for n > 3 the reduction, which fits solved ones."""
    J, I, eps = problem.parameters
    if problem.omega0.shape[1] == 2:
        return problem._replace(parameters=(*map(for_kernel, of_n_3(J, I)), eps)), None
    reduced = reduce(problem.parameters, problem.omega0, problem.threads)
    parameters = tuple(for_kernel(each) for each in reduced.three.T)
    three = problem._replace(omega0=reduced.state, parameters=parameters)
    return three, reduced._replace(fits=reduced.fits & is_solved(J, I))


def _expand(
    three: Problem,
    span: Span,
    output: Output,
    reduced: Reduced,
    lanes: tuple[int, int],
    rows: tuple[int, int],
) -> NDArray[np.bool_]:
    """Fill rows of the saved states of some trajectories, and their last states.

    Returns where the closed form leaves a trajectory.
    """
    (begin, end), (row, stop) = lanes, rows
    stop = min(stop, len(output.saved))
    last = stop == len(output.saved)
    start = (span.rows_before + row - 1) * span.every if row else span.start
    steps = span.steps if last else (span.rows_before + stop - 1) * span.every
    some, part = three.take(np.arange(begin, end)), Span(steps, span.save_every, start)
    status, failed_at = output.status[begin:end], output.failed_at[begin:end]
    found = Output.of_part(some, part)._replace(status=status, failed_at=failed_at)
    leaves = np.zeros(end - begin, bool)
    leaves[closed_form(some, part, found)] = True
    reduced.expand(found.saved, output.saved[row:stop], begin, three.threads)
    if last:
        reduced.expand(found.final[np.newaxis], output.final[np.newaxis], begin, three.threads)
    return leaves


def _as_in_nd(problem: Problem, span: Span, output: Output) -> None:
    """Complete what was computed in three dimensions."""
    if len(output.saved) and span.start == 0:  # state 0 is a copy of the input
        exists = (output.status >= 0) | (output.failed_at != 0)
        np.copyto(output.saved[0], problem.omega0, where=exists[:, np.newaxis])
    # In n dimensions there is no status for t >= 1: most bodies have no t.
    np.minimum(output.status, codes.OK, out=output.status)
