"""The motion of trajectories at given times: blocks of lines, and which code takes them."""

import functools
from threading import get_ident
from typing import NamedTuple

import numpy as np

from ..code.compiler import call, compiled
from ..compiling.threads import in_parts
from ..fields.lines import in_lines, zeros
from .choosing import Choices
from .half import Half
from .in_numpy import StepsInNumPy
from .rows import BEGINS, FILLING, State
from .rules import MOST_STEPS, first_part, limit_of
from .text import SLOT, Arguments, Numbers, lane_numbers, text_of_half

WIDTH = 8  # lanes of a line
BLOCK = 1024  # trajectories that one thread takes at a time
BUDGET = 2**18  # operations of f in all lanes, after which Python handles Ctrl-C


half_of = functools.lru_cache(64)(Half)


class Settings(NamedTuple):
    """What all trajectories of a motion share."""

    rtol: float
    atol: float | tuple | None  # one for all components, or one for each
    longest: float  # step
    stiff: bool | None  # whether all steps are implicit, None to choose


def constants_of(f, atol):
    """Return the arrays (D,) of `Arguments`: extra, counts, keeps and seeds."""
    is_clock = np.zeros(f.D, bool)
    is_clock[[*f.clocks]] = True
    extra, keeps = np.where(is_clock, np.inf, 0.0 if atol is None else atol), np.zeros(f.D)
    keeps[[*f.of_one_sign]] = 1.0
    seeds = 2.0**-10 * np.cos(2.0 * np.arange(f.D) + 1.0)
    return extra, np.where(is_clock, 0.0, 1.0), keeps, seeds


def numbers_of(f, settings, sign, first, last):
    """Return `Numbers`, for the moduli of the first and the last time."""
    return Numbers(
        settings.rtol,
        last,
        sign,
        first_part(settings.rtol),
        min(settings.longest, last / 32.0 if f.clocks else np.inf),
        limit_of(settings.rtol),
        float(settings.stiff is None),
        first,
        float(State.IMPLICIT if settings.stiff else State.EXPLICIT),
        MOST_STEPS,
        1.0,
    )


def code_of_half(half, W, for_each):
    """Return the `Address` of the code of a half, None where there is no machine code."""
    return compiled(
        ("motion", half.key, W, for_each),
        lambda name: text_of_half(half, name, W, for_each),
        level=1,  # code as fast as at level 2, in a half to a fifth of LLVM's time
    )


