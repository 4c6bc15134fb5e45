"""Properties of a right-hand side that its program shows: clocks, kept signs, poles in time."""

import functools
from typing import NamedTuple

from .function_records import RECORDS
from .programs import folded


class Properties(NamedTuple):
    """Properties of the rates of D components, see `RightHandSide`."""

    reads: list
    steady: list
    clocks: list
    of_one_sign: list
    denominators: list


def properties_of(values, rates, D):
    """Return the `Properties` of the `Program` `rates`; add its denominators to `values`."""
    # For each value the components that it depends on, as bits, and the components that make it 0
    # if they are 0.
    of, factors = {i: 1 << i for i in range(D)}, {i: 1 << i for i in range(D)}
    for instruction, number, operands in rates.operations:
        numbers = [0 if isinstance(a, float) else of.get(a, 0) for a in operands]
        of[number] = functools.reduce(int.__or__, numbers, 0)
        factors[number] = _common_factors(instruction, operands, factors, D)
    results = [*enumerate(rates.results)]
    reads = [0 if isinstance(a, float) else of.get(a, 0) for _, a in results]
    steady = [i for i, a in results if values.is_fixed(a) and a != 0.0]
    clocks = [i for i in steady if any(mask >> i & 1 for mask in reads)]
    of_one_sign = [i for i, a in results if not isinstance(a, float) and factors.get(a, 0) >> i & 1]
    of_clocks = sum(1 << i for i in clocks)
    varying = ((number, *of_) for name, number, of_ in rates.operations if name == "fdiv")
    quotients = [q for q in varying if (mask := of.get(q[2], 0)) and not mask & ~of_clocks]
    denominators = _signs_of_poles(values, rates, quotients) if quotients else []
    return Properties(reads, steady, clocks, of_one_sign, denominators)


def _signs_of_poles(values, f, quotients):
    """Return numbers of values that change sign at poles of quotients (number, dividend, divisor).

    Each quotient adds two values to `values`: the divisor if the dividend is positive, else 0; and
    the divisor if the dividend is negative, else 0. So 0 / 0 is no pole. Both are 0 where the
    results of the `Program` f do not depend on the quotient (`_taken`).
    """
    emit, is_taken, signs = values.emit, _taken(values, f), []
    for number, a, b in quotients:
        for pair in ((a, 0.0), (0.0, a)):
            truth = folded(emit, "and", (is_taken.get(number, False), folded(emit, "ogt", pair)))
            signs.append(folded(emit, "select", (truth, b, 0.0)))
    return [*dict.fromkeys(a for a in signs if type(a) is int)]


def _taken(values, f):
    """Return {number of a value: operand of a truth value, true where f depends on the value}.

    f does not depend on a value where `select` chooses another one, or where the other factor of a
    product is 0. Only factors that are a `select`, or depend on parameters alone, are considered.
    True in place of an operand stands for always.
    """
    emit, is_taken = values.emit, {a: True for a in f.results if not isinstance(a, float)}
    for name, number, operands in reversed(f.operations):
        truth = is_taken.get(number, False)
        for k, a in enumerate(operands):
            if isinstance(a, float) or truth is False:
                continue
            condition = True
            if name == "select" and k:
                condition = operands[0] if k == 1 else (~values.number(operands[0])).number
            elif name == "fmul":
                other = operands[1 - k]
                if other in values.fixed or values.of.get(other, ("",))[0] == "select":
                    condition = (~values.number(other).equals(0.0)).number
            both = folded(emit, "and", (truth, condition))
            is_taken[a] = folded(emit, "or", (both, is_taken.get(a, False)))
    return is_taken


def _common_factors(instruction, operands, factors, D):
    """Return, as bits, the components i for which the result of `instruction` is 0 if x_i is 0."""
    everything = (1 << D) - 1
    of = [
        (everything if a == 0.0 else 0) if isinstance(a, float) else factors.get(a, 0)
        for a in operands
    ]
    if instruction == "fmul":
        return of[0] | of[1]
    if instruction in ("fadd", "fsub", "max", "min", "select"):
        return of[-2] & of[-1]
    if instruction in ("fdiv", "fabs"):
        return of[0]
    if instruction == "pow":  # with a power below 1, a solution may leave 0
        return of[0] if isinstance(operands[1], float) and operands[1] >= 1.0 else 0
    record = RECORDS.get(instruction)
    return of[0] if record and record.is_0_at_0 else 0
