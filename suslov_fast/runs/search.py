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
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.fields.calls import called_by_name
from ..bodies.fields.texts import values_of
from ..checks import FloatArray, arguments_of, require, wrong
from ..engine.status import Status
from ..engine.stretches import March, Report
from .change import check_surface

# Numbers in a piece: long, because each piece costs as much as some steps; but shorter than outputs
# that kernels write past the caches (`STREAM_FROM`), because the surface reads them again.
PIECE = 3 * 2**18
# Least number of states of each trajectory in a piece, unless these are more than _LARGE numbers.
STATES, _LARGE = 8, 2**22
# Steps of the first piece of a run that may end early; the length doubles from piece to piece.
_FIRST = 64
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
    how = "pass most=1 to end at the first crossing, direction=-1 for crossings downwards"
    check_surface(surface, expected, "x[..., k]", how)
    if len(needed := arguments_of(surface)) > 1:
        raise wrong("surface", expected, f"one of {', '.join(needed)}", TypeError)
    return surface


def _value_of(text: str, named: Mapping[str, FloatArray]) -> Any:
    """Return the value of a formula of components, arrays."""
    return values_of([(0, text)], named, called_by_name)[0]


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


_Piece = tuple[Any, ...]  # trajectory, n, the states n and n + 1, and fraction, of crossings


def found_along(
    march: March,
    surface: Surface,
    direction: int,
    most: int | None,
    transient: int,
    end: int,
    report: Report | None,
) -> tuple[dict[str, Any], bool]:
    """March to state `end`, and search among the states from `transient` on.

    Return what a result has of crossings, and whether `report` ended the run. Trajectories that end
    at their last crossing keep the statuses that they have after the transient.
    """
    changed: Any = {1: np.greater, -1: np.less, 0: np.not_equal}[direction]
    batch, (B, D), n, is_stopped = march.problem.batch, march.omega0.shape, transient, False
    counts, ended = np.zeros(B, np.int64), np.zeros(B, bool)

    def values_of(states: FloatArray) -> FloatArray:
        """Return the checked values (rows, B) of the surface at states (rows, ..., D)."""
        exist = march.n > 0 and (march.status >= 0).all()
        return values_at(surface, states, bool(exist)).reshape(len(states), -1)

    def report_steps(done: int) -> bool:
        nonlocal is_stopped
        is_stopped = report is not None and not report(done)
        return not is_stopped

    (last,) = values_of(march.omega0.reshape(1, *batch, D))
    march.to(transient, report=report_steps if transient and report else None)
    alive, width = march.status.ravel().copy(), max(B * D, 1)
    longest = min(max(PIECE // width, min(STATES, _LARGE // width), 1), end - transient)
    require(8 * (longest + 1) * B * (D + 1), "divide the batch")
    # Of a piece, and the last ones before it.
    states, values = np.empty((longest + 1, *batch, D)), np.empty((longest + 1, B))
    states[0], values[0] = march.final, last
    if transient and n < end and not is_stopped:
        values[0] = values_of(states[:1])[0]
    found: list[_Piece] = [_crossings_in(n, states[:1].reshape(1, B, D), values[:1], changed, None)]
    length = longest if most is None else min(_FIRST, longest)
    while n < end and not is_stopped and (march.status >= 0).any():
        rows = min(length, end - n)
        length = min(2 * length, longest)
        march.to(n + rows, 1, states[n > 0 : rows + 1])  # from 0, it saves state 0 as well
        values[1 : rows + 1] = values_of(states[1 : rows + 1])
        piece = states[: rows + 1].reshape(-1, B, D), values[: rows + 1]
        found.append(_crossings_in(n, *piece, changed, None if most is None else most - counts))
        counts += np.bincount(found[-1][0], minlength=B)
        states[0], values[0] = states[rows], values[rows]
        ended = counts >= (most or np.inf)
        # Kernels leave out trajectories that have failed, so those that have ended.
        march.status.reshape(-1)[ended] = Status.NONFINITE
        n += rows
        report_steps(n)
    return _arrays(march, found, counts, ended, alive), is_stopped


def _crossings_in(
    n: int, states: FloatArray, values: FloatArray, changed: Any, left: NDArray[np.int64] | None
) -> _Piece:
    """Return the crossings among states (rows, B, D) with values (rows, B); the first is state n.

    A value that is not finite makes no crossing, and an orbit has at most `left` (B,) of them.
    """
    B, is_positive, flat = values.shape[1], values >= 0.0, values.ravel()
    if n == 0 and len(values) > 1:  # a start on the surface is on the side to which the orbit goes
        is_positive[0] = np.where(values[0] == 0.0, is_positive[1], is_positive[0])
    # Place k B + i is a change after row k of orbit i.
    places = np.flatnonzero(changed(is_positive[1:], is_positive[:-1]))
    places = places[np.isfinite(flat.take(places)) & np.isfinite(flat.take(places + B))]
    if left is not None:
        i = places % B
        order = np.argsort(i, kind="stable")
        of_orbit, rank = i[order], np.empty_like(i)
        rank[order] = np.arange(len(i)) - np.searchsorted(of_orbit, of_orbit)
        places = places[rank < left[i]]
    k, i = np.divmod(places, B)
    earlier, later = flat.take(places), flat.take(places + B)
    # Halve both where the difference could overflow.
    scale = np.where(np.maximum(abs(earlier), abs(later)) < 2.0**1023, 1.0, 0.5)
    fraction = scale * earlier / (scale * earlier - scale * later)
    rows = states.reshape(-1, states.shape[-1])
    return i, n + k, rows.take(places, axis=0), rows.take(places + B, axis=0), fraction


def _arrays(
    march: March,
    found: list[_Piece],
    counts: NDArray[np.int64],
    ended: NDArray[np.bool_],
    alive: NDArray[np.int8],
) -> dict[str, Any]:
    """Return the arrays of all crossings, by trajectory, and what became of trajectories."""
    columns = [[*parts] for parts in zip(*found, strict=True)]
    found.clear()  # so that the memory of columns is freed on the way
    order = np.argsort(np.concatenate(columns[0]), kind="stable")
    trajectory, n, before, after, fraction = (
        np.concatenate(columns.pop(0))[order] for _ in range(len(columns))
    )
    batch, ends, D = march.problem.batch, np.cumsum(counts), march.omega0.shape[1]
    final, status, failed_at = march.final.copy(), march.status.copy(), march.failed_at.copy()
    final.reshape(-1, D)[ended] = after[ends[ended] - 1]
    status.reshape(-1)[ended] = alive[ended]
    failed_at.reshape(-1)[ended] = -1
    # Of trajectories that ended, report only positive statuses from before their end.
    (first, noted), first_pole = march.noted(), march.first_pole.reshape(-1)
    last = n[np.maximum(ends, 1) - 1] + 1 if len(n) else 0
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
        "time": (n + fraction) * np.broadcast_to(eps, batch).ravel()[trajectory],
        "states": states,
        "surface": np.zeros(len(n), np.int64),
        "n": n,
        "before": before,
        "after": after,
        "fraction": fraction,
        "count": counts.reshape(batch),
        "status": status,
        "failed_at": failed_at,
        "end": np.where(status < 0, failed_at * eps, np.nan),
        "first_pole": first_pole.reshape(batch),
        "final": final,
    }
