"""A run of a map: its drivers, one after another, fill the output of a span."""

from __future__ import annotations

import numpy as np

from .._checks import EXACT, FloatArray, wrong
from .._kernels import codes
from .memory import require
from .problem import Driver, Indices, Output, Problem, Span
from .progress import Progress, reporter

# Numbers of states that are copied at a time for drivers of some trajectories.
_COPIED = 2**20
ONE_STEP = Span(1, None)


def drive(problem: Problem, span: Span, output: Output) -> None:
    """Fill an output: each driver computes the trajectories that those before it left."""
    todo = None  # all
    for driver in problem.map.drivers(problem, span):
        steps = Span(span.steps, span.save_every) if driver.from_0 else span
        if todo is None:
            todo = driver.fill(problem, steps, output)
        else:
            together = max(_COPIED // (problem.omega0.shape[1] * (steps.rows + 1)), 1)
            parts = (todo[k : k + together] for k in range(0, todo.size, together))
            left = [_drive_part(driver, problem, steps, output, part) for part in parts]
            todo = np.concatenate(left)
        if not todo.size:
            return


def _drive_part(
    driver: Driver, problem: Problem, span: Span, output: Output, chosen: Indices
) -> Indices:
    """Compute some trajectories in memory of their own; return those that the driver leaves."""
    part = problem.take(chosen)
    resume = {name: array[chosen] for name, array in span.resume.items()}
    span = Span(span.steps, span.save_every, span.start, resume)
    results = Output.empty(part, span)
    left = driver.fill(part, span, results)
    if not driver.keeps:
        results.resume.clear()
    if left.size < chosen.size:
        output.put(chosen, results)
    return chosen[left]


def execute(
    problem: Problem,
    span: Span,
    progress: Progress = None,
    out: FloatArray | None = None,
    before: tuple[FloatArray, FloatArray | None] | None = None,
) -> Output:
    """Compute a span; return results in the batch shape.

    Saved states are written to `out` if given; those saved earlier are copied from `before`.
    """
    (size, D), batch, orientation = problem.omega0.shape, problem.batch, problem.orientation
    earlier = 0 if before is None else span.rows_before
    rows = earlier + span.rows if span.save_every else 1
    shape = rows, *batch, D
    # Besides the saved states: omega0, the last state, and up to 2 D numbers to go on from.
    numbers = (4 + rows * (out is None and span.save_every is not None)) * size * D
    if orientation is not None:
        numbers += rows * orientation.size
    require(8 * numbers, "the saved states are {}: raise save_every or divide the batch", shape)
    if span.steps > EXACT:  # numbers of steps are floats in the closed form
        raise wrong("steps", "at most 2**53", span.steps)
    states = np.empty(shape) if out is None else out
    flat, turns, flat_turns = states.reshape(rows, size, D), None, None
    if orientation is not None:
        turns = np.empty((rows, *batch, D + 1, D + 1))
        flat_turns = turns.reshape(rows, size, D + 1, D + 1)[earlier:]
    if before is not None:
        states[:earlier], flat = before[0][:earlier], flat[earlier:]
        if turns is not None and before[1] is not None:
            turns[:earlier] = before[1][:earlier]
    output = Output.empty(problem, span, flat, flat_turns)
    if progress:
        with reporter(progress, span.steps - span.start) as report:
            drive(problem._replace(progress=report), span, output)
    else:  # a context and a second problem would take a tenth of a single step
        drive(problem, span, output)

    _, _, final, status, failed_at, resume = output
    if output.worst == codes.NOT_COMPUTED:
        raise RuntimeError("internal error: a kernel skipped trajectories; please report this")
    if resume:
        resume |= {"status": status, "failed_at": failed_at}
    resume["omega0"] = problem.omega0
    if orientation is not None:
        resume["R0"] = orientation
    # The last state is that saved, also if a span of no steps follows.
    last_is_saved = rows > 0 and span.steps % span.every == 0
    final = states[-1] if last_is_saved else final.reshape(shape[1:])
    status, failed_at = status.reshape(batch), failed_at.reshape(batch)
    return Output(states, turns, final, status, failed_at, resume)
