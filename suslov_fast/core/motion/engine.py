"""The motion of trajectories at given times: blocks of lines, and which code takes them."""

import functools
from array import array
from math import inf
from threading import get_ident
from typing import NamedTuple

import numpy as np

from ..code.compiler import address_of, compiled
from ..compiling.threads import in_parts
from ..fields.lines import zeros
from ..lists.variational import Variational
from .arguments import COMPONENT, NUMBER, SLOT, Arguments, Numbers
from .explicit import lane_numbers
from .half import Half
from .rows import BEGINS, OF_CHANGES, Cause, State
from .rules import MOST_AT_ONCE, MOST_STEPS, SECTION_PARTS, first_part, limit_of
from .text import text_of_half

# Parts of the time: within which f has no value where a solution ends, and in which one that goes
# to infinity doubles.
_AHEAD, _AT_ONCE = (2.0**-43, 2.0**-40, 2.0**-36), 2.0**-30
WIDTH = 8  # lanes of a line
BLOCK = 1024  # trajectories that one thread takes at a time
RECORDS = 4096  # of changes, after which Python takes them
BUDGET = 2**18  # operations of f in all lanes, after which Python handles Ctrl-C
# LLVM's passes leave .66 to .87 of the time of implicit steps of systems with so few components,
# with the same bits; they are worth their time after so many steps, which take about a second.
SMALL, WORTH_PASSES = 10, 4_000_000
# Without optimisation LLVM takes a third of the time, for code that takes 1.03 to 2 times as long,
# with the same bits. It takes the first steps, by lanes: some tenths of a second, implicit ones a
# quarter of these. Loops take three times as long, and so a part of these.
FIRST_STEPS, PART_OF_LONG = {1: 2**16, WIDTH: 2**19}, 64
NO_TIMES = inf, inf  # after the last time: of no step are these the next and the second one

half_of = functools.lru_cache(64)(Half)


class Settings(NamedTuple):
    """What all trajectories of a motion share: keywords of `flow`, under their names."""

    rtol: float
    atol: float | tuple | None = None  # one for all components, or one for each
    max_step: float | None = None
    stiff: bool | None = None  # whether all steps are implicit, None to choose


@functools.lru_cache(64)
def components_of(f, atol):
    """Return `Arguments.components` (4, D): the rows extra, counts, keeps and seeds."""
    is_clock = np.zeros(f.D, bool)
    is_clock[[*f.clocks]] = True
    found = np.zeros((len(COMPONENT), f.D))
    found[COMPONENT.extra] = np.where(is_clock, np.inf, 0.0 if atol is None else atol)
    found[COMPONENT.counts] = ~is_clock
    found[COMPONENT.keeps, [*f.of_one_sign]] = 1.0
    found[COMPONENT.seeds] = 2.0**-10 * np.cos(2.0 * np.arange(f.D) + 1.0)
    return found


def is_bounded(f):
    """Return whether steps are at most a part of the time: f has clocks, or it may jump."""
    return bool(f.clocks) or (f.conditions is not None and f.conditions.jumps > 0)


@functools.lru_cache(256)
def numbers_of(settings, sign):
    """Return `Numbers` whose times are not set."""
    return Numbers(
        settings.rtol,
        inf,
        sign,
        first_part(settings.rtol),
        settings.max_step or inf,
        limit_of(settings.rtol),
        float(settings.stiff is None),
        inf,
        inf,
        float(State.IMPLICIT if settings.stiff else State.EXPLICIT),
        MOST_STEPS,
    )


def set_times(numbers, f, first, second, last):
    """Set the moduli of the first two times and of the last one."""
    numbers[NUMBER.first_next], numbers[NUMBER.second_next] = first, second
    numbers[NUMBER.last] = last
    if is_bounded(f):
        numbers[NUMBER.longest] = min(numbers[NUMBER.longest], last / 32.0)


def first_steps(half, W):
    """Return the number of steps that code without optimisation takes."""
    return FIRST_STEPS[W] // (4 if half.is_implicit else 1) // (PART_OF_LONG if half.is_long else 1)


def code_of_half(half, W, for_each):
    """Return the `Address` of the code of a half, whose steps say how good it has to be."""
    return compiled(
        ("motion", half.key, W, for_each),
        lambda name: text_of_half(half, name, W, for_each),
        # Level 1 is as fast as level 2, in a half to a fifth of LLVM's time.
        level=int(half.steps > first_steps(half, W)),
        passes=half.is_implicit and half.f.D <= SMALL and half.steps > WORTH_PASSES,
    )


