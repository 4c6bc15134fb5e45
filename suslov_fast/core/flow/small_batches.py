"""Small batches of trajectories, in memory that is kept from call to call.

Allocating memory would take longer than the steps. Steps and bits are the same as in `BatchSolver`,
which continues if a trajectory ends, or if one of several becomes explicit or implicit.
"""

import functools
import math
from array import array

import numpy as np

from ..llvm.compiler import address_of
from . import batch_solver
from .code_arguments import NUMBER
from .memory import BEGINS, UNKEPT, LaneState
from .tolerances import STATES_IN_MEMORY


class _PreparedRunner(batch_solver.StepRunner):
    """A `StepRunner` of B trajectories, kept for later calls; each has a table if `for_each`."""

    source = moduli = event_times = None

    def __init__(self, f, settings, sign, B, for_each):
        integrator = batch_solver.integrator_of(f, int(bool(settings.stiff)), settings)
        self.begins_with, places, count = integrator, integrator.rows, B * integrator.rows.size
        has_many = for_each or f.hybrid.chooses  # tables: each trajectory has branches of its own
        self.acts, shape = f.hybrid.acts, (B, len(f.table)) if has_many else (len(f.table),)
        both = np.zeros(count + math.prod(shape))
        rows, table = both[:count].reshape(B, -1), both[count:].reshape(shape)
        rows[:, places.state] = BEGINS
        rows[:, places.trajectory].view(np.int64)[:] = np.arange(B)
        self.x, self.most_lost = rows[:, : f.D], rows[:, places.most_lost]
        self.x_bytes = rows[0, : f.D].data.cast("B") if B == 1 else None
        self.state = rows[:, places.state]
        self.unkept = None
        if f.of_x.left_out:
            self.unkept = rows[:, places.unkept : places.unkept + UNKEPT]
        self.columns = [
            (name, rows[:, getattr(places, row)], kind)
            for name, (row, kind) in batch_solver.COLUMNS.items()
        ]
        first = both.copy()  # the content with which each call begins
        self.first_table = first[count:].reshape(shape)
        self.now, self.first = both.data, first.data  # Python copies `data` faster than NumPy does
        W = batch_solver.width_of(integrator, B)
        numbers = batch_solver.numbers_of(f, settings, sign)[:]
        components = batch_solver.components_of(f, settings)
        super().__init__(integrator, W, rows, table, numbers, components)

    def begin(self, x0, table, request):
        """Begin a call: set states x0 (B, D), the table of f, and what a `SolverRequest` asks."""
        if self.integrator is not self.begins_with:
            self.use(self.begins_with)
        if self.W > 1 and (W := batch_solver.width_of(self.integrator, len(self.x))) > self.W:
            self.W, self.known = W, {}
            self.use(self.integrator)
        if (source := table.tobytes()) != self.source:
            self.first_table[:], self.source = table, source
        if (moduli := request.times.tobytes()) != self.moduli:
            self.moduli, self.times = moduli, array("d", moduli)
            self.times.extend(batch_solver.NO_TIMES)
            batch_solver.set_times(self.numbers, self.integrator, request.settings, self.times)
            self.states = np.empty((len(request.times), *self.x.shape))
            self.point_to(self.times.buffer_info()[0], address_of(self.states), 8 * self.x.size)
        self.now[:] = self.first
        self.states.fill(math.nan)
        if self.x_bytes is None:
            self.x[:] = x0
        else:  # for one state this is faster
            self.x_bytes[:] = x0.tobytes()
        if not self.acts:
            return
        if (given := request.event_times or batch_solver.NO_EVENT_TIMES) is not self.event_times:
            self.event_times, first = given, self.integrator.rows.stop
            self.stops, (times, equal) = self.rows[:, first : first + 2], given.array
            self.first_stops = times[:, 0]
            self.point_to_events(times, equal, [])
        self.numbers[NUMBER.enough], self.numbers[NUMBER.since] = request.most, request.since
        self.stops[:], self.records = self.first_stops, []

    def is_clear(self):
        """Return whether all trajectories have reached the last time, without an alarm."""
        if self.unkept is not None and np.count_nonzero(self.unkept):
            return False
        if self.W == 1:  # for speed in small calls
            return self.state.item() == LaneState.DONE and self.most_lost.item() != math.inf
        is_done = _count(self.state, LaneState.DONE) == len(self.state)
        return is_done and not _count(self.most_lost, math.inf)


@functools.lru_cache(64)
def prepared(f, settings, sign, B, for_each):
    """Return the list of unused `_PreparedRunner`s with these arguments."""
    return []


def _count(row, value):
    """Return how many numbers of a row are equal to `value`; NumPy takes longer for few."""
    return row.tolist().count(value) if len(row) < 32 else np.count_nonzero(row == value)


def solve_small_batch(f, table, x0, request):
    """Return (states, columns, records, None) of trajectories from x0, with `table` of f.

    The states (count, B, D) are NaN where they are not reached. `columns` is {name in `COLUMNS`:
    array (B,)}, and `records` has the events. A single trajectory may change its integrator. If one
    of several does, or if a trajectory ends early, has an alarm (`growing_components`) or does not
    keep an integral (`projected_states`), return (states, None, None, begun), where `begun` is what
    `BatchSolver.run` needs to go on.
    """
    B, starts = len(x0), None
    if f.hybrid.offsets:
        table, x0, starts = batch_solver.counted_from_start(f, table, x0)
    key = f, request.settings, request.sign, B, table.ndim > 1
    free = prepared(*key)
    try:
        runner = free.pop()
    except IndexError:
        runner = _PreparedRunner(*key)
    runner.begin(x0, table, request)
    while True:
        while not runner.take():
            pass
        end = runner.state.item(0)
        if B > 1 or end >= LaneState.DONE:
            break
        runner.use(batch_solver.integrator_of(f, int(end), request.settings))  # it turns
    states, records = runner.states, runner.records
    if states.size > STATES_IN_MEMORY:
        runner.moduli = runner.times = runner.states = None
    else:
        states = states.copy()
    if runner.is_clear():
        columns = {}
        for name, row, kind in runner.columns:  # faster than a comprehension
            columns[name] = row.astype(kind)
        found = states, columns, records, None
        if starts is not None:
            batch_solver.add_starts(f, starts, states, records)
    else:
        own = runner.table.copy() if f.hybrid.chooses else None
        found = states, None, None, (runner.rows.copy(), own, records)
    free.append(runner)
    return found
