"""Degrees of iterates and their growth."""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Iterator, Sequence
from functools import reduce
from itertools import islice, product
from typing import Any, NamedTuple

import flint
import numpy as np

from .._checks import instance, integer, wrong
from .._docs import filled
from ._exact import confirmed
from ._maps import KahanMap, check_map, image_by_minors, random_line


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
    check_map(map)
    n, rng = integer("n", n, 0), random.Random(seed)
    return list(confirmed(rng, lambda p: list(islice(degrees_on_a_line(map, p, rng), n))))


def degrees_on_a_line(map: KahanMap, p: int, rng: random.Random) -> Iterator[int]:
    line = random_line(map, p, rng)
    while True:
        image = image_by_minors(map, line)
        common = reduce(lambda a, b: a.gcd(b), image)
        line = [each // common for each in image]
        yield max(each.degree() for each in line)


class Growth(NamedTuple):
    """Growth of a sequence of degrees, as `growth` returns it."""

    kind: str  # "bounded", "linear", "quadratic", "cubic", "exponential" or "unclear"
    entropy: float  # the log of the limit of d_(k+1) / d_k
    entropy_error: float  # 0 if a recurrence holds, else the spread of the fit
    based_on: str  # the recurrence or fit from which kind and entropy follow


_SPARE = 3  # degrees more than determine a recurrence
_PERIODS = 6  # longest period of the coefficients of a quasi-polynomial


@filled
def growth(degrees: Sequence[int]) -> Growth:
    """Growth of a sequence of degrees, and its entropy.

    If all degrees satisfy a linear recurrence with integer coefficients, and there are at least
    three more of them than are needed to find it, the result follows from its characteristic
    polynomial: it is exact if the recurrence continues to hold. Otherwise it is a fit to the last
    degrees.

    Parameters
    ----------
    degrees : sequence of int
        Degrees of consecutive iterates, as `degrees` returns them.

    Returns
    -------
    Growth
        A named tuple `kind, entropy, entropy_error, based_on`. kind may also be "polynomial of
        degree 4" and so on. If the sequence is too short, or no model fits, kind is "unclear" and
        the entropy NaN.

    %(Raises: invalid)s

    Examples
    --------
    >>> from suslov_fast.integrability import growth
    >>> growth([2, 4, 6, 8, 10, 12]).based_on
    'd(k+2) = 2 d(k+1) - 1 d(k), all 6 degrees'
    >>> kind, entropy, error, _ = growth([2, 3, 5, 8, 13, 21, 34])
    >>> kind, round(entropy, 6), error  # the log of the golden ratio
    ('exponential', 0.481212, 0.0)
    >>> growth([1, 5, 2, 7, 9, 1, 1, 1]).kind
    'unclear'
    """
    if not isinstance(degrees, Iterable):
        expected = "integers, as degrees(kahan(field, eps), n) returns them"
        raise wrong("degrees", expected, type(degrees).__name__, TypeError)
    d = []
    for each in degrees:
        instance("degrees", each, (int, np.integer))
        if each < 0:
            raise wrong("degrees", "integers of at least 0", each)
        d.append(int(each))
    recurrence = _recurrence(d)
    return _by_fit(d) if recurrence is None else _by_recurrence(recurrence, len(d))


def _kind(power: int) -> str:
    kinds = dict(enumerate(("bounded", "linear", "quadratic", "cubic")))
    return kinds.get(power, f"polynomial of degree {power}")


def _by_recurrence(recurrence: Any, count: int) -> Growth:
    *c, _ = recurrence.coeffs()
    terms = [f"{-a} d(k+{i})" for i, a in reversed([*enumerate(c)]) if a]
    what = f"d(k+{len(c)}) = {' + '.join(terms) or 0}, all {count} degrees"
    what = what.replace("+ -", "- ").replace("k+0", "k")
    power, rate = 0, 0.0
    for factor, multiplicity in recurrence.factor()[1]:
        if factor.is_cyclotomic():
            power = max(power, multiplicity - 1)
        else:
            sizes = [abs(complex(root)) for root, _ in factor.complex_roots()]
            rate = max(rate, math.log(max(1.0, *sizes)))
    return Growth("exponential" if rate > 0 else _kind(power), rate, 0.0, what)


def _by_fit(d: list[int]) -> Growth:
    n, what = len(d), f"{len(d)} degrees without a short recurrence"
    unclear = Growth("unclear", math.nan, math.nan, what)
    if n < 6 or min(d) == 0:
        return unclear
    last = max(4, n // 2)
    what = f"a fit to the last {last} of {n} degrees, without a short recurrence"
    rates = np.diff(np.log(d[-last:]))
    rate, spread = float(rates.mean()), float(np.ptp(rates))
    # The slope of a long line looks the same, but does not double.
    if spread < 0.1 * rate and d[-1] >= 2 * d[-last]:
        return Growth("exponential", rate, spread, what)
    what = f"a fit to all {n} degrees, without a short recurrence"
    k, extent = np.arange(n), max(d) - min(d)
    for power in range(1, min(4, n - _SPARE)):
        residuals = np.polyval(np.polyfit(k, d, power), k) - d
        if abs(residuals).max() < max(0.5, 0.01 * extent) < 0.1 * extent:
            return Growth(_kind(power), 0.0, float(rates[-1]), what)
    return unclear


def _recurrence(d: list[int]) -> Any:
    """Return the characteristic polynomial of the shortest recurrence; None if none is certain."""
    for order in range((len(d) - _SPARE) // 2 + 1):
        hankel = flint.fmpz_mat([d[i : i + order + 1] for i in range(len(d) - order)])
        reduced, _ = flint.fmpq_mat(hankel).rref()
        coefficients = [-reduced[i, order] for i in range(order)]
        # Every infinite sequence of integers with a recurrence has one of integers.
        if all(a.q == 1 for a in coefficients):
            c = flint.fmpz_poly([*(a.p for a in coefficients), 1])
            if not any((hankel * flint.fmpz_mat(order + 1, 1, c.coeffs())).entries()):
                return c
    # Quasi-polynomials after a transient need no coefficients, and so fewer terms.
    E = flint.fmpz_poly([0, 1])
    for first in range(len(d) // 3 + 1):
        for period, power in product(range(1, _PERIODS + 1), range(4)):
            c = E**first * (E - 1) ** power * (E**period - 1)
            windows = range(len(d) - c.degree())
            zeros = [sum(a * d[i + j] for j, a in enumerate(c.coeffs())) == 0 for i in windows]
            if len(zeros) >= _SPARE + first and all(zeros):
                return c
    return None
