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

from functools import partial

import numpy as np

from .._bodies.body_nd import is_solved
from .._kernels import blocks, blocks_nd, codes
from .._kernels.lanes import LANES
from .closed_form_runs import Rows, at_equal_steps, at_times, orbits_of
from .layout import for_kernel
from .problem import Driver, Fill, Indices, Output, Problem, Span
from .reduced_runs import of_n_3, reduction
from .stepping import iterate_3d, iterate_nd

# Number of steps from which on the closed form is faster if only the last state is saved.
JUMP = 32
# Number of three-dimensional states of a run in n dimensions in memory at a time.
_EXPANDED = 2**19

canonical_steps = partial(iterate_3d, kernel=blocks.canonical)
printed_steps = partial(iterate_3d, kernel=blocks.printed)
gyrostat_steps = partial(iterate_3d, kernel=blocks.gyrostat, step=2.0)
by_rank2 = partial(iterate_nd, kernel=blocks_nd.rank2)
# If every step needs elimination, a stretch takes some 0.3 s.
by_rank2_or_elimination = partial(iterate_nd, kernel=blocks_nd.rank2, elimination=1.0 / 48.0)
by_elimination = partial(iterate_nd, kernel=blocks_nd.gauss, elimination=1.0 / 3.0)


def by_closed_form(problem: Problem, span: Span, output: Output) -> Indices:
    """Evaluate all states; return the orbits that must be iterated."""
    last = float(span.steps)
    ends = output.status, output.failed_at, last
    orbits = orbits_of(problem.parameters, problem.omega0, False, problem.threads, ends)
    if span.rows:
        first = span.rows_before
        rows = Rows(float(span.every), first, first + span.rows, -first)
        at_equal_steps(orbits, rows, output.saved)
    if not span.saves_last:
        to = np.zeros(1, np.intp)
        at_times(orbits, 1.0, np.array([last]), to, output.final[np.newaxis])
    return output.with_status(codes.NEEDS_STEPS)


def in_three_dimensions(fill: Fill, problem: Problem, span: Span, output: Output) -> Indices:
    """Compute solved bodies as 3D bodies; return the others, and those that `fill` leaves."""
    J, I, eps = problem.parameters
    if problem.omega0.shape[1] == 2:
        three = problem._replace(parameters=(*map(for_kernel, of_n_3(J, I)), eps))
        left = fill(three, span, output)
    else:
        reduced = reduction(problem.parameters, problem.omega0, problem.threads)
        leaves = ~(reduced.fits & is_solved(J, I))
        if leaves.all():
            return np.flatnonzero(leaves)
        parameters = tuple(map(for_kernel, reduced.three.T))
        three = problem._replace(omega0=reduced.state, parameters=parameters)
        together = max(_EXPANDED // (span.rows + 1), LANES)
        for begin in range(0, problem.size, together):
            end = min(begin + together, problem.size)
            part = three.take(np.arange(begin, end))
            found = Output.empty(part, span)._replace(
                status=output.status[begin:end], failed_at=output.failed_at[begin:end]
            )
            leaves[begin + fill(part, span, found)] = True
            reduced.expand(found.saved, output.saved, begin, problem.threads)
            reduced.expand(
                found.final[np.newaxis], output.final[np.newaxis], begin, problem.threads
            )
        left = np.flatnonzero(leaves)
    if len(output.saved) and span.start == 0:  # state 0 is a copy of the input
        exists = (output.status >= 0) | (output.failed_at != 0)
        np.copyto(output.saved[0], problem.omega0, where=exists[:, np.newaxis])
    # In n dimensions there is no status for t >= 1: most bodies have no t.
    np.minimum(output.status, codes.OK, out=output.status)
    return left


def drivers_3d(
    problem: Problem, span: Span, by_steps: Fill = canonical_steps
) -> tuple[Driver, ...]:
    """Return the drivers of a run of a body in three dimensions."""
    if problem.method == "ds2":
        by_steps = printed_steps
    if _may_jump(problem, span) and not _is_short(span):
        return Driver(by_closed_form, keeps=False), Driver(by_steps, from_0=True, keeps=False)
    return (Driver(by_steps),)


# Drivers in n dimensions: of solved bodies, and of all.
_SOLVED = (
    Driver(partial(in_three_dimensions, by_closed_form), keeps=False),
    Driver(partial(in_three_dimensions, canonical_steps), from_0=True, keeps=False),
)
_STEPS = Driver(by_rank2), Driver(by_rank2_or_elimination)
# From step 0: the division of a run must not decide where the closed form is used, which is more
# accurate next to a pole than elimination.
_FEW_STEPS = _STEPS[0]._replace(from_0=True), *_SOLVED, _STEPS[1]._replace(from_0=True)


def drivers_nd(problem: Problem, span: Span) -> tuple[Driver, ...]:
    """Return the drivers of a run in n dimensions.

    The choice for a trajectory does not depend on the others.
    """
    if problem.method == "gauss":
        return (Driver(by_elimination),)
    if not _may_jump(problem, span):
        return _STEPS
    if _is_short(span):
        return _FEW_STEPS
    return (*_SOLVED, *_STEPS) if is_solved(*problem.parameters[:2]).any() else _STEPS


def _may_jump(problem: Problem, span: Span) -> bool:
    """Return True if the closed form may be used."""
    return problem.method == "auto" and problem.orientation is None and span.steps > 0


def _is_short(span: Span) -> bool:
    """Return True if iteration is faster: few steps, of which only the last state is saved.

    Runs that save more states use the closed form for any number of steps, so that their states do
    not depend on the division of a run.
    """
    return span.save_every is None and span.steps < JUMP
