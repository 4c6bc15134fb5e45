"""Small batches of trajectories, in memory that is kept from call to call.

New memory would take longer than the steps. Steps and bits are those of `BatchSolver`, which
continues where a trajectory changes to the other integrator, or ends.
"""

import functools
import math
from array import array

import numpy as np

from .batch_solver import (
    NO_EVENT_TIMES,
    NO_TIMES,
    WIDTH,
    StepRunner,
    add_starts,
    components_of,
    counted_from_start,
    integrator_of,
    numbers_of,
    set_times,
)
from .code_arguments import NUMBER, SLOT
from .memory import BEGINS, LaneState

_KEPT = 1024  # times that memory is kept of
_NAN = array("d", [math.nan])
_GREW = array("d", [3.0]).tobytes()  # of a component, see `growing_components.LOW`


class _Memory:
    """The memory of B trajectories of f, with a table for all of them or one for each."""

    def __init__(self, f, settings, sign, B, for_each):
        integrator = self.integrator = integrator_of(
            f, bool(settings.stiff), settings.atol is not None
        )
        places, count = integrator.rows, B * integrator.rows.size
        shape = (B, len(f.table)) if for_each else (len(f.table),)
        self.all = np.zeros(count + math.prod(shape))
        self.rows, self.table = self.all[:count].reshape(B, -1), self.all[count:].reshape(shape)
        rows, self.numbers = self.rows, numbers_of(settings, sign)[:]
        rows[:, places.state] = BEGINS
        rows[:, places.trajectory].view(np.int64)[:] = np.arange(B)
        self.x, self.low = rows[:, : f.D], rows[:, places.low : places.far]
        self.state, self.steps = rows[:, places.state], rows[:, places.steps]
        first, self.source = self.all.copy(), None  # what calls begin with, and its table
        self.first_table = first[count:].reshape(shape)
        self.now, self.first = self.all.data, first.data  # Python copies them sooner than NumPy
        given = rows, self.table, self.numbers, components_of(f, settings.atol)
        self.runner, self.moduli = StepRunner(integrator, 1 if B == 1 else WIDTH, *given), None

    def set_times(self, moduli, settings):
        """Set the times, whose moduli are these bytes."""
        self.moduli, self.times = moduli, array("d", moduli)
        self.times.extend(NO_TIMES)
        set_times(self.numbers, self.integrator, settings, self.times)
        self.runner.point_to(self.times.buffer_info()[0], 0, 8 * self.x.size)


@functools.lru_cache(64)
def memories(f, settings, sign, B, for_each):
    """Return the list of those that no call is using."""
    return []


def solve_small_batch(f, table, x0, times, sign, settings, stops=None, enough=math.inf, since=-1.0):
    """Take trajectories x0 (B, D) to ascending moduli of times, as far as one integrator does.

    Return their states (count, B, D), NaN where there are none; numbers of steps, and records as
    those of `BatchSolver`, if all have reached the last time and no component fell and grew; and
    else, with None in their place, what `BatchSolver` goes on from. `table` (n,) or (B, n) is that
    of f; `enough` and `since` are those of `SharedNumbers`, with `stops`.
    """
    B, starts, records = len(x0), None, []
    if f.offsets:
        table, x0, starts = counted_from_start(f, table, x0)
    key = f, settings, sign, B, f.conditions is not None or table.ndim > 1
    free = memories(*key)
    try:
        memory = free.pop()
    except IndexError:
        memory = _Memory(*key)
    integrator, runner = memory.integrator, memory.runner
    if (source := table.tobytes()) != memory.source:
        memory.first_table[:], memory.source = table, source
    if (moduli := times.tobytes()) != memory.moduli:
        memory.set_times(moduli, settings)
    memory.now[:] = memory.first
    memory.x[:] = x0
    states = _NAN * (len(times) * B * f.D)
    runner.arguments[SLOT.states] = states.buffer_info()[0]
    if f.events:
        of_stops, equal = (stops or NO_EVENT_TIMES).array
        memory.numbers[NUMBER.enough], memory.numbers[NUMBER.since] = enough, since
        first = integrator.rows.stop
        memory.rows[:, first : first + 2] = of_stops[:, 0]
        runner.point_to_events(of_stops, equal, records)
    while not runner.take():
        pass
    states = np.ndarray((len(times), B, f.D), np.float64, states)
    if memory.state.tolist().count(LaneState.DONE) < B or _GREW in memory.low.tobytes():
        own = memory.table.copy() if f.conditions else None
        found = states, None, None, (memory.rows.copy(), own, records)
    else:
        found = states, memory.steps.astype(np.int64), records, None
        if starts is not None:
            add_starts(f, starts, states, records)
    if len(times) > _KEPT:
        memory.moduli = memory.times = None
    free.append(memory)
    return found
