"""The errors of a step (`step`), relative to the allowed error in each component.

By default the allowed error is max(rtol |x_next,i|, floor s_i, rtol 2**-60 max_j s_j), where s_i is
the largest |x_i| so far, and `floor` is rtol or less (`floors_of`). The last term is needed because
a component that is reached through m others begins as t**m, and no step has relative digits of it
for m > 10. Columns of derivatives have 2**-20 in place of 2**-60. Clocks, which have constant
rates, have no error. In max_j s_j a clock counts with its change in the step, because time may be
large when all other components are small. With `atol` the allowed error is the larger of
atol_i + rtol max(|x_i|, |x_next,i|) and the rounding of the weighted sum of columns.
"""

from math import sqrt

from ..expressions.tolerances import TINY
from ..expressions.values import larger
from ..llvm.text import Carried
from .codegen import weighted
from .growing_components import alert
from .scalar_kernels import scalar_kernel
from .tolerances import (
    FLOOR_OF_CLOSE_IMPLICIT,
    FLOOR_OF_EXPLICIT,
    FLOOR_OF_IMPLICIT,
    FLOOR_OF_ONE_SIGN,
    ROUNDING_OF_CLOCKS,
    ROUNDING_OF_ENDS,
    RTOL_OF_9,
)

# Inputs that allow larger than relative errors: TINY if `lost` is `growing_components.RELATIVE`.
_OF_OTHERS = {"least", "moved", "noisy", "extra"}


def floors_of(rtol, keeps):
    """Return `floor` of explicit and of implicit steps, relative to the largest value so far.

    A component that keeps its sign (`keeps` is 1), such as a population, has a smaller floor.
    """
    implicit = FLOOR_OF_CLOSE_IMPLICIT * rtol
    if rtol >= RTOL_OF_9:
        implicit = min(rtol, FLOOR_OF_IMPLICIT * sqrt(rtol))
    return min(rtol, FLOOR_OF_ONE_SIGN if keeps else FLOOR_OF_EXPLICIT), implicit


@scalar_kernel
def LARGEST(x, new, largest, counts, top, moved):
    """Update `moved`, the largest change of a clock, and `top`, the largest of it and all sizes."""
    change = (counts > 0.0).select(0.0, abs(new - x))
    size = (counts > 0.0).select(larger(abs(new), largest), change)
    return {"top": larger(size, top), "moved": larger(change, moved)}


@scalar_kernel
def ALLOWED(new, largest, least, moved, extra, rtol, floor):
    """Return `inverse`: 1 / max(extra + max(rtol |new|, floor largest, least), 2**-50 moved)."""
    allowed = extra + larger(larger(rtol * abs(new), floor * largest), least)
    return {"inverse": 1.0 / larger(allowed, ROUNDING_OF_CLOCKS * moved)}


@scalar_kernel
def ALLOWED_WITH_ATOL(x, new, noise, extra, rtol):
    """Return `inverse` = 1 / allowed error, with atol `extra`; `noise` is a result of `_noise`."""
    allowed = larger(extra + rtol * larger(abs(x), abs(new)), ROUNDING_OF_ENDS * noise)
    return {"inverse": 1.0 / larger(allowed, TINY)}


@scalar_kernel
def RATIO(error, inverse, f_new, ratio, total, aside):
    """Update `ratio`, max |error| / allowed error, and `total`, which is finite if f_new is.

    In a step aside of rules that do not interpolate, f_new does not count, because only the end of
    the step is saved.
    """
    own = abs(error) * inverse
    return {
        "ratio": larger(own, ratio),
        "total": total + own + (aside > 0.0).select(0.0, abs(f_new)),
    }


@scalar_kernel
def LARGE(error, inverse, noisy, large):
    """Update `large`, max |error| / allowed error, from errors above `noisy` alone."""
    return {"large": (abs(error) > noisy).select(larger(abs(error) * inverse, large), large)}


@scalar_kernel
def DIFFERENCES(new, f_new, last, f_last, inverse, taken, rates, states):
    """Update `rates` and `states`; their ratio estimates (h |mu|)**2, with an eigenvalue mu of f'.

    These sums compare the next state with `last`, the end of the last column: the difference of f
    with that of the states, both relative to allowed errors.
    """
    of_f, of_states = taken * (f_new - f_last) * inverse, (new - last) * inverse
    return {"rates": rates + of_f * of_f, "states": states + of_states * of_states}


def find_errors(code, sizes):
    """Return maxima and sums over components, by name, that decide about a step.

    They are results of `RATIO` and `LARGE`, `alerts`, `apart`, and sums of the rule.
    `apart` is the largest sum d that shows false steps (`step`), relative to allowed errors. The
    row `inverse` gets 1 / allowed errors. `sizes` is from `find_next_state`.
    """
    text, integrator, work = code.text, code.integrator, code.work
    names = ["ratio", "total", "apart", "alerts", *integrator.rule.sums]
    names += [] if integrator.has_atol else ["large"]
    sums = Carried(**dict.fromkeys(names, 0.0))
    allowed = ALLOWED_WITH_ATOL if integrator.has_atol else ALLOWED
    for (first, count), of_part in zip(integrator.parts, sizes, strict=True):
        for i in text.each(count, sums):
            i, inputs = i + first, dict(of_part)
            floor = code.component(integrator.rule.floor, i) if first == 0 else code.number("rtol")
            inputs["floor"] = floor
            if integrator.has_atol:
                inputs |= {"noise": _noise(code, i), "extra": code.component("extra", i)}
            if integrator.is_relative:
                is_own = code.line.lost[i] < 0.0
                for name in filter(_OF_OTHERS.__contains__, inputs):
                    inputs[name] = is_own.select(TINY, inputs[name])
                inputs["floor"] = is_own.select(code.number("rtol"), inputs["floor"])
            inverse = code.apply(allowed, i, **inputs)["inverse"]
            aside = 0.0 if integrator.rule.interpolates else work.aside[0]
            found = code.apply(RATIO, i, inverse=inverse, aside=aside, **vars(sums))
            if first == 0:
                found["alerts"] = alert(code, i).select(1.0, sums.alerts)
            if not integrator.has_atol:
                own_sums = {"inverse": inverse, "large": sums.large, "noisy": inputs["noisy"]}
                found |= code.apply(LARGE, i, **own_sums)
            sums.update(found | integrator.rule.add_errors(code, i, sums, inverse))
            work.inverse[i] = inverse
    return vars(sums)


def _noise(code, i):
    """Return sum_c |w_c (y_c - x)| of component i, for rounding errors."""
    ends = code.of_columns(code.work.ends, i)
    return weighted([abs(w) for w in code.integrator.rule.weights], [abs(end) for end in ends])
