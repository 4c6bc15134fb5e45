"""Exact algebraic entropy of birational maps of the plane, from the curves that they contract.

The plane is blown up at the points of confined orbits, see `contracted_curves`. The entropy is the
logarithm of the largest root of the characteristic polynomial of the map's action on the curves of
the blown-up plane (Diller and Favre 2001).
"""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice, takewhile
from operator import itemgetter
from typing import Any

import flint

from ..checks import wrong
from ..fields.base import Body
from ..keywords import public
from . import arithmetic
from .birational_maps import RationalMap
from .contracted_curves import (
    Passage,
    Plane,
    PlaneModulo,
    is_proved,
    passages_across,
    periodic_passage,
    points_of_orbit,
)
from .degrees_of_iterates import agreed_degrees, growth, moduli_outside, shortest_recurrence
from .exact_maps import checked_map
from .polynomials import cramer
from .rational_functions import IDENTITY, RationalFunction
from .tolerances import (
    DEGREES_PREDICTED,
    HIGHEST_DEGREE_COMPARED,
    MOST_STEPS_OF_CURVE,
    TRIES_OF_SMALL_PRIME,
)

_SMALL_PRIMES = (5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79)
_AGAIN = "comes to points without an image again and again"


@dataclass(frozen=True)
class Contraction:
    """A curve that a map contracts to a point, and the orbit of this point.

    Conjugate curves are listed as one, and `count` is their number. If the singularity is confined,
    the orbit ends at a point without an image, and `length` is the number of its points; otherwise
    `length` is None. `how` says how this was decided, and `proved` whether it is a proof.

    `points` are the points of the orbit, exact, or the first ones of an orbit that is not confined.
    Each is (x, y, 1), or (x, y, 0) at infinity. For conjugate curves coordinates contain a root r
    of the polynomial `root`. Points with long coordinates are left out, with all that follow.
    """

    curve: str
    count: int
    length: int | None
    proved: bool
    how: str
    points: tuple[tuple[RationalFunction, ...], ...] = ()
    root: RationalFunction | None = None

    def __str__(self) -> str:
        points = "1 point" if self.length == 1 else f"{self.length} points"
        confined = f"confined after {points}, " if self.length else ""
        curves = f" ({self.count} conjugate curves)" if self.count > 1 else ""
        return f"{self.curve}{curves}: {confined}{self.how}"


@dataclass(frozen=True, repr=False)
class PlanarEntropy:
    """The algebraic entropy of a birational map of the plane, as `planar_entropy` returns it.

    The entropy is the logarithm of the largest root of `polynomial`, the characteristic polynomial
    of the map's action on curves, after the points of confined orbits are blown up. `minimal` is
    the irreducible factor with this root. `degrees` are the degrees of the first iterates, as they
    follow from `contractions`. `proved` is True if the entropy is proved; `based_on` says by what.
    Without an entropy, `reason` says why. If degrees grow quadratically, there is an invariant
    pencil of curves of genus 1, and its degree is a multiple of `pencil`.
    """

    contractions: tuple[Contraction, ...] = ()
    polynomial: Any = None  # flint.fmpz_mpoly in x
    minimal: Any = None
    entropy: float | None = None
    degrees: tuple[int, ...] = ()
    proved: bool = False
    based_on: str = ""
    reason: str = ""
    pencil: int | None = None

    @property
    def lengths(self) -> tuple[int | None, ...]:
        """The lengths of the orbits, for each curve; None for orbits that are not confined."""
        return tuple(curve.length for curve in self.contractions for _ in range(curve.count))

    @property
    def certainty(self) -> str:
        """The certainty of the entropy, in words: proved or not."""
        return "proved" if self.proved else "not proved"

    def contradiction(self, degrees: Sequence[int]) -> str:
        """Return why `degrees` of the first iterates contradict ``self.degrees``; else ""."""
        expected = [*self.degrees[: len(degrees)]]
        if [*degrees[: len(expected)]] == expected:
            return ""
        return f"the degrees are {degrees}, but {expected} by the contracted curves"

    def __repr__(self) -> str:
        if self.entropy is None:
            return f"PlanarEntropy(none: {self.reason})"
        root = f", the largest root of {self.minimal}" if self.entropy else ""
        lines = "".join(f"\n  {curve}" for curve in self.contractions)
        return f"PlanarEntropy({self.entropy:.10g}{root}; {self.certainty}){lines}"


