"""Times to the surfaces that the motion crosses, by Newton's method from the end of a step.

A surface with the value s and the rate s' = grad s . f is crossed a time -s / s' later if it lies
ahead, and was crossed a time s / s' ago if the state is beyond it. Rates at the ends of implicit
steps contain fast modes. So after these steps times are estimated only for surfaces of events, and
for surfaces that depend on clocks alone.
"""

from math import inf

from ..expressions.derivative import gradients_along
from ..expressions.programs import Expressions, emitted, program_of
from ..expressions.rounding import sizes_of
from ..expressions.values import larger, operand_of, smaller
from .event_formulas import GAP
from .tolerances import NOISE_OF_SURFACE, SOONER


def aim_of(f, watched, events, surfaces, is_implicit):
    """Return the `Program` that finds when `surfaces` of f and of its events are crossed.

    The program reads the state, f times the sign of time, side and level (both in rows `side` of
    `flow.memory`) for each surface of an event, and the table of f. Its results are

    1. the least time to a surface, negative if the state is just beyond it,
    2. the longest time since a crossing: 0 without a crossing, infinity if the rate s' leads back
       or is not used (after an implicit step, see above),
    3. the least time to a surface of an event, times SOONER if rounding makes s uncertain
    (`NOISE_OF_SURFACE`).
    """
    D, of_changes = f.D, events.surface_count if events else 0
    first = 2 * (D + of_changes)
    count = first + len(f.table)
    values = Expressions(count, range(D, count))
    new = {i: i for i in range(D)} | {a: first + place for a, place in f.places.items()}
    results = emitted(values, watched, new)
    slopes, v = gradients_along(values, results, D, {j: D + j for j in range(D)})
    sizes = sizes_of(values, watched.operations, new)
    aim, since, left_of_events, number = inf, 0.0, inf, values.number
    for surface, old, a, row in zip(surfaces, watched.results, results, slopes, strict=True):
        s, rate, is_event = number(a), 0.0, surface.kind == "event"
        has_rate = is_event or not is_implicit or {*row} <= {*f.steady}
        for j, slope in row.items() if has_rate else ():
            rate = rate + number(slope) * number(v.get(j, 0.0))
        if is_event:
            above, level = (number(2 * (D + surface.number) + k) for k in (0, 1))
            ends = [(s - level, above > 0.5)]
        elif interval := surface.interval(number, new):
            low, high = interval
            truth = low.equals(low)
            ends = [(s - low, truth), (s - high, truth ^ truth)]
        else:
            ends = [(s, number(new[surface.number]) > 0.5)]
        for value, is_above in ends:
            is_beyond = (value >= 0.0) ^ is_above
            if is_event and events.gaps[surface.number]:  # s may lack a value: no crossing there
                was_known, is_known = ~above.equals(GAP), value.equals(value)
                since = (was_known ^ is_known).select(inf, since)
                is_beyond, rate = is_beyond & was_known & is_known, was_known.select(rate, 0.0)
            if not has_rate:
                since = is_beyond.select(inf, since)
                continue
            leads = is_above.select(-rate, rate) > 0.0
            left = value / -rate
            aim = smaller(leads.select(left, inf), aim)
            if is_event:
                left = (abs(value) <= NOISE_OF_SURFACE * sizes[old]).select(SOONER * left, left)
                left_of_events = smaller(leads.select(left, inf), left_of_events)
            since = is_beyond.select(larger(since, leads.select(-left, inf)), since)
    return program_of(values.operations, [*map(operand_of, (aim, since, left_of_events))])
