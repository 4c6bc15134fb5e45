"""Degrees of iterates and their growth."""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Iterator, Sequence
from functools import reduce
from itertools import islice
from typing import Any, NamedTuple

import flint
import numpy as np

from .._checks import instance, integer, wrong
from .._docs import filled
from ._exact import confirmed
from ._maps import Arithmetic, KahanMap, evaluate


@filled
def degrees(map: KahanMap, n: int, *, seed: int = 0) -> list[int]:
    """Degrees of the first n iterates of a map, as maps of projective space.

    The degree is the largest of the numerators and the common denominator, after cancelling common
    factors. It is computed on random lines, modulo primes, until two of them agree.

    Parameters
    ----------
    %(map)s
    n : int
        Number of iterates.
    %(seed)s

    Returns
    -------
    list of int
        Degrees of the iterates 1, ..., n.

    Raises
    ------
    %(invalid)s
    ArithmeticError
        If every line runs into points without an image.

    Examples
    --------
    >>> from suslov_fast import QuadraticField, Suslov3D
    >>> from suslov_fast.integrability import degrees, kahan
    >>> degrees(kahan(QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25)), 0.25), 8)
    [2, 4, 6, 8, 10, 12, 14, 16]
    """
    instance("map", map, KahanMap)
    n, rng = integer("n", n, 0), random.Random(seed)
    return list(confirmed(rng, lambda p: list(islice(_degrees_on_a_line(map, p, rng), n))))


def _degrees_on_a_line(map: KahanMap, p: int, rng: random.Random) -> Iterator[int]:
    forms = Arithmetic(map, p).forward
    line = [[rng.randrange(p), rng.randrange(p)] for _ in range(map.dimension)]
    x = [flint.nmod_poly(each, p) for each in ([1], *line)]
    while True:
        x = _cramer(evaluate(forms, x))
        common = reduce(lambda a, b: a.gcd(b), x)
        x = [each // common for each in x]
        yield max(each.degree() for each in x)


def _cramer(system: list[list[Any]]) -> list[Any]:
    """Return det A and the numerators of the solution of (A | b), without fractions (Bareiss)."""
    n, previous = len(system), 1
    for k in range(n):
        pivot = next((i for i in range(k, n) if system[i][k] != 0), None)
        if pivot is None:
            raise ZeroDivisionError
        system[k], system[pivot] = system[pivot], system[k]
        top = system[k]
        for row in system[:k] + system[k + 1 :]:
            for j in range(k + 1, n + 1):
                row[j] = (top[k] * row[j] - row[k] * top[j]) // previous
        previous = top[k]
    return [previous, *(row[n] for row in system)]


class Growth(NamedTuple):
    """Growth of a sequence of degrees, as `growth` returns it."""

    kind: str  # "bounded", "linear", "quadratic", "exponential" or "unclear"
    entropy: float  # the log of the limit of d_(k+1) / d_k
    based_on: str  # the recurrence or fit from which kind and entropy follow


@filled
def growth(degrees: Sequence[int]) -> Growth:
    """Growth of a sequence of degrees, and its entropy.

    If all degrees satisfy a linear recurrence with integer coefficients, and there are at least two
    more of them than are needed to find it, the result follows from its characteristic polynomial:
    it is exact if the recurrence continues to hold. Otherwise it is a fit to the last half.

    Parameters
    ----------
    degrees : sequence of int
        Degrees of consecutive iterates, as `degrees` returns them.

    Returns
    -------
    Growth
        A named tuple `kind, entropy, based_on`. kind may also be "cubic", "polynomial of degree 4"
        and so on; it is "unclear", and the entropy NaN, if the sequence is too short to tell.

    %(Raises: invalid)s

    Examples
    --------
    >>> from suslov_fast.integrability import growth
    >>> growth([2, 4, 6, 8, 10, 12])
    Growth(kind='linear', entropy=0.0, based_on='d(k+2) = 2 d(k+1) - 1 d(k), all 6 degrees')
    >>> kind, entropy, _ = growth([2, 3, 5, 8, 13, 21])
    >>> kind, round(entropy, 6)  # the log of the golden ratio
    ('exponential', 0.481212)
    """
    instance("degrees", degrees, Iterable)
    d = []
    for each in degrees:
        instance("degrees", each, (int, np.integer))
        if each < 0:
            raise wrong("degrees", "integers of at least 0", each)
        d.append(int(each))
    half = len(d) // 2
    power, rate = 0, 0.0
    if recurrence := _recurrence(d):
        *c, _ = recurrence.coeffs()
        terms = [f"{-a} d(k+{i})" for i, a in reversed([*enumerate(c)]) if a]
        what = f"d(k+{len(c)}) = {' + '.join(terms) or 0}, all {len(d)} degrees"
        what = what.replace("+ -", "- ").replace("k+0", "k")
        for factor, multiplicity in recurrence.factor()[1]:
            if factor.is_cyclotomic():
                power = max(power, multiplicity - 1)
            else:
                sizes = [abs(complex(root)) for root, _ in factor.complex_roots()]
                rate = max(rate, math.log(max(1.0, *sizes)))
    elif len(d) < 6 or min(d) == 0:
        return Growth("unclear", math.nan, f"{len(d)} degrees without a short recurrence")
    else:
        what = f"a fit to the last {len(d) - half} of {len(d)} degrees, without a short recurrence"
        if max(d[half:]) > max(d[:half]):
            k, logs = np.arange(half + 1, len(d) + 1), np.log(d[half:])
            (exponent, _), [of_power], *_ = np.polyfit(np.log(k), logs, 1, full=True)
            (slope, _), [of_rate], *_ = np.polyfit(k, logs, 1, full=True)
            power, rate = max(round(exponent), 1), float(slope) if of_rate < of_power else 0.0
    if rate > 0:
        return Growth("exponential", rate, what)
    kinds = dict(enumerate(("bounded", "linear", "quadratic", "cubic")))
    return Growth(kinds.get(power, f"polynomial of degree {power}"), 0.0, what)


def _recurrence(d: list[int]) -> Any:
    """Return the characteristic polynomial of the shortest recurrence; None if none is certain."""
    for order in range(len(d) // 2):
        hankel = flint.fmpz_mat([d[i : i + order + 1] for i in range(len(d) - order)])
        reduced, _ = flint.fmpq_mat(hankel).rref()
        coefficients = [-reduced[i, order] for i in range(order)]
        # Every infinite sequence of integers with a recurrence has one of integers.
        if all(a.q == 1 for a in coefficients):
            c = flint.fmpz_poly([*(a.p for a in coefficients), 1])
            if not any((hankel * flint.fmpz_mat(order + 1, 1, c.coeffs())).entries()):
                return c
    return None