@public
def planar_entropy(map: RationalMap | Body) -> PlanarEntropy:
    """Find the algebraic entropy of a birational map of the plane from its singularities.

    The map contracts some curves to points. If the orbit of such a point comes to a point without
    an image, the singularity may be confined, and the degrees of iterates are lower; how much
    follows from the lengths of these orbits (Diller and Favre 2001). Orbits are followed for 80
    steps. An entropy that is not proved is compared with the degrees of iterates on random lines,
    and not given if they contradict it. If an orbit comes to points without an image again and
    again, the entropy follows from orders that repeat, or from a recurrence of these degrees, and
    is not proved.

    Parameters
    ----------
    map : KahanMap or RationalMap
        A birational map of two variables. If it has letters, the entropy holds for general letters.

    Returns
    -------
    PlanarEntropy
        Its entropy is None if it could not be found; `reason` then says why.

    Raises
    ------
    ArithmeticError
        If there is no map.

    Examples
    --------
    >>> from suslov_fast import Field
    >>> from suslov_fast.integrability import kahan, planar_entropy
    >>> def f(x):
    ...     return x[0]**2 + 3*x[0]*x[1], 2*x[0]*x[1] - x[1]**2
    >>> found = planar_entropy(kahan(Field(f, 2), "1/3"))
    >>> found.lengths, found.minimal, round(found.entropy, 6), found.proved
    ((None, 4, None), x^4 - x^3 - x^2 - x - 1, 0.656256, True)
    """
    map = checked_map(map)
    if map.dimension != 2:
        raise wrong("map", "one of two variables", f"of {map.dimension}: use degrees(map, 8)")
    if not map.is_planar:
        missing = "det DPhi = 0" if not map.is_invertible else "no inverse was given"
        return PlanarEntropy(reason=f"the map is not known to be birational: {missing}")
    plane = Plane(map)
    passages = passages_across(plane, MOST_STEPS_OF_CURVE)
    if passages is None:
        return PlanarEntropy(reason="no prime was found modulo which the contracted curves split")
    contractions = tuple(_contraction(plane, k, passage) for k, passage in enumerate(passages))
    for k, passage in enumerate(passages):
        if passage.endless:
            if (periodic := periodic_passage(plane, k)) is None:
                return _by_degrees(map, contractions)
            passages[k] = periodic
    numerators, Q = series_of_degrees(plane, passages)
    P = numerators[0]
    # The characteristic polynomial has a root 0 for each term that precedes the recurrence.
    transient = max(0, P.degree() + 1 - Q.degree())
    polynomial = flint.fmpz_poly([0] * transient + Q.coeffs()[::-1])
    minimal, root = _factor_with_largest_root(polynomial)
    d: list[int] = []
    for k in range(DEGREES_PREDICTED + 1):
        d.append(int(P[k] - sum(Q[j] * d[k - j] for j in range(1, min(k, Q.degree()) + 1))))
    entropy = PlanarEntropy(
        contractions=contractions,
        polynomial=_in_x(polynomial),
        minimal=_in_x(minimal),
        entropy=math.log(root),
        degrees=tuple(d[1:]),
        proved=all(curve.proved for curve in contractions),
        based_on="; ".join(str(curve) for curve in contractions) or "no contracted curve",
        pencil=None if root > 1 else degree_of_pencil(plane, passages, numerators, Q),
    )
    low = takewhile(
        lambda degree: degree <= HIGHEST_DEGREE_COMPARED,
        islice(agreed_degrees(map), DEGREES_PREDICTED),
    )
    why = "" if entropy.proved else entropy.contradiction([*low])
    return PlanarEntropy(reason=why) if why else entropy


