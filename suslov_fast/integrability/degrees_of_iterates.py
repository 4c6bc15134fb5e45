"""Degrees of iterates, and their growth: ``lim log(d_n) / n`` is the algebraic entropy.

An iterate has the degree of its restriction to a random line modulo a prime, without common factors
(Bellon and Viallet 1999). Degrees mostly satisfy a linear recurrence with integer coefficients. The
largest root of its characteristic polynomial is the limit of d_(n+1) / d_n.
"""

import math
import operator
import random
import re
from collections.abc import Iterator, Sequence
from itertools import count, islice, pairwise
from typing import Any, NamedTuple

import flint
import numpy as np

from ..checks import integer, short, wrong
from ..fields.base import Body
from ..keywords import public
from .arithmetic import Values, random_prime, random_values
from .birational_maps import RationalMap
from .exact_maps import checked_map
from .polynomials import random_line
from .tolerances import (
    HIGHEST_POWER_IN_THE_PLANE,
    LAST_QUOTIENTS,
    LEAST_EXPONENTIAL_QUOTIENT,
    LONGEST_DEGREE,
    MOST_PRIMES_DRAWN,
    RATIO_OF_QUOTIENTS,
    ROUNDING_OF_ROOT,
    SPARE_DEGREES,
)


@public
def degrees(map: RationalMap | Body, n: int) -> list[int]:
    """Return the degrees of the first n iterates of a map, as maps of projective space.

    The degree is the largest degree of the numerators and their common denominator, without common
    factors. It is found on random lines modulo two primes, which must give the same degree.

    Parameters
    ----------
    map
        As in :func:`darboux_polynomials`.
    n : int
        Number of iterates.

    Returns
    -------
    list of int

    Raises
    ------
    ArithmeticError
        If there is no map, or every line runs into points without an image.
    ValueError
        If degrees grow so fast that the last ones would take minutes.

    Examples
    --------
    >>> from suslov_fast import Field, Suslov3D
    >>> from suslov_fast.integrability import degrees, kahan
    >>> degrees(kahan(Suslov3D(4, 1, -0.5, -0.25).field(), 0.25), 8)
    [2, 4, 6, 8, 10, 12, 14, 16]
    """
    map, d = checked_map(map), [1]
    for degree in islice(agreed_degrees(map), n := integer("n", n, 0)):
        d.append(degree)
        expected_next = degree**2 / max(1, d[-2])
        if len(d) <= n and expected_next * map.length > LONGEST_DEGREE:
            expected = f"at most {len(d) - 1} for this map; the last degree is {degree}"
            raise wrong("n", expected, n)
    return d[1:]


def agreed_degrees(map: RationalMap) -> Iterator[int]:
    """Yield degrees of iterates that are the same on random lines modulo two primes."""
    rng = map.generator()
    runs: list[tuple[Iterator[int], list[int]]] = []  # a line, and the degrees on it so far
    for length in count(1):
        for _ in range(MOST_PRIMES_DRAWN):
            for run, sequence in runs:
                sequence += islice(run, length - len(sequence))
            sequences = [sequence for _, sequence in runs if len(sequence) == length]
            agreed = next((d for d in sequences if sequences.count(d) > 1), None)
            if agreed:
                runs = [(run, sequence) for run, sequence in runs if sequence == agreed][:2]
                yield agreed[-1]
                break
            p = random_prime(rng)
            runs.append((_degrees_on_a_line(map, p, random_values(rng, p)), []))
        else:
            raise ArithmeticError("the iterates reach poles of the map")


def _degrees_on_a_line(map: RationalMap, p: int, eps: Values) -> Iterator[int]:
    """Yield degrees of iterates on a random line modulo p, until the line has no further image."""
    line, map = random_line(map.dimension, p, random.Random(p)), map.at_eps(eps)
    while True:
        try:
            line = map.coprime_image(line)
        except ZeroDivisionError:
            return
        yield max(x.degree() for x in line)