class Motion:
    """Trajectories x0 (B, D) of x' = f(x) at ascending moduli of times, forward or backward.

    table    values of `RightHandSide.table`: (n,), or (B, n) for each trajectory
    sign     1 or -1, forward or backward in time
    states   (count, B, D), to which the states are written; where a solution has ended they stay
    t, steps, implicit_steps, state   of each trajectory: modulus of the time at which it ended, the
             numbers of its steps and of those by the implicit half, and its `State`
    """

    def __init__(self, f, table, x0, times, sign, settings, states):
        self.f, self.table, self.x0, self.states = f, table, x0, states
        self.settings, self.times = settings, np.ascontiguousarray(times, np.float64)
        atol, last = settings.atol, float(self.times[-1])
        self.extra, self.counts, self.keeps, self.seeds = constants_of(f, atol)
        self.numbers = np.array(numbers_of(f, settings, sign, float(self.times[0]), last))
        self.has_atol = atol is not None
        self.t = np.zeros(len(x0))
        self.steps, self.implicit_steps = np.zeros((2, len(x0)), np.int64)
        self.state = np.full(len(x0), int(State.EXPLICIT), np.int8)
        self.places, self.is_stopped = np.zeros(len(x0), np.int64), False
        self.rows = half_of(f, False, self.has_atol).rows
        self.choices = None if f.conditions is None else Choices(self)

    def run(self, threads=1, report=None):
        """Take all steps of all trajectories.

        `report` takes the number of states that are done, in this thread, now and then; if it
        returns False, the steps end, and `is_stopped` is true.
        """
        B = len(self.x0)
        self.report, self.caller = report, get_ident()
        size = min(BLOCK, max(-(-B // (threads * WIDTH)) * WIDTH, WIDTH))
        blocks = [slice(first, min(first + size, B)) for first in range(0, B, size)]
        abandoned = []
        if threads == 1 or len(blocks) == 1:
            for block in blocks:
                self._take(block, abandoned)
        else:
            in_parts(len(blocks), lambda k: self._take(blocks[k], abandoned), abandoned)

    def _take(self, block, abandoned):
        """Take all steps of a block of trajectories."""
        rows, B = self.rows, block.stop - block.start
        flat = np.zeros((B, rows.size))
        flat[:, : self.f.D] = self.x0[block]
        flat[:, rows.state] = BEGINS
        flat[:, rows.trajectory].view(np.int64)[:] = np.arange(block.start, block.stop)
        which, is_implicit, W = np.arange(B), bool(self.settings.stiff), 1 if B == 1 else WIDTH
        while which.size and not abandoned:
            lines = self._lines(flat, which, W)
            half = half_of(self.f, is_implicit, self.has_atol)
            table = self._table(half, flat, which, np.arange(block.start, block.stop), W)
            self._steps(half, lines, table, self.places[block], which, abandoned)
            back = lines.transpose(0, 2, 1).reshape(-1, rows.size)[: len(which)]
            if is_implicit:
                taken = back[:, rows.steps] - flat[which, rows.steps]
                self.implicit_steps[block][which] += taken.astype(np.int64)
            if which.size == B:
                flat = np.ascontiguousarray(back)
            else:
                flat[which] = back
            if self.choices is not None:
                self.choices.renew(flat, np.arange(block.start, block.stop))
            state = flat[:, rows.state]
            is_implicit = not is_implicit
            which = np.flatnonzero(state == float(is_implicit))
            if not which.size:
                is_implicit = not is_implicit
                which = np.flatnonzero(state == float(is_implicit))
        self.t[block], self.steps[block] = flat[:, rows.t], flat[:, rows.steps]
        self.state[block] = flat[:, rows.state]

    def _lines(self, flat, which, W):
        """Return trajectories as lines; lanes that fill up the last line are done."""
        row, lines = self.rows.state, in_lines(flat[which], W)
        filling = len(lines) * W - len(which)
        if filling:
            is_new = lines[-1, row, -1] == BEGINS
            lines[-1, row, W - filling :] = FILLING if is_new else State.DONE
        return lines

    def _table(self, half, flat, k, trajectories, W):
        """Return the numbers that functions read: for all lanes, or as lines, for rows k."""
        if self.table.ndim == 1:
            return half.table_of(self.table)
        own = trajectories[k]
        if self.choices is not None:
            self.choices.look(flat[k], own)
        return in_lines(half.table_of(self.table[own].T).T, W)

    def _steps(self, half, lines, table, places, which, abandoned):
        """Take steps of one half in all lines, until no lane is in it.

        `places` of the trajectories `which` count the times that they have reached.
        """
        take = self._taker(half, lines, table)
        while not abandoned:
            is_done = take(abandoned)
            if self.report is not None:
                reached = lines[:, half.rows.place].view(np.int64).ravel()
                places[which] = reached[: len(which)]
                if get_ident() == self.caller and self.report(int(self.places.sum())) is False:
                    self.is_stopped = True
                    abandoned.append(True)
            if is_done:
                break

    def _taker(self, half, lines, table):
        """Return the function that takes some steps in all lines, and returns whether it is done.

        Its argument is a list, which is not empty if the steps are abandoned.
        """
        W, for_each = lines.shape[2], table.ndim > 1
        code = code_of_half(half, W, for_each)
        if code is None:

            def in_numpy(abandoned):
                StepsInNumPy(half, self, lines, table).run(abandoned)
                return True

            return in_numpy
        work = zeros(half.work.size + (lane_numbers(half) if W == 1 else 0), W)
        arguments = np.array(Arguments(
            rows=lines.ctypes.data, lines=len(lines), line=0, budget=0, table=table.ctypes.data,
            table_bytes=table[0].nbytes if for_each else 0, work=work.ctypes.data,
            numbers=self.numbers.ctypes.data, extra=self.extra.ctypes.data,
            counts=self.counts.ctypes.data, keeps=self.keeps.ctypes.data,
            seeds=self.seeds.ctypes.data, times=self.times.ctypes.data, count=len(self.times),
            states=self.states.ctypes.data, state_bytes=self.states.strides[0],
        ), np.int64)  # fmt: skip

        def take(_, kept=(lines, table, work)):  # the arguments point there
            arguments[SLOT.budget] = max(BUDGET // half.f.work, 1)
            if is_done := call(code, arguments):
                arguments[SLOT.line] = 0
            return is_done

        return take
