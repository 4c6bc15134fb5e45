"""The motion of trajectories at given times: blocks on threads, and the integrator of each."""

import functools
from array import array
from math import inf
from threading import get_ident
from typing import Any, NamedTuple

import numpy as np

from ..cached import cached_property
from ..llvm.compiler import address_of, compiled
from ..llvm.tolerances import WIDTH
from ..maps.packs import zeros
from ..numba.threads import in_parts
from .allowed_errors import floors_of
from .code_arguments import COMPONENT, NUMBER, SLOT, CodeArguments, SharedNumbers
from .events.actions import most_records
from .events.records import size_of
from .growing_components import many_of, some_of
from .integrator import Integrator
from .memory import BEGINS, UNKEPT, LaneState
from .program_code import TABLE, by_code
from .rules import rule_of
from .step_length import first_part, limit_of
from .step_loop import text_of_integrator
from .tolerances import (
    LEAST_RTOL,
    LONGEST_PART,
    MOST_TRIES,
    ROUNDS_OF_WIDE,
    SPENT_BEFORE_WIDE,
    TRAJECTORIES_OF_THREAD,
    WORK_WITHOUT_PAUSE,
)

NO_TIMES = inf, inf  # after the last time: no step reaches these
# {column of results: the row of a trajectory with its value at the end, and the type of the column}
COLUMNS = {"steps": ("steps", np.dtype(np.int64))}

_integrator = functools.lru_cache(64)(Integrator)


class Settings(NamedTuple):
    """Settings of all trajectories: keywords of `flow`, under their names.

    They apply again where a motion begins again: after events at time 0, in second tries, with
    modes, in segments of exponents, arcs of periodic orbits, and calls of `compiled.system`.
    """

    rtol: float
    atol: Any = None  # None, a number for all components, or a tuple with a number for each
    max_step: float | None = None
    stiff: bool | None = None  # True if all steps are implicit, None if the solver chooses


def integrator_of(f, mode, settings, is_relative=False):
    """Return the `Integrator` of f for lanes in this `LaneState`, with tolerances in `settings`."""
    return _integrator(rule_of(f, mode, settings.rtol), settings.atol is not None, is_relative)


def closer(settings):
    """Return the `Settings` with which trajectories are computed again after an alarm."""
    part = 16.0 if settings.rtol > 1e-8 else 4.0  # a loose rtol, of few digits, is divided by more
    return settings._replace(rtol=max(settings.rtol / part, LEAST_RTOL))


class SolverRequest(NamedTuple):
    """The request of a call of the engine: times, settings, threads, limits of crossings."""

    times: Any  # (n,), moduli in ascending order
    sign: int  # -1 backwards in time, else 1
    settings: Settings
    threads: int | None = None
    report: Any = None  # called with the number of finished states; the result False ends the run
    event_times: Any = None  # `EventTimes`, if f has events
    most: float = inf  # number of recorded crossings after which a trajectory stops
    since: float = -1.0  # modulus of the time after which crossings count


@functools.lru_cache(64)
def components_of(f, settings):
    """Return the array (8, D) of `ComponentNumbers` of each component of f."""
    atol = settings.atol
    is_clock = np.zeros(f.D, bool)
    is_clock[[*f.clocks]] = True
    found = np.zeros((len(COMPONENT), f.D))
    found[COMPONENT.extra] = np.where(is_clock, np.inf, 0.0 if atol is None else atol)
    found[COMPONENT.counts] = ~is_clock
    found[COMPONENT.steady, [*f.steady]] = 1.0
    found[COMPONENT.keeps, [*f.of_one_sign]] = 1.0
    floors = [floors_of(settings.rtol, keeps) for keeps in found[COMPONENT.keeps]]
    found[COMPONENT.floor], found[COMPONENT.floor_implicit] = np.transpose(floors)
    some = [some_of(settings.rtol, keeps) for keeps in found[COMPONENT.keeps]]
    found[COMPONENT.some] = np.where(is_clock, np.inf, some)
    found[COMPONENT.seeds] = 2.0**-10 * np.cos(2.0 * np.arange(f.D) + 1.0)
    return found