class Growth(NamedTuple):
    """Growth of a sequence of degrees, as `growth` returns it: evidence, never a proof.

    `kind` is "bounded", "linear", "quadratic", "cubic", "polynomial of degree 4" and so on,
    "exponential" or "unclear". `entropy` is the logarithm of the limit of d_(k+1) / d_k, NaN
    without a recurrence. `based_on` is the recurrence, or the range of the last quotients.
    """

    kind: str
    entropy: float
    based_on: str


@public
def growth(degrees: Sequence[int], *, planar: bool = False) -> Growth:
    """Find how a sequence of degrees grows, and its entropy.

    Both follow from the shortest linear recurrence with integer coefficients that all degrees after
    a transient satisfy. At least three degrees beyond those that determine the recurrence must
    confirm it, and at least as many as the transient has.
    The largest root, which must be simple, gives the entropy, and the multiplicity of the roots of
    modulus 1 the kind. A recurrence may still be accidental.

    Without a recurrence the growth is called exponential if the last three quotients d_(k+1) / d_k
    are above 1.5 and differ by at most a tenth, and unclear otherwise. In the plane, linear growth
    shows an invariant fibration; the map may move its fibres.

    Parameters
    ----------
    degrees : sequence of int
        Degrees of consecutive iterates, as `degrees` returns them.
    planar : bool, optional
        True for a birational map of the plane. Then at most one root of a recurrence, counted with
        multiplicity, lies outside the unit circle, and without such a root growth is at most
        quadratic (Diller and Favre 2001); recurrences with other roots are left out as accidental.

    Returns
    -------
    Growth
        A named tuple `kind, entropy, based_on`.

    Examples
    --------
    >>> from suslov_fast.integrability import growth
    >>> growth([2, 4, 6, 8, 10, 12, 14]).based_on
    'd(k+2) = 2 d(k+1) - d(k), all 7 degrees'
    >>> kind, entropy, _ = growth([5, 21, 85, 341, 1365, 5461])
    >>> kind, round(entropy, 12)
    ('exponential', 1.38629436112)
    >>> growth([3, 7, 17, 39, 93, 215, 495]).based_on
    '7 degrees without a short recurrence; the last d(k+1) / d(k) are from 2.302 to 2.385'
    """
    try:
        d = [operator.index(degree) for degree in degrees]
    except TypeError:
        expected = "a list of integers, as degrees(map, n) returns it"
        raise wrong("degrees", expected, short(degrees), TypeError) from None
    if min(d, default=0) < 0:
        raise wrong("degrees", "0 or more", min(d))
    if not isinstance(planar, bool | np.bool_):
        raise wrong("planar", "True or False", short(planar), TypeError)
    return _by_recurrence(d, bool(planar)) or _by_quotients(d)


class Recurrence(NamedTuple):
    """A linear recurrence of degrees: coefficients c of ``sum_i c_i d(k + i) = 0``, and its growth.

    It holds after `transient` degrees, or from the degree 1 of the identity on.
    """

    coefficients: list[int]
    transient: int
    from_identity: bool
    kind: str
    entropy: float


def shortest_recurrence(d: list[int], planar: bool) -> Recurrence | None:
    """Return the shortest recurrence of the degrees d of a (planar) map; None without any."""
    for total in range(len(d) - SPARE_DEGREES + 2):
        for order in range(total + 1):
            transient = total - order
            # Without a transient, the recurrence may hold from the degree 1 of the identity on.
            sequences = ([1, *d], d) if transient == 0 else (d,)
            for terms in sequences:
                recurrence = _recurrence(terms[transient:], order, max(SPARE_DEGREES, transient))
                if recurrence and (growth := _growth_of(recurrence, planar)):
                    return Recurrence(recurrence, transient, terms is not d, *growth)
    return None


def _by_recurrence(d: list[int], planar: bool) -> Growth | None:
    """Return the `Growth` of the shortest recurrence of degrees of a (planar) map; or None."""
    if (found := shortest_recurrence(d, planar)) is None:
        return None
    text = _text_of(found.coefficients, len(d), found.transient, found.from_identity)
    return Growth(found.kind, found.entropy, text)


