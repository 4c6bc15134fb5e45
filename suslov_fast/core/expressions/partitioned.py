"""Right-hand sides with two sets of variables: the rates of each set read only the other set.

Every Hamiltonian T(p) + V(q) has such sets. The graph of the variables that rates read then has two
colours. Variables of constant rate, such as clocks, may be in both sets.

With such sets the columns of an explicit step evaluate f at half as many points (`flow.stormer`).
So f must not change in a layer so thin that the values at the points do not show it. Gaussians and
tanh may have such layers, and so may roots of x**2 + 1e-8 and quotients by it. Polynomials, sin,
cos, exp of affine functions, and quotients and roots of polynomials without a constant do not. The
rates of the first set A are not evaluated near the ends of a step, where a quotient may change
abruptly. So these rates have no quotients and roots.
"""

import functools
from typing import NamedTuple

from .dense_product import ENTRY, is_matrix
from .numpy_evaluation import OF_LISTS
from .programs import needed_for, program_of
from .symbolic_elimination import bits_of
from .tolerances import SMALLEST, WORK_OF_FUNCTION


class ComponentSets(NamedTuple):
    """Two sets A and B of components: rates of A depend on B alone, and rates of B on A alone."""

    A: list
    B: list


@functools.lru_cache(64)
def sets_of(f):
    """Return the `ComponentSets` of a `RightHandSide`, or None if Störmer's rule cannot use any."""
    if f.is_dense or f.hybrid.chooses:  # with branches, columns need Gragg's smoothing
        return None
    moving = [i for i in range(f.D) if f.reads[i]]
    still = sum(1 << i for i in range(f.D) if not f.reads[i])
    colours = _colours({i: [*bits_of(f.reads[i] & ~still)] for i in moving})
    if colours is None:
        return None
    sets = [[i for i in moving if colours[i] == colour] for colour in (False, True)]
    if not all(sets) or (kinds := _kinds(f)) is None:
        return None
    A, B = sorted(sets, key=lambda part: (_has_quotient(f, part, kinds), _work(f, part)))
    if _has_quotient(f, A, kinds):
        return None
    of_A, of_B = (functools.reduce(int.__or__, [f.reads[i] for i in part]) for part in (A, B))
    return ComponentSets(
        sorted([*A, *bits_of(still & of_B)]), sorted([*B, *bits_of(still & (of_A | ~of_B))])
    )


def part_of(program, numbers):
    """Return the `Program` of the results at places `numbers` alone; other results are None."""
    of = {*numbers}
    results = [a if k in of else None for k, a in enumerate(program.results)]
    return program_of(program.operations, results)


def _colours(reads):
    """Return {component: its set, True or False} if rates read the other set alone, else None."""
    beside = {i: [*of] for i, of in reads.items()}
    for i, of in reads.items():
        for j in of:
            beside[j].append(i)
    colours = {}
    for first in beside:
        stack = [(first, colours.get(first, False))]
        while stack:
            i, colour = stack.pop()
            if i not in colours:
                colours[i] = colour
                stack += [(j, not colour) for j in beside[i]]
            elif colours[i] != colour:
                return None
    return colours


def _work(f, components):
    """Return about how many operations the rates of `components` of a `RightHandSide` f take."""
    operations = needed_for(f.rates.operations, [f.rates.results[i] for i in components])
    return sum(WORK_OF_FUNCTION if name in OF_LISTS else 1 for name, *_ in operations)


class _Kind(NamedTuple):
    """The dependence of a value of f on the state; some kinds may change unseen between points."""

    degree: int = 0  # 0 if the value does not depend on the state, 1 if it is affine, else 2
    has_exp: bool = False
    has_quotient: bool = False  # True if the value has a quotient or a root
    is_shifted: bool = False  # a number is added to a function that is not affine


_STILL = _Kind()
_ROOTS = "sqrt", "log", "pow", "hypot"


def _kinds(f):
    """Return {number: `_Kind`} of values of f, or None if f may change unseen between points."""
    kinds = {i: _Kind(1) for i in range(f.D)}
    for name, number, operands in f.rates.operations:
        of = [_STILL if isinstance(a, float) else kinds.get(a, _STILL) for a in operands]
        kind = of[0] if operands[-1] == SMALLEST else _kind_of(name, of)  # the sum changes only 0
        if kind is None:
            return None
        kinds[number] = kind
    return kinds


def _kind_of(name, of):
    """Return the `_Kind` of `name` on operands of the kinds `of`; None if it may change unseen."""
    degree, has_exp, has_quotient, is_shifted = map(max, zip(*of, strict=True))
    bends, divisor = sum(a.degree > 0 for a in of) > 1, of[-1]
    is_quotient = name == "fdiv" and divisor.degree
    is_exp = name == "pow" and divisor.degree  # the exponent depends on the state
    if name == "scale":
        return _STILL
    if degree == 0 or name in ("select", "fabs", ENTRY) or (name == "fdiv" and not is_quotient):
        pass
    elif name in ("fadd", "fsub") or is_matrix(name):
        is_shifted = is_shifted or (degree == 2 and min(a.degree for a in of) == 0)
    elif name == "fmul":
        degree = 2 if bends else degree
    elif name in ("sin", "cos") and not has_exp:
        degree = 2
    elif name in ("exp", "sinh", "cosh") and degree == 1:
        degree, has_exp = 2, True
    elif is_quotient and not (divisor.has_exp or divisor.is_shifted):
        degree, has_quotient, is_shifted = 2, True, False
    elif name in _ROOTS and not (has_exp or is_shifted or is_exp):
        degree, has_quotient = 2, True
    else:
        return None
    return _Kind(degree, has_exp, has_quotient, is_shifted)


def _has_quotient(f, components, kinds):
    results = [f.rates.results[i] for i in components]
    return any(type(a) is int and kinds.get(a, _STILL).has_quotient for a in results)