@functools.lru_cache(256)
def numbers_of(f, settings, sign):
    """Return `SharedNumbers`, which all lanes share, as an array; `sign` of time is 1 or -1."""
    order = rule_of(f, LaneState.EXPLICIT, settings.rtol).order
    return array("d", SharedNumbers(
        rtol=settings.rtol,
        last=inf,
        sign=sign,
        part=first_part(settings.rtol, order),
        longest=inf,
        limit=limit_of(settings.rtol, order),
        switches=float(settings.stiff is None),
        first_state=float(LaneState.IMPLICIT if settings.stiff else LaneState.EXPLICIT),
        most=MOST_TRIES,
        many=many_of(settings.rtol),
        acts=float(settings.atol is None or bool(np.any(settings.atol))),
    ))  # fmt: skip


def set_times(numbers, integrator, settings, times):
    """Set the last time and longest step in `numbers`, from `times` that end with NO_TIMES."""
    numbers[NUMBER.last] = last = times[-1 - len(NO_TIMES)]
    numbers[NUMBER.longest] = longest = settings.max_step or inf
    if integrator.is_bounded:
        numbers[NUMBER.longest] = min(longest, LONGEST_PART * last)


def width_of(integrator, B):
    """Return how many lanes the code has with which a thread computes B trajectories."""
    if B == 1:
        return 1
    if integrator.spent < SPENT_BEFORE_WIDE:
        return WIDTH
    return next((W for W in integrator.wide if ROUNDS_OF_WIDE * W <= B), WIDTH)


def code_of(integrator, W, for_each):
    """Return the `Address` of code for W lanes; with `for_each` each lane has its own table."""
    # LLVM's level 1 gives code as fast as level 2, and takes a half to a fifth of the time.
    if (W, for_each) not in integrator.codes:
        key = "motion", integrator.key, W, for_each
        text_of = functools.partial(text_of_integrator, integrator, W=W, for_each=for_each)
        integrator.codes[W, for_each] = code = compiled(key, text_of, 1)
        if integrator.f.products:  # keep in memory the matrices that the code reads
            vars(code).setdefault("functions", integrator.functions)
    return integrator.codes[W, for_each]


class EventTimes:
    """The given times of events, in one row for all trajectories or one row for each.

    `times` are moduli in ascending order, infinity for none; `which` are the numbers of the events.
    """

    def __init__(self, times, which):
        self.times, self.which = times, which

    def of(self, trajectories):
        """Return the `EventTimes` of some trajectories, given by their numbers."""
        if len(self.times) == 1:
            return self
        return EventTimes(self.times[trajectories], self.which[trajectories])

    @cached_property
    def array(self):
        """Pairs (time, event), shape (rows, n + 1, 2), and the largest number of equal times."""
        rows, n = self.times.shape
        found = np.full((rows, n + 1, 2), np.inf)
        found[:, :-1, 0], found[..., 1] = self.times, 0.0
        found[:, :-1, 1] = self.which
        most, known = 1, np.where(np.isfinite(self.times), self.times, np.nan)
        while (known[:, most:] == known[:, :-most]).any():
            most += 1
        return found, most


NO_EVENT_TIMES = EventTimes(np.empty((1, 0)), np.empty((1, 0)))


def counted_from_start(f, table, x0):
    """Move start values of clocks from x0 (B, D) to the `table` of f, so that clocks begin at 0.

    Return (table, x0, starts); `starts` (B, clocks) are the start values, or None if all are 0.
    """
    starts = x0[:, [*f.hybrid.offsets]] if f.hybrid.offsets else ()
    if not np.count_nonzero(starts):
        return table, x0, None
    own, x0 = f.of_x, x0.copy()
    count = f.hybrid.parameters(own.P)  # branches have the places from `count` on
    if f is own and len(x0) == 1:  # NumPy would take ten times as long
        given = np.zeros(own.P)
        given[:count] = table.ravel()[:count]
        for clock, number in f.hybrid.offsets.items():
            given[number - own.D], x0[0, clock] = x0[0, clock], 0.0
        return by_code(f, TABLE, given).reshape(table.shape), x0, starts
    of_clocks = starts[0] if table.ndim == 1 and (starts == starts[0]).all() else starts
    inputs = np.zeros((*np.broadcast_shapes(table.shape[:-1], of_clocks.shape[:-1]), own.P))
    inputs[..., :count] = table[..., :count]
    inputs[..., [number - own.D for number in f.hybrid.offsets.values()]] = of_clocks
    table = np.broadcast_to(table, (*inputs.shape[:-1], table.shape[-1]))
    x0[:, [*f.hybrid.offsets]] = 0.0
    return np.ascontiguousarray(f.table_with(inputs.T, table.T).T), x0, starts


