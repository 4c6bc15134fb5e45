"""The errors of a step, beside what is allowed in each component.

A step has the estimated error e_i in component i. It is taken if

ratio = max_i e_i / allowed_i <= 1,

if f has a value at the next state, and if no component changes a sign that the motion keeps. By
default the allowed error is rtol max(s_i, 2**-60 max_j s_j), where s_i is the largest |x_i| so far:
a component that is reached through m others begins as t**m, and no step has relative digits of it
for m > 10. For columns of derivatives it is 2**-20. Clocks, which have constant rates, have no
error, and count there with their change in the step, because time may be large where all others are
small. With `atol` it is atol_i + rtol max(|x_i|, |x_next,i|), or what rounding leaves of the
weighted sum of columns, if that is more.
"""

from ..expressions.values import larger
from ..llvm.text import Carried
from .codegen import weighted
from .growing_components import FALLEN
from .scalar_kernels import TINY, rule
from .stormer import is_rough

# OF_CLOCK: a drive that begins at rest is noise at first, differences of numbers near 1.
SMALLEST, SMALLEST_OF_COLUMNS, OF_ROUNDING, OF_CLOCK = 2.0**-60, 2.0**-20, 2.0**-52, 2.0**-50
# An error may be noise if it is less than NOISY of the largest component.
NOISY = 2.0**-48
CAUTION = 4.0  # see `stormer`: factor of its estimate of the error


@rule
def NO_SIZE():
    """With `atol` no component depends on others."""
    return {}


@rule
def LARGEST(new, largest, top):
    """The largest modulus of all components."""
    return {"top": larger(larger(abs(new), largest), top)}


@rule
def LARGEST_WITH_CLOCKS(x, new, largest, counts, top, moved):
    """`LARGEST` with clocks, which count with their change in the step."""
    change = (counts > 0.0).select(0.0, abs(new - x))
    size = (counts > 0.0).select(larger(abs(new), largest), change)
    return {"top": larger(size, top), "moved": larger(change, moved)}


@rule
def LEAST_ALLOWED(top, rtol, smallest):
    """The error allowed where other components are large, and the size below which one is noise."""
    return {"least": larger(rtol * (smallest * top), TINY), "noisy": NOISY * top}


@rule
def ALLOWED(new, largest, least, rtol):
    """The inverse of the allowed error of a component."""
    return {"inverse": 1.0 / larger(rtol * larger(abs(new), largest), least)}


@rule
def ALLOWED_WITH_CLOCKS(new, largest, least, moved, extra, rtol):
    allowed = extra + larger(rtol * larger(abs(new), largest), least)
    return {"inverse": 1.0 / larger(allowed, OF_CLOCK * moved)}


@rule
def ALLOWED_WITH_ATOL(x, new, noise, extra, rtol):
    allowed = larger(extra + rtol * larger(abs(x), abs(new)), OF_ROUNDING * noise)
    return {"inverse": 1.0 / larger(allowed, TINY)}


@rule
def RATIO(error, inverse, f_new, ratio, total):
    """The largest error by what is allowed, and a sum that shows what is not finite."""
    own = abs(error) * inverse
    return {"ratio": larger(own, ratio), "total": total + own + abs(f_new)}


@rule
def LARGER_RATIO(error, inverse, ratio):
    return {"ratio": larger(abs(error) * inverse, ratio)}


@rule
def LARGE(error, inverse, noisy, large):
    """The largest of these ratios whose error is more than rounding of the largest component."""
    return {"large": (abs(error) > noisy).select(larger(abs(error) * inverse, large), large)}


@rule
def DIFFERENCES(new, f_new, last, f_last, inverse, taken, rates, states):
    """The squared differences of h f and of states, between the next state and the last column."""
    of_f, of_states = taken * (f_new - f_last) * inverse, (new - last) * inverse
    return {"rates": rates + of_f * of_f, "states": states + of_states * of_states}


def find_errors(lines, own, sizes):
    """Return sums over components: the largest ratio of an error by what is allowed, and others.

    The inverse of what is allowed takes the place of the error.
    """
    text, half, work = lines.text, lines.half, lines.work
    names = ["ratio", "total", "apart", "fallen"] + (
        [] if half.is_implicit else ["rates", "states"]
    )
    names += [] if half.has_atol else ["large"]
    sums, taken = Carried(**dict.fromkeys(names, 0.0)), work.taken[0]
    for (first, count), of_part in zip(half.parts, sizes, strict=True):
        for i in text.each(count, sums):
            i, inputs = i + first, dict(of_part)
            if half.has_atol:
                inputs["noise"] = _noise(lines, own, i)
            inverse = lines.apply(half.allowed, i, **inputs)["inverse"]
            found = lines.apply(RATIO, i, inverse=inverse, **vars(sums))
            if first == 0:
                found |= lines.apply(FALLEN, i, inverse=inverse, fallen=sums.fallen)
            if not half.has_atol:
                own_sums = {"inverse": inverse, "large": sums.large, "noisy": of_part["noisy"]}
                found |= lines.apply(LARGE, i, **own_sums)
            if not (half.is_implicit or half.sets):
                inputs = {"last": work.a[i], "inverse": inverse, "taken": taken}
                found |= lines.apply(DIFFERENCES, i, **vars(sums) | inputs)
            if not half.sets:
                inputs = {"error": apart_in(lines, own, i), "inverse": inverse, "ratio": sums.apart}
                found["apart"] = lines.apply(LARGER_RATIO, **inputs)["ratio"]
            sums.update(found)
            work.error[i] = inverse
    return vars(sums)


def apart_in(lines, own, i):
    """Return what shows in component i that all columns agree on a false end."""
    if lines.half.is_implicit:
        return lines.work.right[i]
    apart = weighted(own, lines.of_columns(lines.work.apart, i))
    if lines.half.sets:
        return is_rough(lines.work, lines.half).select(apart, 0.0)
    return apart


def _noise(lines, own, i):
    """Return the sum of moduli of what is added up for the next state."""
    ends = lines.of_columns(lines.work.ends, i)
    return weighted([abs(factor) for factor in own], [abs(end) for end in ends])


def apart_of_rough(lines, own):
    """Return what `find_errors` has of `apart`, after it, of rough lanes, which alone have that."""
    text, work = lines.text, lines.work

    def largest():
        found = Carried(ratio=0.0)
        for i in text.each(lines.D, found):
            inputs = {"error": apart_in(lines, own, i), "inverse": work.error[i]}
            found.update(lines.apply(LARGER_RATIO, **inputs, **vars(found)))
        return [found.ratio]

    is_smooth = ~is_rough(work, lines.half).any()
    (found,) = text.otherwise(is_smooth, [0.0], largest)
    return found


def differences_of_sets(lines):
    """Return products of the sums of `DIFFERENCES` of both sets, and the limit for their quotient.

    That does not depend on how large components of either are allowed to be.
    """
    text, work, sums = lines.text, lines.work, []
    for components in lines.half.sets:
        own = Carried(rates=0.0, states=0.0)
        for i in text.listed(components)(own):
            inputs = {"last": work.a[i], "inverse": work.error[i], "taken": work.taken[0]}
            own.update(lines.apply(DIFFERENCES, i, **vars(own) | inputs))
        sums.append(own)
    A, B = sums
    limit = lines.number("limit")
    return {"rates": A.rates * B.rates, "states": A.states * B.states, "limit": limit * limit}