def _recurrence(terms: list[int], order: int, spare: int) -> list[int] | None:
    """Return the coefficients of a linear recurrence of this order that `terms` satisfy, or None.

    None also if a lower order suffices, or there are fewer than order + spare equations.
    """
    steps = len(terms) - order
    if steps < order + spare:
        return None
    rows = [terms[i : i + order + 1] for i in range(steps)]
    reduced, rank = flint.fmpq_mat(flint.fmpz_mat(rows)).rref()
    # A sequence of integers with a recurrence has one with integer coefficients (Fatou 1906).
    coefficients = [*(int(-reduced[i, order].p) for i in range(order)), 1]
    is_minimal = rank == order  # else lower orders, which were tried before, would do
    return coefficients if is_minimal and not any(np.array(rows, object) @ coefficients) else None


def moduli_outside(factor: Any) -> list[float]:
    """Return the moduli above 1 of the complex roots of `factor`, an irreducible polynomial."""
    roots = () if factor.is_cyclotomic() else factor.complex_roots()
    return [modulus for root, _ in roots if (modulus := abs(complex(root))) > 1 + ROUNDING_OF_ROOT]


def _growth_of(recurrence: list[int], planar: bool) -> tuple[str, float] | None:
    """Return (kind, entropy) of a recurrence; None if no map, or no planar map, has it."""
    factors = flint.fmpz_poly(recurrence).factor()[1]
    # The power of n with which terms grow, if no root is outside the unit circle.
    power = max((m - 1 for factor, m in factors if factor.is_cyclotomic()), default=0)
    outside = [(modulus, m) for factor, m in factors for modulus in moduli_outside(factor)]
    largest = max((modulus for modulus, _ in outside), default=1.0)
    largest_is_simple = all(
        m == 1 for modulus, m in outside if modulus > largest * (1 - ROUNDING_OF_ROOT)
    )
    fits_the_plane = sum(m for _, m in outside) <= 1 and (
        outside or power <= HIGHEST_POWER_IN_THE_PLANE
    )
    if not largest_is_simple or (planar and not fits_the_plane):
        return None
    kinds = "bounded", "linear", "quadratic", "cubic"
    kind = kinds[power] if power < len(kinds) else f"polynomial of degree {power}"
    return "exponential" if outside else kind, math.log(largest)


def _text_of(recurrence: list[int], number: int, transient: int, from_identity: bool) -> str:
    """Return the text of a recurrence that `number` degrees satisfy, except the first `transient`.

    `from_identity` is True if the recurrence also holds with the degree 1 of the identity in front.
    """
    order = len(recurrence) - 1
    terms = [f"{-recurrence[i]} d(k+{i})" for i in range(order)[::-1] if recurrence[i]]
    text = re.sub(r"\b1 d", "d", f"d(k+{order}) = {' + '.join(terms) or 0}, all {number} degrees")
    text = text.replace("+ -", "- ").replace("k+0", "k")
    text += " and that of the identity" if from_identity else ""
    return text + (f" but the first {transient}" if transient else "")


def _by_quotients(d: list[int]) -> Growth:
    """Return the growth that the last quotients d_(k+1) / d_k of degrees d suggest."""
    last, text = d[-LAST_QUOTIENTS - 1 :], f"{len(d)} degrees without a short recurrence"
    if len(last) <= LAST_QUOTIENTS or min(last) == 0:
        return Growth("unclear", math.nan, text)
    quotients = [b / a for a, b in pairwise(last)]
    least, largest = min(quotients), max(quotients)
    grows = least > LEAST_EXPONENTIAL_QUOTIENT and largest <= RATIO_OF_QUOTIENTS * least
    kind = "exponential" if grows else "unclear"
    text += f"; the last d(k+1) / d(k) are from {least:.4g} to {largest:.4g}"
    return Growth(kind, math.nan, text)