def add_starts(f, starts, states, records):
    """Add the start values (B, clocks) of clocks to states (count, B, D), also in `records`."""
    clocks = np.array([*f.hybrid.offsets])
    for clock, start in zip(f.hybrid.offsets, starts.T, strict=True):
        states[..., clock] += start
    for rows in records:
        own = starts[rows[:, 0].view(np.int64)]
        for first in (3, 3 + f.D):
            rows[:, first + clocks] += own


class BatchSolver:
    """Trajectories x0 (B, D) of x' = f(x) at the times of a `SolverRequest`.

    table    values of `RightHandSide.table`: (n,), or (B, n) for each trajectory
    states   (count, B, D), the output; after the end of a solution it stays unchanged
    t, state (B,), modulus of the time at which each trajectory ended, and its `LaneState`
    columns  `COLUMNS` of each trajectory at its end, by name
    lost     (B, D), relative errors of the components of x0, 0 if not given. An entry RELATIVE asks
             for allowed errors relative to the component's own value (`growing_components`). After
             the run these are the errors at the end, if `lost` was given or an alarm ended a
             trajectory of the same block
    doubtful (B,), True where an alarm of `growing_components` did not end the trajectory
    unkept   (B, UNKEPT), tests of first integrals, see `projected_states`; 0 without integrals
    records  arrays of the actions of events, see `events.records`
    is_stopped   True if `report` stopped the run
    """

    def __init__(self, f, table, x0, request, states, lost=None, acts=True):
        B, settings = len(x0), request.settings
        self.f, self.states, self.request = f, states, request
        self.begins_lost = lost is not None
        self.lost = np.zeros((B, f.of_x.D)) if lost is None else lost
        self.is_relative = self.begins_lost and bool(np.any(self.lost < 0.0))
        self.table, self.x0, self.starts = counted_from_start(f, table, x0)
        self.times = np.concatenate([request.times, NO_TIMES])
        self.components = components_of(f, settings)
        self.t = np.zeros(B)
        self.columns = {name: np.zeros(B, kind) for name, (_, kind) in COLUMNS.items()}
        self.state = np.zeros(B, np.int8)
        self.records, self.doubtful, self.unkept = [], np.zeros(B, bool), np.zeros((B, UNKEPT))
        self.is_stopped, self.event_times = False, None
        integrator = self.integrator(LaneState.EXPLICIT)
        self.rows, self.numbers = integrator.rows, numbers_of(f, settings, request.sign)[:]
        set_times(self.numbers, integrator, settings, self.times)
        if not acts:
            self.numbers[NUMBER.acts] = 0.0
        if f.hybrid.acts:
            event_times = request.event_times or NO_EVENT_TIMES
            self.event_times, self.equal = event_times.array
            self.numbers[NUMBER.enough] = request.most
            self.numbers[NUMBER.since] = request.since
        if f.hybrid.chooses:  # trajectories have branches of their own, which the code chooses
            self.table = np.broadcast_to(self.table, (B, self.table.shape[-1])).copy()

    def integrator(self, mode):
        """Return the `Integrator` for lanes in this `LaneState`, EXPLICIT or IMPLICIT."""
        return integrator_of(self.f, mode, self.request.settings, self.is_relative)

    def run(self, threads=1, begun=None):
        """Take all steps, from the start or from `begun`, where `solve_small_batch` stopped.

        If `report`, which this thread calls from time to time, returns False, the steps end.
        """
        B = len(self.x0)
        self.caller = get_ident()
        self.places = None if self.request.report is None else np.zeros(B, np.int64)
        size = min(TRAJECTORIES_OF_THREAD, max(-(-B // (threads * WIDTH)) * WIDTH, WIDTH))
        rows, abandoned = None, []
        if begun is not None:
            size, (rows, table, self.records) = B, begun
            self.table = self.table if table is None else table
        blocks = [slice(first, min(first + size, B)) for first in range(0, B, size)]
        in_parts(len(blocks), lambda k: self._take(blocks[k], abandoned, rows), abandoned, threads)
        if self.starts is not None:
            add_starts(self.f, self.starts, self.states, self.records)

    def report_of_part(self, which):
        """Return `report` for a run that computes trajectories `which` again, or None."""
        if self.places is None:
            return None
        most, report = int(self.places.sum()), self.request.report
        before = most - int(self.places[which].sum())
        return lambda done: report(max(before + done, most))

    def _rows(self, block):
        """Return an array (K, -): rows of trajectories in the slice `block`, before any step."""
        rows, found = self.rows, np.zeros((block.stop - block.start, self.rows.size))
        found[:, : self.f.D] = self.x0[block]
        found[:, rows.state] = BEGINS
        found[:, rows.trajectory].view(np.int64)[:] = np.arange(block.start, block.stop)
        if self.begins_lost:
            lost, D = self.lost[block], self.lost.shape[1]
            lost = np.where(self.components[COMPONENT.counts, :D] > 0.0, lost, 0.0)
            # The mark RELATIVE (`lost` < 0) of a component holds for its columns, other `lost` not.
            of_all = np.hstack([lost, *[np.minimum(lost, 0.0)] * self.f.columns])
            found[:, rows.lost : rows.lost + of_all.shape[1]] = of_all
            found[:, rows.most_lost] = lost.max(axis=1, initial=0.0)
        if self.event_times is not None:
            first = self.event_times[block if len(self.event_times) > 1 else slice(None), 0]
            found[:, rows.stop], found[:, rows.stop_which] = first.T
        return found

    def _take(self, block, abandoned, flat=None):
        """Take all steps of slice `block` (rows `flat` if given) until `abandoned` has an entry."""
        rows, B, mode = self.rows, block.stop - block.start, int(bool(self.request.settings.stiff))
        flat = self._rows(block) if flat is None else flat
        numbers = np.arange(block.start, block.stop)
        state = flat[:, rows.state].copy()  # because NumPy reads columns slowly
        while not abandoned and np.count_nonzero(state < LaneState.DONE):
            (which,) = np.nonzero((state == mode) | (state == BEGINS))
            if which.size:
                own = flat if which.size == B else flat[which]
                integrator = self.integrator(mode)
                W = width_of(integrator, B)
                self._steps(integrator, own, numbers[which], W, abandoned)
                if own is not flat:
                    flat[which] = own
            state = flat[:, rows.state].copy()
            mode = 1 - mode  # for trajectories that turned to the other integrator
        t = self.t[block] = flat[:, rows.t]
        self.state[block] = state
        for name, column in self.columns.items():
            column[block] = flat[:, getattr(rows, COLUMNS[name][0])]
        self.doubtful[block] = (flat[:, rows.most_lost] == inf) & (state != LaneState.AGAIN)
        if self.f.of_x.left_out:
            self.unkept[block] = flat[:, rows.unkept : rows.unkept + UNKEPT]
        if self.begins_lost or np.count_nonzero(state == LaneState.AGAIN):
            self.lost[block] = flat[:, rows.lost : rows.lost + self.lost.shape[1]]
        if self.event_times is not None:
            self.t[block] = np.where(state == LaneState.ACCUMULATES, flat[:, rows.at], t)

    def _steps(self, integrator, rows, which, W, abandoned):
        """Take steps with one integrator, until no trajectory uses it or `abandoned` has an entry.

        `rows` (K, -) are rows of the trajectories with the numbers `which`.
        """
        runner = self._runner(integrator, rows, which, W)
        while not abandoned:
            is_done = runner.take()
            if (report := self.request.report) is not None:
                reached = rows[:, integrator.rows.place].view(np.int64)
                self.places[which] = reached
                if get_ident() == self.caller and report(int(self.places.sum())) is False:
                    self.is_stopped = True
                    abandoned.append(True)
            if is_done:
                break
        if self.f.hybrid.chooses:  # the code has written branches to the tables of trajectories
            self.table[which] = runner.table

    def _runner(self, integrator, rows, which, W):
        """Return the `StepRunner` of trajectories `which` with `rows`; it copies the tables."""
        table = self.table.copy() if self.table.ndim == 1 else self.table[which]
        table = np.ascontiguousarray(table)
        runner = StepRunner(integrator, W, rows, table, self.numbers, self.components)
        runner.point_to(address_of(self.times), address_of(self.states), self.states.strides[0])
        if self.event_times is not None:
            runner.point_to_events(self.event_times, self.equal, self.records)
        return runner


class StepRunner:
    """A call of an integrator's code for W lanes: its arguments and its memory.

    It takes steps of the trajectories in `rows`, with one table for all or one for each.
    """

    def __init__(self, integrator, W, rows, table, numbers, components):
        self.W, self.for_each = W, table.ndim > 1
        self.arguments = array("q", CodeArguments(
            rows=address_of(rows), count=len(rows), following=0, budget=0, table=address_of(table),
            table_bytes=table.strides[0], work=0, numbers=numbers.buffer_info()[0],
            components=address_of(components),
        ))  # fmt: skip
        # Keep these arrays in memory, because the arguments hold their addresses.
        self.rows, self.table, self.numbers, self.components = rows, table, numbers, components
        self.at, self.records, self.known = self.arguments.buffer_info()[0], [], {}
        self.use(integrator)

    def use(self, integrator):
        """Let `take` take steps with this integrator, in a workspace of its own."""
        if integrator not in self.known:
            work = zeros(integrator.work.size, self.W)
            budget = max(WORK_WITHOUT_PAUSE // integrator.f.cost, 1)
            code = code_of(integrator, self.W, self.for_each)
            self.known[integrator] = work, address_of(work), code, budget
        self.integrator = integrator
        self.work, self.arguments[SLOT.work], self.code, self.budget = self.known[integrator]
        self.call = self.code.call

    def point_to(self, times, states, state_bytes):
        """Set the addresses of times and states; states at two times are `state_bytes` apart."""
        self.arguments[SLOT.times], self.arguments[SLOT.states] = times, states
        self.arguments[SLOT.state_bytes] = state_bytes

    def point_to_events(self, event_times, equal, records):
        """Let `take` read `event_times`, pairs (time, event), and append actions to `records`.

        `equal` is the largest number of events at one time.
        """
        f, arguments, self.records = self.integrator.f, self.arguments, records
        # Twice the most at one time: a lane may begin a trajectory and take a step without a pause.
        at_once = 2 * most_records(f.hybrid.events, equal) * self.W
        full = 4 * arguments[SLOT.count] + 512 * self.W
        self.buffer = np.empty((full + at_once, size_of(f)))
        arguments[SLOT.event_times] = address_of(event_times)
        arguments[SLOT.event_time_bytes] = event_times.strides[0] if len(event_times) > 1 else 0
        arguments[SLOT.records] = address_of(self.buffer)
        arguments[SLOT.full] = full

    def take(self):
        """Take steps until the budget is spent; return whether all trajectories are done."""
        arguments = self.arguments
        arguments[SLOT.budget] = self.budget
        is_done = self.call(self.at)
        if self.W > 1:
            self.integrator.spent += 1.0 - arguments[SLOT.budget] / self.budget
        if is_done:  # the next call begins with the first trajectory
            arguments[SLOT.following] = 0
        if count := arguments[SLOT.recorded]:
            self.records.append(self.buffer[:count].copy())
            arguments[SLOT.recorded] = 0
        return is_done