def prepare(f, settings, B, for_each):
    """Make the code of the halves that B trajectories may need, which take many steps.

    `for_each` says whether each trajectory has numbers of its own.
    """
    for is_implicit in (False, True) if settings.stiff is None else (settings.stiff,):
        half, W = half_of(f, is_implicit, settings.atol is not None), 1 if B == 1 else WIDTH
        half.steps = max(half.steps, first_steps(half, W) + 1)
        code_of_half(half, W, for_each or f.conditions is not None)


def records_at_once(changes, equal):
    """Return how many records a trajectory may add to the buffer before there is a pause.

    `equal` is how many times of changes are equal at most.
    """
    at_once = equal + changes.surfaces + int(MOST_AT_ONCE)
    return 2 * (at_once + (SECTION_PARTS + 1) * changes.sections)


class Stops(NamedTuple):
    """The times of changes of the state, ascending, in a row for all trajectories or for each."""

    times: np.ndarray  # moduli (1 or B, n), infinity for none
    which: np.ndarray  # numbers of the changes (1 or B, n)

    def of(self, trajectories):
        """Return the times of some trajectories."""
        if len(self.times) == 1:
            return self
        return Stops(self.times[trajectories], self.which[trajectories])

    def array(self):
        """Return `Arguments.stops` (1 or B, n + 1, 2), and how many times at most are equal."""
        rows, n = self.times.shape
        if not n:
            return _NO_STOPS, 1
        found = np.full((rows, n + 1, 2), np.inf)
        found[:, :-1, 0], found[..., 1] = self.times, 0.0
        found[:, :-1, 1] = self.which
        number = np.arange(n)  # of a time, and of the first one that equals it
        is_same = np.isfinite(self.times)
        is_same[:, :1] = False
        is_same[:, 1:] &= self.times[:, 1:] == self.times[:, :-1]
        first = np.maximum.accumulate(np.where(is_same, 0, number), axis=1)
        most = 1 + int((number - first).max())
        return found, most


_NO_STOPS = np.array([[[inf, 0.0]]])


def counted_from_start(f, table, x0):
    """Return the table, states x0 (B, D) with clocks at 0, and their starts, None if they are 0."""
    if not f.offsets:
        return table, x0, None
    starts = x0[:, [*f.offsets]]
    if not starts.any():
        return table, x0, None
    of_clocks = starts[0] if table.ndim == 1 and (starts == starts[0]).all() else starts
    own = f.of if isinstance(f, Variational) else f
    count = own.P if f.conditions is None else f.conditions.P  # after them there are choices
    inputs = np.zeros((*np.broadcast_shapes(table.shape[:-1], of_clocks.shape[:-1]), own.P))
    inputs[..., :count] = table[..., :count]
    inputs[..., [number - own.D for number in f.offsets.values()]] = of_clocks
    table = np.broadcast_to(table, (*inputs.shape[:-1], table.shape[-1]))
    x0 = x0.copy()
    x0[:, [*f.offsets]] = 0.0
    return np.ascontiguousarray(f.table_with(inputs.T, table.T).T), x0, starts


def add_starts(f, records, starts):
    """Add the starts (-, clocks) of clocks to the states in records of changes."""
    for first in range(3, records.shape[1], f.D):
        records[:, first + np.array([*f.offsets])] += starts