def _by_degrees(map: RationalMap, contractions: tuple[Contraction, ...]) -> PlanarEntropy:
    """Return the unproved entropy that follows from a recurrence of degrees on random lines."""
    low = takewhile(
        lambda degree: degree <= HIGHEST_DEGREE_COMPARED,
        islice(agreed_degrees(map), DEGREES_PREDICTED),
    )
    if (found := shortest_recurrence(d := [*low], planar=True)) is None:
        why = f"{_AGAIN}, and degrees have no short recurrence"
        return PlanarEntropy(contractions, reason=f"a contracted curve {why}")
    zeros = 0 if found.from_identity else found.transient + 1
    polynomial = flint.fmpz_poly([0] * zeros + found.coefficients)
    minimal, root = _factor_with_largest_root(polynomial)
    return PlanarEntropy(
        contractions=contractions,
        polynomial=_in_x(polynomial),
        minimal=_in_x(minimal),
        entropy=math.log(root),
        degrees=(*d,),
        based_on=growth(d, planar=True).based_on,
    )


def proved_by_integral(
    entropy: PlanarEntropy | None, integrals: Sequence[RationalFunction]
) -> PlanarEntropy | None:
    """Return `entropy`, or the entropy 0 if it is unproved and an integral is proved (`IDENTITY`).

    Birational maps of the plane with an integral have the entropy 0 (Diller and Favre 2001).
    """
    proofs = [f for f in integrals if f.basis == IDENTITY]
    if not proofs or entropy is None or entropy.proved:
        return entropy
    known = entropy if entropy.entropy == 0 else PlanarEntropy(entropy.contractions)
    facts = {"minimal": _in_x(flint.fmpz_poly([-1, 1])), "based_on": f"the integral {proofs[0]}"}
    return replace(known, entropy=0.0, proved=True, **facts)


def _contraction(plane: Plane, number: int, passage: Passage) -> Contraction:
    """Return the `Contraction` of curve `number` with orders `passage`, proved if possible."""
    points = points_of_orbit(plane, number, passage)
    if passage.endless:
        return Contraction(plane.text(number), plane.count(number), None, False, _AGAIN, *points)
    exact = is_proved(plane, number, passage)
    length = None if passage.steps is None else passage.steps - 1
    if length is not None:
        field = "the rationals" if plane.degrees[number] == 1 else "a number field"
        how = f"exact over {field}" if exact else "modulo two primes, at random points"
    elif reason := why_never(plane, number, passage):
        how = reason if exact else f"{reason}; orders modulo two primes, at random points"
    else:
        exact, how = False, f"not confined within {MOST_STEPS_OF_CURVE} steps"
    return Contraction(plane.text(number), plane.count(number), length, exact, how, *points)


def why_never(plane: Plane, number: int, passage: Passage) -> str:
    """Return why the orbit of contracted curve `number` never ends; "" if that is not proved.

    An orbit ends at a point without an image. An orbit that is periodic modulo a small prime, with
    images of all its points, never ends.
    """
    for p in _SMALL_PRIMES:
        rng = random.Random(p)
        for _ in range(TRIES_OF_SMALL_PRIME):
            values = [rng.randrange(1, p) for _ in range(max(1, plane.symbolic))]
            residues = PlaneModulo(plane, p, (*values,), rng.randrange(99))
            if _is_periodic_modulo(residues, number, passage):
                numbers = zip(plane.map.letters, values, strict=False)
                at = "".join(f" and {name} = {a}" for name, a in numbers)
                return f"never, since modulo {p}{at} the orbit is periodic"
    return ""


def _is_periodic_modulo(residues: PlaneModulo, number: int, passage: Passage) -> bool:
    """Return True if the orbit of curve `number` modulo a prime is periodic and meets no pole.

    The orbit is the residue of an exact one: it begins at a smooth point of the curve, which is the
    residue of a p-adic point of the curve, and its orders must be those in `passage`.
    """
    if any(P == 0 for P in (*residues.forms, residues.curves[number])):
        return False
    germ, terms = residues.germ(residues.curves[number]), 1 + sum(passage.common_orders)
    for expected in (0, *passage.common_orders):
        if germ is None or (step := residues.step(germ, terms)) is None:
            return False
        germ = step.germ
        terms -= step.common_order
        if step.common_order != expected:
            return False
    x = [P[0] for P in germ or ()]
    visited = set()
    while any(x):
        pivot = next(a for a in x if a)
        point = tuple(int(a / pivot) for a in x)
        if point in visited:
            return True
        visited.add(point)
        x = [F(*point) for F in residues.forms]
    return False


