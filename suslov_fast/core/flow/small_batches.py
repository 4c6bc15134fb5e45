"""Small batches of trajectories, in memory that is kept from call to call.

Allocating memory would take longer than the steps. Steps and bits are the same as in `BatchSolver`,
which continues if a trajectory ends, or if one of several changes to the other integrator.
"""

import functools
import math
from array import array

import numpy as np

from .batch_solver import (
    COLUMNS,
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

_KEPT = 1024  # the most requested times for which memory is kept
_NAN = array("d", [math.nan])


class _PreparedRunner(StepRunner):
    """A `StepRunner` of B trajectories, kept for later calls; each has a table if `for_each`."""

    event_times = None

    def __init__(self, f, settings, sign, B, for_each):
        integrator = integrator_of(f, bool(settings.stiff), settings.atol is not None)
        self.begins_with = integrator
        places, count = integrator.rows, B * integrator.rows.size
        shape = (B, len(f.table)) if for_each else (len(f.table),)
        both = np.zeros(count + math.prod(shape))
        rows, table = both[:count].reshape(B, -1), both[count:].reshape(shape)
        rows[:, places.state] = BEGINS
        rows[:, places.trajectory].view(np.int64)[:] = np.arange(B)
        self.x, self.watches = rows[:, : f.D], rows[:, places.watches]
        self.state = rows[:, places.state]
        self.columns = {name: rows[:, getattr(places, name)] for name in COLUMNS}
        first = both.copy()  # the content with which each call begins
        self.first_table, self.source = first[count:].reshape(shape), None
        self.now, self.first = both.data, first.data  # Python copies `data` faster than NumPy does
        numbers, W, self.moduli = numbers_of(settings, sign)[:], 1 if B == 1 else WIDTH, None
        super().__init__(integrator, W, rows, table, numbers, components_of(f, settings))

    def begin(self, x0, table, request):
        """Begin a call: set states x0 (B, D), the table of f, and times of a `SolverRequest`."""
        if self.integrator is not self.begins_with:
            self.use(self.begins_with)
        if (source := table.tobytes()) != self.source:
            self.first_table[:], self.source = table, source
        if (moduli := request.times.tobytes()) != self.moduli:
            self.moduli, self.times = moduli, array("d", moduli)
            self.times.extend(NO_TIMES)
            set_times(self.numbers, self.integrator, request.settings, self.times)
            self.point_to(self.times.buffer_info()[0], 0, 8 * self.x.size)
        self.now[:] = self.first
        self.x[:] = x0

    def begin_events(self, request):
        """Set times and limits of events of a `SolverRequest`; `records` is a new list."""
        if (given := request.event_times or NO_EVENT_TIMES) is not self.event_times:
            self.event_times, first = given, self.integrator.rows.stop
            self.stops, (times, equal) = self.rows[:, first : first + 2], given.array
            self.first_stops = times[:, 0]
            self.point_to_events(times, equal, None)
        self.numbers[NUMBER.enough] = request.most
        self.numbers[NUMBER.since] = request.since
        self.stops[:], self.records = self.first_stops, []


@functools.lru_cache(64)
def prepared(f, settings, sign, B, for_each):
    """Return the list of unused `_PreparedRunner`s for these arguments.

    `sign` is 1, or -1 backward in time. If `for_each` is True, each of B trajectories has a table.
    """
    return []


def solve_small_batch(f, table, x0, request):
    """Compute trajectories from x0 (B, D) until one of them needs the other integrator.

    A single trajectory is computed to the end, with both integrators.

    `table`, (n,) or (B, n), is the table of f. Return (states, columns, records, begun):

    states    (count, B, D) at the times, NaN where they are not reached
    columns   of `COLUMNS` by name, and `records` (arrays of the actions of events), if all
              trajectories have reached the last time without an alarm; else None
    begun     (rows, table, records) if `columns` is None, from which `BatchSolver.run` continues
    """
    B, starts, records, count = len(x0), None, [], len(request.times)
    if f.offsets:
        table, x0, starts = counted_from_start(f, table, x0)
    key = f, request.settings, request.sign, B, f.branches is not None or table.ndim > 1
    free = prepared(*key)
    try:
        runner = free.pop()
    except IndexError:
        runner = _PreparedRunner(*key)
    runner.begin(x0, table, request)
    states = _NAN * (count * B * f.D)
    runner.arguments[SLOT.states] = states.buffer_info()[0]
    if f.events:
        runner.begin_events(request)
        records = runner.records
    while not runner.take():
        pass
    ends = runner.state.tolist()
    while B == 1 and ends[0] < LaneState.DONE:  # the trajectory turns to the other integrator
        own = runner.integrator
        runner.use(integrator_of(f, not own.is_implicit, own.has_atol))
        while not runner.take():
            pass
        ends = runner.state.tolist()
    states = np.ndarray((count, B, f.D), np.float64, states)
    if ends.count(LaneState.DONE) < B or math.inf in runner.watches.tolist():
        own = runner.table.copy() if f.branches else None
        found = states, None, None, (runner.rows.copy(), own, records)
    else:
        columns = {}
        for name, column in runner.columns.items():
            columns[name] = column.astype(COLUMNS[name])
        found = states, columns, records, None
        if starts is not None:
            add_starts(f, starts, states, records)
    if count > _KEPT:
        runner.moduli = runner.times = None
    free.append(runner)
    return found