class Motion:
    """Trajectories x0 (B, D) of x' = f(x) at ascending moduli of times, forward or backward.

    table    values of `RightHandSide.table`: (n,), or (B, n) for each trajectory
    sign     1 or -1, forward or backward in time
    states   (count, B, D), to which the states are written; where a solution has ended they stay
    t, steps, state   of each trajectory: modulus of the time at which it ended, the number of its
             steps, and its `State`
    grown    pairs: numbers of trajectories of which a component fell and grew, see `rules.LOW`, and
             that component of each
    causes   pairs: numbers of trajectories that ended, and why, a `Cause` of each
    stops    `Stops` of changes, if f has them; times may then begin with 0
    records  arrays of what changes did, see `Changes.record`: the trajectory and the number of the
             change, two integers, the modulus of the time, and the states before and after
    """

    def __init__(self, f, table, x0, times, sign, settings, states, stops=None):
        self.f, self.states = f, states
        self.table, self.x0, self.starts = counted_from_start(f, table, x0)
        self.settings, self.times = settings, np.concatenate([times, NO_TIMES])
        first, second, self.last = self.times[[0, 1, len(times) - 1]].tolist()
        self.components = components_of(f, settings.atol)
        self.numbers = np.array(numbers_of(settings, sign))
        set_times(self.numbers, f, first, second, self.last)
        self.has_atol = settings.atol is not None
        self.t, self.steps = np.zeros(len(x0)), np.zeros(len(x0), np.int64)
        self.state = np.zeros(len(x0), np.int8)
        self.grown, self.causes, self.is_stopped = [], [], False
        self.rows = half_of(f, False, self.has_atol).rows
        self.records, self.stops = [], None
        if f.changes:
            none = Stops(np.empty((1, 0)), np.empty((1, 0)))
            self.stops, self.equal_stops = (stops or none).array()
        if f.conditions:  # trajectories have choices of their own, which the code makes
            shape = len(x0), self.table.shape[-1]
            self.table = np.broadcast_to(self.table, shape).copy()

    def run(self, threads=1, report=None):
        """Take all steps of all trajectories.

        `report` takes the number of states that are done, in this thread, now and then; if it
        returns False, the steps end, and `is_stopped` is true.
        """
        B = len(self.x0)
        self.report, self.caller = report, get_ident()
        self.places = None if report is None else np.zeros(B, np.int64)
        size = min(BLOCK, max(-(-B // (threads * WIDTH)) * WIDTH, WIDTH))
        blocks = [slice(first, min(first + size, B)) for first in range(0, B, size)]
        abandoned = []
        if threads == 1 or len(blocks) == 1:
            for block in blocks:
                self._take(block, abandoned)
        else:
            in_parts(len(blocks), lambda k: self._take(blocks[k], abandoned), abandoned, threads)
        if self.starts is not None:
            self.states[..., [*self.f.offsets]] += self.starts
            for rows in self.records:
                add_starts(self.f, rows, self.starts[rows[:, 0].view(np.int64)])

    def _take(self, block, abandoned):
        """Take all steps of a block of trajectories."""
        rows, B = self.rows, block.stop - block.start
        own = flat = np.zeros((B, rows.size))
        flat[:, : self.f.D] = self.x0[block]
        flat[:, rows.state] = BEGINS
        numbers = np.arange(block.start, block.stop)
        flat[:, rows.trajectory].view(np.int64)[:] = numbers
        if self.stops is not None:
            first = self.stops[block if len(self.stops) > 1 else slice(None), 0]
            of_changes = flat[:, rows.of_changes :]
            of_changes[:, OF_CHANGES.stop], of_changes[:, OF_CHANGES.stop_which] = first.T
        which, mode, W = slice(None), int(bool(self.settings.stiff)), 1 if B == 1 else WIDTH
        while len(own) and not abandoned:
            half = half_of(self.f, mode == State.IMPLICIT, self.has_atol)
            self._steps(half, own, numbers[which], W, abandoned)
            if own is not flat:
                flat[which] = own
            state, mode = flat[:, rows.state], 1 - mode  # of those that turned to the other half
            if not np.count_nonzero(state < State.DONE):
                break
            if not np.count_nonzero(state == mode):
                mode = 1 - mode
            which = np.flatnonzero(state == mode)
            own = flat[which]
        state, t = flat[:, rows.state], flat[:, rows.t]
        self.t[block], self.steps[block], self.state[block] = t, flat[:, rows.steps], state
        low = flat[:, rows.low : rows.far] >= 3.0
        if np.count_nonzero(low):
            (k,) = np.nonzero(low.any(axis=1))
            self.grown.append((numbers[k], low[k].argmax(axis=1)))
        if not np.count_nonzero(state != State.DONE):
            return
        (k,) = np.nonzero(state == State.ENDED)
        if k.size:
            self.causes.append((numbers[k], self._causes_of_end(flat[k], numbers[k])))
        if self.stops is not None:
            limit = flat[:, rows.of_changes + OF_CHANGES.at]
            self.t[block] = np.where(state == State.ACCUMULATES, limit, t)

    def _causes_of_end(self, flat, which):
        """Return a `Cause` for each of these rows of trajectories `which`."""
        rows, whole = self.rows, self.f.D
        f = self.f.of if isinstance(self.f, Variational) else self.f
        table = (self.table if self.table.ndim == 1 else self.table[which])[..., : len(f.table)]
        x, t, rates = flat[:, : f.D].T, flat[:, rows.t], flat[:, rows.f : rows.f + f.D].T
        denominators = flat[:, rows.f + whole : rows.f + whole + len(f.denominators)].T
        has_none = has_pole = np.zeros(len(flat), bool)
        with np.errstate(all="ignore"):
            for part in _AHEAD:
                ahead = x + self.numbers[NUMBER.sign] * part * t * rates
                found = f.value_and_denominators(ahead, table.T)
                has_none = has_none | np.isnan(found[: f.D]).any(axis=0)
                has_pole = has_pole | (found[f.D :] * denominators < 0.0).any(axis=0)
            growth = self.numbers[NUMBER.sign] * x * rates
            doubles = (growth * (_AT_ONCE * t) >= x**2) & (growth > 0.0)
        escapes = doubles.any(axis=0) | ~np.isfinite(rates).all(axis=0)
        of_others = np.where(escapes, Cause.ESCAPE, Cause.POLE)
        return np.where(has_pole, Cause.POLE, np.where(has_none, Cause.NO_VALUE, of_others))

    def _table(self, half, which):
        """Return the numbers that functions read: for all trajectories, or for each (K, n)."""
        if self.table.ndim == 1:
            return half.table_of(self.table)
        return np.ascontiguousarray(half.table_of(self.table[which].T).T)

    def _steps(self, half, rows, which, W, abandoned):
        """Take steps of one half of trajectories (K, rows), until none is in it.

        `which` are their numbers; `places` count the times that they have reached.
        """
        table = self._table(half, which)
        take = self._taker(half, rows, table, W)
        while not abandoned:
            is_done = take()
            if self.report is not None:
                reached = rows[:, half.rows.place].view(np.int64)
                self.places[which] = reached
                if get_ident() == self.caller and self.report(int(self.places.sum())) is False:
                    self.is_stopped = True
                    abandoned.append(True)
            if is_done:
                break
        self.keep_choices(which, table)

    def keep_choices(self, which, table):
        """Keep the choices that the code has written to the tables of trajectories."""
        if self.f.conditions:
            self.table[which] = table[:, : self.table.shape[1]]

    def _taker(self, half, rows, table, W):
        """Return the function that takes steps of trajectories, and returns whether it is done."""
        for_each, steps, before = table.ndim > 1, rows[:, half.rows.steps], 0.0
        code, is_small = code_of_half(half, W, for_each), half.is_implicit and half.f.D <= SMALL
        most = WORTH_PASSES if is_small else first_steps(half, W)  # after these it is the best
        work = zeros(half.work.size + (lane_numbers(half) if W == 1 else 0), W)
        arguments = array("q", Arguments(
            rows=address_of(rows), count=len(rows), following=0, budget=0, table=address_of(table),
            table_bytes=table.strides[0], work=address_of(work), numbers=address_of(self.numbers),
            components=address_of(self.components), times=address_of(self.times),
            states=address_of(self.states), state_bytes=self.states.strides[0],
        ))  # fmt: skip
        at = arguments.buffer_info()[0]
        buffer = None
        if self.stops is not None:
            buffer = self._point_to_changes(arguments, W)

        def take(kept=(rows, table, work)):  # the arguments point there
            nonlocal code, before
            arguments[SLOT.budget] = max(BUDGET // half.f.work, 1)
            if is_done := code.call(at):
                arguments[SLOT.following] = 0
            if half.steps <= most:
                taken = steps.sum()
                half.steps, before = half.steps + taken - before, taken
                if not is_done:
                    code = code_of_half(half, W, for_each)
            if count := arguments[SLOT.recorded]:
                self.records.append(buffer[:count].copy())
                arguments[SLOT.recorded] = 0
            return is_done

        return take

    def _point_to_changes(self, arguments, W):
        """Let arguments point to the times of changes; return an array for records."""
        at_once = records_at_once(self.f.changes, self.equal_stops) * W
        buffer = np.empty((max(RECORDS, 4 * at_once), self.f.changes.record(self.f.D)))
        arguments[SLOT.stops] = self.stops.ctypes.data
        arguments[SLOT.stop_bytes] = self.stops.strides[0] if len(self.stops) > 1 else 0
        arguments[SLOT.records], arguments[SLOT.full] = buffer.ctypes.data, len(buffer) - at_once
        return buffer
