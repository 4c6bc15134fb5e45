"""Warnings of times that may be meant otherwise, of motions that end, and of lost components."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .. import checks
from ..checks import FloatArray, first_index, spell
from ..core.flow.batch_solver import SolverRequest
from ..core.flow.tolerances import MOST_TRIES
from ..fields.constraints import constraints_of
from ..status import IntegrationWarning, Status
from .event import Event
from .integration import FELL, SolverResult

# By status, the verb of a sentence about solutions that stop before the last time.
CAUSES = {
    Status.ENDED: (
        "end: they escape to infinity, reach a pole, or f, a derivative that is asked for or the "
        "new state of an event has no value there"
    ),
    Status.SLIDING: (
        "slide along conditions y = 0 of f, or cross them ever faster, as with twisting and "
        "super-twisting controllers, and f does not tell how they go on (smooth them by "
        "np.tanh(y/width) for np.sign(y), or use two thresholds)"
    ),
    Status.TOO_MANY_STEPS: (
        f"do not move on: {MOST_TRIES:,} steps, actions and records of events take them less than "
        "a thousandth of the last time further (f turns ever faster, or an action leads back to "
        "its surface)"
    ),
    Status.ACCUMULATES: (
        "have events that follow one another without end, and are no bounces of a body that comes "
        "to rest (Event(..., most=n) ends them before)"
    ),
    Status.NONFINITE: "have no value: f is NaN or infinite, as 0/0 and log of a negative number",
}


def warn_of_times(field: Any, x: FloatArray, request: SolverRequest, t0: Any = None) -> None:
    """Warn if times may count from t = 0, not from x0, or miss a table of values over time."""
    times = request.times
    if len(times) > 1 and times[0] != 0.0 and len(x):
        _warn_of_first_time(field, x, float(times[0]), t0)
    if request.sign > 0 and field._tables_of_time:
        _warn_of_tables(field, x, times.max(initial=0.0))


def _warn_of_first_time(field: Any, x: FloatArray, first: float, t0: Any) -> None:
    """Warn if the first time may be the time at x0."""
    for clock in field._clocks:
        name = field._layout.components[clock]
        if t0 is None and clock == field._layout.clock:
            checks.warn(
                f"times count from x0, where t is 0: if x0 is the state at t = {first:g}, pass "
                f"t0={first:g}, and time - {first:g}; else t0=0"
            )
        elif (x[:, clock] == first).all():
            checks.warn(
                f"times count from x0, where {name} is {first:g}: pass time - {first:g} if these "
                f"are values of {name}"
            )


def _warn_of_tables(field: Any, x: FloatArray, last: float) -> None:
    """Warn if times from x0 to `last` are all before or after a table of values over time."""
    for clock, first, end in field._tables_of_time:
        t, name = x[:, clock], field._layout.components[clock]
        if len(t) and ((t >= end).all() or (t + last <= first).all()):
            low, high = t.min(), t.max() + last
            start = "t0" if clock == field._layout.clock else f"{name} in x0"
            checks.warn(
                f"np.interp: its table is from {first:g} to {end:g}, and {name} from {low:g} to "
                f"{high:g}, where it is constant: {start} is the time in the table"
            )


def warn_of_event_times(events: tuple[Event, ...], request: SolverRequest) -> None:
    """Warn of events at given times, all of which are outside the times asked of a motion."""
    sign, asked = request.sign, request.times
    for k, event in enumerate(events):
        if event.times is None or not len(asked):
            continue
        last, times = abs(asked).max(), event.times[np.isfinite(event.times)]
        if times.size and not ((sign * times >= 0.0) & (abs(times) <= last)).any():
            checks.warn(
                f"events: number {k} never acts: its times, {times.min():g} to {times.max():g}, "
                f"count from x0, as times of the motion do, which ends at {sign * last:g}"
            )


def warn_of_ends(
    result: SolverResult,
    x: FloatArray,
    batch: tuple[int, ...],
    atol: Any = None,
    causes: Mapping[Status, str] = CAUSES,
) -> None:
    """Warn once of all solutions that stop before the last time, except starts at NaN."""
    t, statuses = result.all_ends.t, result.all_ends.status
    # Where a closed form gives no state, t is NaN, and a warning was given before.
    texts, exists = [], ~(np.isnan(x[:, 0]) | np.isnan(t))
    for status, text in causes.items():
        ends = exists & (statuses == int(status))
        if not ends.any() or (status == Status.TOO_MANY_STEPS and result.is_stopped):
            continue
        first = int(np.argmax(ends))
        index = spell(first_index(ends.reshape(batch)))
        count = f"{np.count_nonzero(ends)} of {ends.size} solutions"
        if status == Status.ENDED and atol is not None and not np.any(atol):
            text += (
                " (f may lack the digits for atol=0 where a component passes 0: write exp(x) - 1 "
                "as np.expm1(x), or omit atol)"
            )
        texts.append(f"{count} {text}, first: trajectory {index} at t = {t[first]:.9g}")
    if texts:
        checks.warn("; ".join(texts), IntegrationWarning)


def causes_of(system: Any) -> Mapping[Status, str]:
    """Return `CAUSES` for motions of a system."""
    if constraints_of(system) is None:
        return CAUSES
    more = ", as one with coordinates off the constraints; or constraints become dependent there"
    return CAUSES | {Status.ENDED: CAUSES[Status.ENDED] + more}


def warn_of_lost_components(system: Any, result: SolverResult, batch: tuple[int, ...]) -> None:
    """Warn once of solutions with a component that has lost its digits, and would grow again.

    A solution that ends where constraints become dependent may have a coordinate that tends to 0.
    """
    doubtful = result.all_ends.doubtful
    if constraints_of(system) is not None:
        doubtful = np.where(result.all_ends.status == int(Status.ENDED), 0, doubtful)
    if not np.count_nonzero(doubtful):
        return
    index = spell(first_index(doubtful.reshape(batch) != 0))
    fell = "fell below 1e-300, where numbers lose their digits, and would grow again"
    ends = "lost its digits and grows again, and they end sooner if it has its digits"
    why, how = (fell, "solve for its logarithm") if FELL in doubtful else (ends, "compare two rtol")
    checks.warn(
        f"{np.count_nonzero(doubtful)} of {doubtful.size} solutions have a component that {why} "
        f"(first: trajectory {index}): {how}"
    )
