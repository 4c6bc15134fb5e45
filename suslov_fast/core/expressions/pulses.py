"""The longest step of a right-hand side with narrow periodic pulses.

Between the pulses of a function such as sin(t)**1000, f is constant, so a long step may miss pulses
and yet have no estimated error. Powers sin(a)**d, products of d waves sin(a), and functions such as
exp and tanh of d cos(a) have pulses at least as wide as the Gaussian exp(-d a**2 / 2). The width in
time is d**-1/2 / a', with the rate a' of the phase. A step is at most REACH_OF_PULSE widths long;
then two neighbouring points at which f is evaluated are less than five widths apart.
"""

from math import inf
from typing import NamedTuple

from .function_records import RECORDS
from .tolerances import NARROW_PULSE, REACH_OF_PULSE
from .values import Number, larger, smaller

_NARROWING = {name for name, record in RECORDS.items() if record.narrows}
_LINEAR, _PLAIN = ("fadd", "fsub", "fmul", "fdiv"), ("fabs", "max", "min", "select", "sqrt")


class _Wave(NamedTuple):
    """Bounds for a function of waves sin(a) and cos(a), or for a function that is linear in clocks.

    size  bound of the modulus of the function, or of the rate of a linear function
    rate  bound of a'**2 of the fastest wave; None for a linear function
    d     bound of d, with pulses at least as wide as exp(-d a**2 / 2); None for a linear function
    """

    size: Number
    rate: Number | None = None
    d: Number | None = None


def longest_step(values, f, steady):
    """Return the operand of the longest step that misses no pulse of f; infinity without pulses.

    The operand depends on parameters alone, and is added to the `Expressions` `values`. f is a
    `Program`, and `steady` are its components of constant rates.
    """
    number, longest = values.number, values.number(inf)
    known = {i: _Wave(abs(number(f.results[i]))) for i in steady}
    for name, result, operands in f.operations:
        of = operands[1:] if name == "select" else operands
        varying = [a for a in of if not values.is_fixed(a)]
        waves, others = [known.get(a) for a in varying], [a for a in of if values.is_fixed(a)]
        is_exponent = name == "pow" and varying == [*of[1:]]
        has_rule = name not in ("fdiv", "pow") or is_exponent or varying == [of[0]]
        if not waves or None in waves or not has_rule:
            continue
        (size, rate, d), is_sum, more = waves[0], name != "fmul", waves[1:]
        if more:
            size = size + more[0].size if is_sum else size * more[0].size
        elif name in ("fmul", "fdiv"):
            size = size.then(name, abs(number(others[0])))
        if all(wave.d is None for wave in waves):
            if name in ("sin", "cos"):
                known[result] = _Wave(number(1.0), size * size, number(1.0))
            elif name in _LINEAR and (is_sum or not more):
                known[result] = _Wave(size)
            continue
        if any(wave.d is None for wave in waves):
            continue
        if more:
            rate = larger(rate, more[0].rate)
            d = larger(d, more[0].d) if is_sum else d + more[0].d
        if is_exponent:  # c**a = exp(a log(c))
            size = size * abs(number(others[0]).then("log"))
        if name in _NARROWING or is_exponent:
            d = d * larger(size, 1.0)
        elif name == "pow":
            d = d * larger(abs(number(others[0])), 1.0)
        elif name not in _LINEAR + _PLAIN:
            continue
        known[result] = _Wave(size, rate, d)
        if not (isinstance(d.number, float) and d.number <= NARROW_PULSE):
            own = (d > NARROW_PULSE).select(REACH_OF_PULSE / (rate * d).sqrt(), inf)
            longest = smaller(own, longest)
    return longest.number
