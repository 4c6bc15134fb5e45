"""The longest step of a right-hand side with narrow periodic pulses.

Between pulses, as those of sin(t)**1000, f is constant, so that all columns of a long step agree,
and may miss them. A wave sin(a) with the rate a' has pulses about as wide as a Gaussian exp(-d a**2
/ 2): sin(a)**d, a product of d waves, and exp(d cos(a)) have d pulses, and the width is d**-1/2 /
a'. A step is at most REACH widths, so that no four lie between two of its sub-steps.
"""

from math import inf
from typing import NamedTuple

from .values import Number, larger, smaller

REACH, NARROW = 24.0, 16.0  # pulses of d up to NARROW are wide enough for steps to see them
_PLAIN = "fadd", "fsub", "fmul", "fdiv", "fabs", "max", "min", "select", "sqrt"


class _Wave(NamedTuple):
    """A function of waves, made of `Number`s: the fastest a'**2, d, and its amplitude."""

    rate: Number
    d: Number
    size: Number


def longest_step(values, f, steady):
    """Return the operand of the longest step of a `Program` f, in the `Expressions` `values`.

    `steady` are the components of constant rates. The operand is inf, or depends on parameters.
    """
    number, is_fixed = values.number, values.is_fixed
    rates, waves, longest = {i: number(f.results[i]) for i in steady}, {}, number(inf)
    for name, result, operands in f.operations:
        of = operands[1:] if name == "select" else operands
        varying = [a for a in of if not is_fixed(a)]
        factors = [number(a) for a in of if is_fixed(a)]
        if all(a in rates for a in varying):
            if name in ("fadd", "fsub"):
                a, b = (number(0.0) if is_fixed(a) else rates[a] for a in of)
                rates[result] = a.then(name, b)
            elif name == "fmul" or (name == "fdiv" and varying == [of[0]]):
                if len(varying) == 1:
                    rates[result] = rates[varying[0]].then(name, *factors)
            elif name in ("sin", "cos"):
                rate = rates[varying[0]]
                waves[result] = _Wave(rate * rate, number(1.0), number(1.0))
            continue
        own = [waves[a] for a in varying if a in waves]
        if len(own) < len(varying):
            continue
        rate, d, size = own[0]
        if len(own) > 1:
            b = own[1]
            rate = larger(rate, b.rate)
            is_product = name == "fmul"
            d = d + b.d if is_product else larger(d, b.d)
            size = size * b.size if is_product else size + b.size
        elif name in ("fmul", "fdiv"):
            size = size.then(name, abs(factors[0]))
        if name == "exp":
            d = d * larger(size, 1.0)
        elif name == "pow" and varying == [of[0]]:
            d = d * larger(abs(factors[0]), 1.0)
        elif name not in _PLAIN or (name == "fdiv" and varying != [of[0]]):
            continue
        waves[result] = _Wave(rate, d, size)
        if not (isinstance(d.number, float) and d.number <= NARROW):
            own = REACH / (rate * d).sqrt()
            longest = smaller((d > NARROW).select(own, inf), longest)
    return longest.number
