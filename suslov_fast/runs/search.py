"""The search for crossings of a surface s(x) = 0 along orbits.

Orbits are computed in pieces that fit into the caches. The user's function returns a value for each
state of a piece, and only the states on both sides of a change of sign are kept.

A value of 0 counts as positive, but at the start, where it counts as the one after it: a start on
the surface is no crossing. With a = s(x_n) and b = s(x_{n+1}), an orbit crosses upwards if
a < 0 <= b, and downwards if b < 0 <= a. The straight line from x_n to x_{n+1} meets the surface, to
first order, at the fraction a / (a - b) of its length.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies.fields.symbolic import applied
from ..bodies.fields.texts import values_of
from ..checks import FloatArray, arguments_of, require, wrong
from ..core.lists.records import FUNCTIONS, OTHER_NAMES
from ..engine.status import Status
from ..engine.stretches import March, Report
from .change import refuse_event

# Numbers in a piece: long, because each piece costs as much as some steps; but shorter than outputs
# that kernels write past the caches (`STREAM_FROM`), because the surface reads them again.
PIECE = 3 * 2**18
# Least number of states of each trajectory in a piece, unless these are more than _LARGE numbers.
STATES, _LARGE = 8, 2**22
# Steps of the first piece of a run that may end early; the length doubles from piece to piece.
_FIRST = 64
_WITHOUT_END = 2**62
_LAST = "components on the last axis, as x[..., 0]"

Surface = Callable[[FloatArray], ArrayLike]


def checked_surface(surface: Any, labels: Sequence[str]) -> Any:
    """Return a function of the states; a formula of components stands for where it is 0.

    TypeError unless it takes one argument, and has no attributes of SciPy.
    """
    expected = "a function of the states alone, such as lambda x: x[..., 0] - 1, or a formula"
    if isinstance(surface, str):
        try:
            with np.errstate(all="ignore"):
                _value_of(surface, dict.fromkeys(labels, np.ones(1)))
        except ValueError as error:
            how = f"{surface!r}: {error}; components are {', '.join(labels)}"
            raise wrong("surface", expected, how) from None
        return lambda x: _value_of(surface, dict(zip(labels, np.moveaxis(x, -1, 0), strict=True)))
    if not callable(surface):
        is_number = isinstance(surface, (int, float))
        how = f": pass lambda x: x[..., k] - {surface}, for component k" if is_number else ""
        raise wrong("surface", expected, f"{checks.kind_of(surface)}{how}", TypeError)
    if len(needed := arguments_of(surface)) > 1:
        raise wrong("surface", expected, f"one of {', '.join(needed)}", TypeError)
    how = "pass most=1 to end at the first crossing, direction=-1 for crossings downwards"
    refuse_event(surface, how)
    return surface


def _value_of(text: str, named: Mapping[str, FloatArray]) -> Any:
    """Return the value of a formula of components, arrays."""

    def function(name: str, of: Sequence[Any]) -> Any:
        own = OTHER_NAMES.get(name, name)
        if own not in FUNCTIONS or len(of) != FUNCTIONS[own].operands:
            raise ValueError(f"there is no function {name} of {len(of)}")
        return applied(own, *of)

    return values_of([(0, text)], named, function)[0]


def values_at(surface: Surface, states: FloatArray, all_exist: bool) -> FloatArray:
    """Return the values (...) of a surface at states (..., D), which it cannot change, checked.

    They are NaN at states that are NaN, because a function with integer values returns numbers
    there; with `all_exist` the caller knows that there are none.
    """
    states = states.view()
    states.flags.writeable = False
    try:
        # No warnings, because states after the end of a trajectory are NaN or may overflow here.
        with np.errstate(over="ignore", invalid="ignore"):
            returned = surface(states)
    except (TypeError, AttributeError, IndexError, ValueError) as error:
        if type(error).__module__ != "builtins":
            raise
        raise type(error)(f"surface must take {_LAST}: {error}") from error
    values, what = np.asarray(returned), "have real numbers as values"
    if isinstance(returned, np.ma.MaskedArray):
        how = "return NaN where there is no value, for example by values.filled(np.nan)"
        raise wrong("surface", what, f"a masked array: {how}", TypeError)
    if values.dtype.kind == "b":
        how = "pass the difference, not the comparison"
        raise wrong("surface", what, f"bool: {how}", TypeError)
    if values.dtype.kind not in "iuf":
        received: object = "None: return a value" if returned is None else values.dtype
        raise wrong("surface", what, received, TypeError)
    if values.shape != states.shape[:-1]:
        expected = f"have a value for each state, (...) for states (..., D), with {_LAST}"
        raise wrong("surface", expected, f"values {values.shape} for states {states.shape}")
    # Writeable, because Numba would compile for read-only arrays anew.
    values = np.require(values, np.float64, ["C", "A", "W"])
    return values if all_exist else np.where(np.isnan(states[..., 0]), np.nan, values)


class _Found(NamedTuple):
    """Crossings of a piece, in ascending order of n."""

    trajectory: NDArray[np.int64]
    rank: NDArray[np.int64]  # how many crossings the trajectory had before
    n: NDArray[np.int64]
    before: FloatArray  # (K, D), the states n and n + 1
    after: FloatArray
    fraction: FloatArray


def _crossings_at(
    places: NDArray[np.int64],
    n: int,
    last: FloatArray,
    values: FloatArray,
    states: FloatArray,
    most: int,
    counts: NDArray[np.int64],
) -> _Found:
    """Return the crossings at changes of sign, and add their numbers to `counts` (B,).

    Place k B + i is a change after row k of orbit i, in `states` (rows + 1, B, D); row 0 is state
    n, with the values `last` (B,) of the surface, and `values` (rows, B) are those at the rows
    after it. A value that is not finite makes no crossing, and an orbit has at most `most` of them.
    """
    B = len(counts)
    k, i = np.divmod(places, B)
    earlier = np.where(k == 0, last[i], values.ravel().take(places - B))
    later = values.ravel().take(places)
    are_finite = np.isfinite(earlier) & np.isfinite(later)
    if not are_finite.all():
        places, k, i = places[are_finite], k[are_finite], i[are_finite]
        earlier, later = earlier[are_finite], later[are_finite]
    order = np.argsort(i, kind="stable")
    of_orbit = i[order]
    rank = np.empty_like(i)
    rank[order] = np.arange(len(i)) - np.searchsorted(of_orbit, of_orbit)
    rank += counts[i]
    kept = rank < most
    if not kept.all():
        places, k, i, rank = places[kept], k[kept], i[kept], rank[kept]
        earlier, later = earlier[kept], later[kept]
    counts += np.bincount(i, minlength=B)
    # Halve both where the difference could overflow.
    scale = np.where(np.maximum(abs(earlier), abs(later)) < 2.0**1023, 1.0, 0.5)
    fraction = scale * earlier / (scale * earlier - scale * later)
    rows = states.reshape(-1, states.shape[-1])
    before, after = rows.take(places, axis=0), rows.take(places + B, axis=0)
    return _Found(i, rank, n + k, before, after, fraction)


class Search:
    """A search for crossings along a march.

    Attributes
    ----------
    counts : ndarray(int, shape=(B,))
        Number of crossings of each trajectory.
    last : ndarray(float, shape=(B,))
        Values of the surface at the state of the march, after the transient.
    alive : ndarray(int8, shape=(B,))
        Statuses after the transient, which trajectories keep that end at their last crossing.
    is_stopped : bool
        Whether `progress` ended the run.
    """

    def __init__(self, march: March, surface: Surface, direction: int, most: int | None) -> None:
        self.march, self.surface = march, surface
        self.changed: Any = {1: np.greater, -1: np.less, 0: np.not_equal}[direction]
        self.limit = most or _WITHOUT_END
        B, D = march.omega0.shape
        self.batch, self.is_stopped = march.problem.batch, False
        self.pieces: list[_Found] = []
        self.last = self.values_of(march.omega0.reshape(1, *self.batch, D))[0]
        self.counts, self.alive = np.zeros(B, np.int64), march.status.ravel()

    def _end(self) -> None:
        """Mark trajectories that have ended as failed, so that kernels leave them out."""
        self.march.status.reshape(-1)[self.counts >= self.limit] = Status.NONFINITE

    def values_of(self, states: FloatArray) -> FloatArray:
        """Return the checked values (rows, B) of the surface at states (rows, ..., D)."""
        exist = self.march.n > 0 and (self.march.status >= 0).all()
        return values_at(self.surface, states, bool(exist)).reshape(len(states), -1)

    def run(self, transient: int, end: int, report: Report | None) -> None:
        """March to state `end`, and search among the states from `transient` on."""
        march, n = self.march, transient
        (B, D), report_steps = march.omega0.shape, None

        if report is not None:

            def report_steps(done: int) -> bool:
                self.is_stopped = not report(done)
                return not self.is_stopped

        march.to(transient, report=report_steps if transient else None)
        self.alive = march.status.ravel().copy()
        width = max(B * D, 1)
        most = min(max(PIECE // width, min(STATES, _LARGE // width), 1), end - transient)
        require(8 * (most + 1) * B * (D + 1), "divide the batch")
        states = np.empty((most + 1, *self.batch, D))  # of a piece, and the last one before it
        states[0] = march.final
        if transient and n < end and not self.is_stopped:
            self.last = self.values_of(states[:1])[0]
        longest = most if self.limit == _WITHOUT_END else min(_FIRST, most)
        while n < end and not self.is_stopped and (march.status >= 0).any():
            rows = min(longest, end - n)
            longest = min(2 * longest, most)
            march.to(n + rows, 1, states[n > 0 : rows + 1])  # from 0, it saves state 0 as well
            values = self.values_of(states[1 : rows + 1])
            self._keep_crossings(n, states[: rows + 1], values)
            states[0], self.last = states[rows], values[-1].copy()
            self._end()
            n += rows
            if report_steps is not None:
                report_steps(n)

    def _keep_crossings(self, n: int, states: FloatArray, values: FloatArray) -> None:
        """Keep the crossings among states (rows + 1, ..., D), of which the first is state n.

        `values` (rows, B) are those of the surface at the states after it.
        """
        is_positive = np.empty((len(states), values.shape[1]), bool)
        is_positive[0], is_positive[1:] = self.last >= 0.0, values >= 0.0
        if n == 0:  # a start on the surface is on the side to which the orbit goes
            is_positive[0] = np.where(self.last == 0.0, is_positive[1], is_positive[0])
        changes = np.flatnonzero(self.changed(is_positive[1:], is_positive[:-1]))
        if changes.size:
            flat = states.reshape(*is_positive.shape, -1)
            given = changes, n, self.last, values, flat
            self.pieces.append(_crossings_at(*given, self.limit, self.counts))

    def result(self) -> dict[str, Any]:
        """Return the arrays of all crossings, in order."""
        march, counts = self.march, self.counts
        ends = np.cumsum(counts)
        starts, K, D = ends - counts, int(counts.sum()), march.omega0.shape[1]
        n, fraction = np.empty(K, np.int64), np.empty(K)
        before, after = np.empty((K, D)), np.empty((K, D))
        trajectory = np.repeat(np.arange(len(counts)), counts)
        self.pieces.reverse()
        while self.pieces:  # popped, so that their memory is freed on the way
            found = self.pieces.pop()
            places = starts[found.trajectory] + found.rank
            n[places], fraction[places] = found.n, found.fraction
            before[places], after[places] = found.before, found.after
        final, status, failed_at = march.final.copy(), march.status.copy(), march.failed_at.copy()
        ended = counts >= self.limit
        final.reshape(-1, D)[ended] = after[ends[ended] - 1]
        status.reshape(-1)[ended] = self.alive[ended]
        failed_at.reshape(-1)[ended] = -1
        # Of trajectories that ended, report only positive statuses from before their end.
        (first, noted), first_pole = march.noted(), march.first_pole.reshape(-1)
        last = n[np.maximum(ends, 1) - 1] + 1 if K else 0
        first_pole[ended & (first_pole > last)] = -1
        told = ended & (first > 0) & (first <= last)
        status.reshape(-1)[told] = np.broadcast_to(noted, told.shape)[told]
        failed_at.reshape(-1)[told] = first[told]
        eps = np.asarray(march.problem.eps)
        states = after - before
        states *= fraction[:, np.newaxis]  # in place, in two fifths of the time
        states += before
        return {
            "trajectory": trajectory,
            "time": (n + fraction) * np.broadcast_to(eps, self.batch).ravel()[trajectory],
            "states": states,
            "surface": np.zeros(K, np.int64),
            "n": n,
            "before": before,
            "after": after,
            "fraction": fraction,
            "count": counts.reshape(self.batch),
            "status": status,
            "failed_at": failed_at,
            "end": np.where(status < 0, failed_at * eps, np.nan),
            "first_pole": first_pole.reshape(self.batch),
            "final": final,
        }