# Let s_j be the degree of the curve that the j-th iterate maps onto a contracted curve C. After k
# more steps this curve's equation divides the pullbacks of contracted curves and the coordinates
# of the next iterate. The powers in which it divides them are `curve_orders` and `common_orders` of
# a `Passage`. With d_0 = 1 and the map's degree d,
#   s_j = deg(C) d_j - sum over curves and k of curve_orders(k) s_(j - k),
#   d_(j + 1) = d d_j - sum over curves and k of common_orders(k) s_(j - k).


def series_of_degrees(plane: Plane, passages: list[Passage]) -> tuple[list[Any], Any]:
    """Return polynomials [P, ...] and Q in z: P / Q is the generating function of d_n, then s_n."""
    one, z = flint.fmpz_poly([1]), flint.fmpz_poly([0, 1])
    used = [k for k, passage in enumerate(passages) if passage.common_orders]
    # The unknowns are the generating functions of d, and of s for each curve in `used`, divided by
    # 1 - z^T if orders have the period T.
    columns = [[1 - plane.degree * z, *(-plane.degrees[i] * one for i in used)]]
    for k in used:
        of_curves = [*zip(*passages[k].curve_orders, strict=True)]
        orders = (passages[k].common_orders, *(of_curves[i] for i in used))
        column = [z * flint.fmpz_poly([*each]) for each in orders]
        column[0] *= z
        column[1 + used.index(k)] += one - z ** passages[k].period * (passages[k].period > 0)
        columns.append(column)
    rows = [*zip(*columns, strict=True)]
    # The right sides are 1 in the first equation, and 0 in the others.
    *numerators, Q = cramer([[*row, (k == 0) * one] for k, row in enumerate(rows)])
    sign = 1 if Q[0] > 0 else -1
    return [sign * P for P in numerators], sign * Q


def degree_of_pencil(plane: Plane, passages: list[Passage], numerators: Any, Q: Any) -> int | None:
    """Return m, of which the degree of an invariant pencil is a multiple; None without a pencil.

    If degrees grow quadratically, the map takes a pencil of curves of genus 1 to itself (Gizatullin
    1980, Diller and Favre 2001). The pullbacks of a line, divided by n^2, tend to a multiple of its
    class. So the degree of the pencil and its intersection numbers with contracted curves, which
    are integers, are proportional to the leading coefficients of d_n and s_n: to the numerators of
    their generating functions at z = 1.
    """
    one = flint.fmpz_poly([1, -1])
    if any(passage.period for passage in passages):
        return None
    powers = [arithmetic.divided_out(P, one)[1] for P in numerators if P != 0]
    common = one ** min(powers)
    if (Q // common) % one**3 != 0:
        return None
    leading = [(P // common)(1) for P in numerators]
    used = [k for k, passage in enumerate(passages) if passage.common_orders]
    counts = [1, *(plane.count(k) for k in used)]
    shares = [flint.fmpq(int(a), n) / int(leading[0]) for a, n in zip(leading, counts, strict=True)]
    return math.lcm(*(int(share.q) for share in shares))


def _in_x(polynomial: Any) -> Any:
    terms = {(k,): c for k, c in enumerate(polynomial.coeffs())}
    return flint.fmpz_mpoly_ctx.get(("x",), ordering="deglex").from_dict(terms)


def _factor_with_largest_root(polynomial: Any) -> tuple[Any, float]:
    """Return the factor with the largest root, and its modulus; (x - 1, 1) if all are at most 1."""
    moduli = ((max(moduli_outside(f), default=1.0), f) for f, _ in polynomial.factor()[1])
    modulus, factor = max(moduli, key=itemgetter(0), default=(1.0, None))
    return (factor, modulus) if modulus > 1.0 else (flint.fmpz_poly([-1, 1]), 1.0)
