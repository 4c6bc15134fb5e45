"""The choice of the algorithms that compute a run.

A driver computes what it can, and leaves the other trajectories to the next:

"auto" in 3D    closed form (leaves orbits near overflow, and some with t >= 1), steps
"auto" in nD    closed form (leaves bodies that are not solved), rank 2, rank 2 or elimination
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
from .closed_form_runs import Rows, fill_rows, fill_states, orbits_of, slices
from .execution import NONE, Driver, Indices, Output, Problem, Span, in_turn, span_of
from .layout import for_kernel
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


def run_3d(
    problem: Problem, span: Span, output: Output, by_steps: Driver = canonical_steps
) -> None:
    """Compute a run of a body in three dimensions."""
    if problem.method == "ds2":
        by_steps = printed_steps
    if _may_jump(problem, span) and not _is_short(span):
        in_turn((closed_form, by_steps), problem, span, output, from_0=True)
    else:
        by_steps(problem, span, output)


def run_nd(problem: Problem, span: Span, output: Output) -> None:
    """Compute a run in n dimensions; the choice for a trajectory does not depend on the others."""
    drivers: list[Driver] = [by_rank2, by_rank2_or_elimination]
    if problem.method == "gauss":
        drivers = [by_elimination]
    elif _may_jump(problem, span):
        is_short = _is_short(span)
        drivers.insert(1 if is_short else 0, closed_form_nd)
        if is_short:
            # From step 0: the division of a run must not decide where the closed form is used,
            # which is more accurate next to a pole than elimination.
            span = span_of(span.steps, span.save_every)
    in_turn(drivers, problem, span, output)


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
    if span.rows:
        first, every = span.rows_before, float(span.every)
        fill_rows(orbits, Rows(every, first, first + span.rows, -first), output.saved)
    if not span.saves_last:
        to = np.zeros(1, np.intp)
        fill_states(orbits, 1.0, np.array([last]), to, output.final[np.newaxis])
    return output.with_status(codes.NEEDS_STEPS)


def closed_form_nd(problem: Problem, span: Span, output: Output) -> Indices:
    """Evaluate all states of solved bodies from those in three dimensions; return the others."""
    J, I, eps = problem.parameters
    size, m = problem.omega0.shape
    if not size or not (solved := is_solved(J, I)).any():
        return np.arange(size)
    if m == 2:
        three = problem._replace(parameters=(*map(for_kernel, of_n_3(J, I)), eps))
        in_turn((closed_form, canonical_steps), three, span, output, from_0=True)
        left = NONE
    else:
        reduced = reduce(problem.parameters, problem.omega0, problem.threads)
        jumps = reduced.fits & solved
        left = np.flatnonzero(~jumps)
        if left.size == size:
            return left
        for lanes, rows in slices(size, max(len(output.saved), 1), _EXPANDED):
            _expand(problem, span, output, reduced, lanes, rows)
        if len(output.saved) and span.start == 0:  # a copy of the input
            exists = (output.status >= 0) | (output.failed_at != 0)
            np.copyto(output.saved[0], problem.omega0, where=exists[:, np.newaxis])
    # In n dimensions there is no status for t >= 1: most bodies have no t.
    np.minimum(output.status, codes.OK, out=output.status)
    return left


def _expand(
    problem: Problem,
    span: Span,
    output: Output,
    reduced: Reduced,
    lanes: tuple[int, int],
    rows: tuple[int, int],
) -> None:
    """Fill rows of the saved states of some trajectories, and their last states."""
    (begin, end), (row, stop) = lanes, rows
    stop = min(stop, len(output.saved))
    last = stop == len(output.saved)
    start = (span.rows_before + row - 1) * span.every if row else span.start
    steps = span.steps if last else (span.rows_before + stop - 1) * span.every
    three = problem._replace(
        batch=(end - begin,),
        omega0=reduced.state[begin:end],
        parameters=tuple(for_kernel(each) for each in reduced.three[begin:end].T),
    )
    part = span_of(steps, span.save_every, start)
    found = Output.empty(three, part, np.empty((part.rows or 1, end - begin, 2)), None)
    status, failed_at = output.status[begin:end], output.failed_at[begin:end]
    found = found._replace(status=status, failed_at=failed_at)
    in_turn((closed_form, canonical_steps), three, part, found, from_0=True)
    reduced.expand(found.saved, output.saved[row:stop], begin, problem.threads)
    if last:
        final = found.final[np.newaxis], output.final[np.newaxis]
        reduced.expand(*final, begin, problem.threads)
