"""Letters for which orbits of contracted curves end, and repairs: letters that solve conditions.

Point n of the orbit of a contracted curve has three coordinates, polynomials in the letters. It has
no image if the map's forms F_1, F_2, F_0 are 0 there. A common factor of their values is one
equation for letters. Without it they are 0 where two equations hold: resultants eliminate a letter.
For conjugate curves the values are replaced by their norms over the rational functions of letters,
where these are short, or by common factors of all their coefficients.

Each candidate is checked modulo a prime, at random letters that satisfy it: the map must keep its
degree, and the orbit of a germ must end after n points, not earlier.
"""

import contextlib
import random
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from functools import reduce
from itertools import combinations
from typing import Any, NamedTuple

import flint

from ..checks import integer, wrong
from ..fields.base import Body
from ..keywords import public
from . import arithmetic, polynomials
from .birational_maps import RationalMap
from .contracted_curves import Germs, Plane, PlaneModulo
from .entropy import PlanarEntropy, planar_entropy
from .exact_maps import checked_map, with_values_of_letters
from .polynomials import coefficients_in, irreducible_factors
from .rational_functions import RationalFunction, factored, quotients_of, without_constant
from .tolerances import (
    BITS_OF_PRIMES,
    CHECKS_OF_CANDIDATE,
    MOST_MONOMIALS_OF_NORMS,
    MOST_MONOMIALS_OF_POINT,
    MOST_MONOMIALS_OF_RESULTANTS,
    TRIES_OF_CHECK,
)


class Condition(NamedTuple):
    """If all `polynomials`, of letters, are 0, the orbit of a contracted curve ends after `length`.

    One polynomial is one equation for letters. Several polynomials stand for two equations, since
    each further polynomial is 0 in consequence.
    """

    curve: str
    length: int
    polynomials: tuple[RationalFunction, ...]


class Conditions(tuple[Condition, ...]):
    """The conditions that `locus` finds; `searched` says how far each orbit was followed."""

    searched: tuple[str, ...] = ()


@public
def locus(map: RationalMap | Body, steps: int = 6, *, letters: Any = None) -> Conditions:
    """Find for which values of letters the orbits of contracted curves end.

    For such values a singularity may be confined, and the entropy lower: `planar_entropy` decides,
    and `repairs` solves the conditions. Letters for which the map has a lower degree are left out.

    Parameters
    ----------
    map : KahanMap or RationalMap
        A birational map of two variables, with letters.
    steps : int, optional
        The most points of an orbit. Long formulas end an orbit earlier.
    letters
        As in :func:`report`.

    Returns
    -------
    tuple of Condition
        Short orbits first, and one equation before two. Its `searched` says to which number of
        points each orbit was followed.

    Raises
    ------
    ValueError
        If the map is not planar, has no inverse, or has no letters.

    Examples
    --------
    The entropy is 0 if a = 2 + eps^2:

    >>> from suslov_fast import Field
    >>> from suslov_fast.integrability import locus
    >>> field = Field(lambda x, a: (a*x[0]**2 + x[1]**2 + 1, -2*x[0]*x[1]), "x y", a=1)
    >>> for curve, length, polynomials in locus(field, 2, letters="a")[-1:]:
    ...     print(length, *polynomials)
    2 -eps^2 + a - 2
    """
    map, steps = checked_map(map, letters), integer("steps", steps, 1)
    if not map.is_planar or not map.letters:
        raise wrong("map", "a birational map of two variables with letters", f"{map}")
    plane, found, searched = Plane(map), list[Condition](), list[str]()
    for number in range(len(plane.curves)):
        if plane.is_long(number):
            searched.append(f"{plane.text(number)}: not followed, its equation is long")
            continue
        orbit = _Orbit(plane, number)
        found += orbit.conditions(steps)
        searched.append(orbit.searched)
    conditions = Conditions(sorted(found, key=lambda c: (c.length, len(c.polynomials) > 1)))
    conditions.searched = (*searched,)
    return conditions


class _Orbit:
    """The exact orbit of a contracted curve of a map with letters."""

    def __init__(self, plane: Plane, number: int) -> None:
        self._plane, self._number, self._germs = plane, number, Germs(plane, number)
        self._rng = plane.map.generator(number)
        self._ring = polynomials.polynomial_ring(0, plane.map.letters)
        self._points = self._pairs = 0  # the points up to which one and two equations were sought
        self._ended = False  # True if the orbit ends at the next point for all letters

    @property
    def searched(self) -> str:
        curve = self._plane.text(self._number)
        if self._ended:
            return f"{curve}: ends at point {self._points + 1} for all letters"
        two = f"two equations to point {self._pairs}" if self._plane.symbolic > 1 else ""
        return f"{curve}: one equation to point {self._points}" + f", {two}" * bool(two)

    def conditions(self, steps: int) -> Iterator[Condition]:
        """Yield the conditions under which point n = 1, 2, ..., `steps` has no image."""
        is_line, pairs = self._plane.degrees[self._number] == 1, self._plane.symbolic > 1
        for n, values in enumerate(
            self._germs.values_along(steps, MOST_MONOMIALS_OF_POINT), start=1
        ):
            if not any(values):
                self._ended = True
                return
            of_roots = (c for P in values for c in coefficients_in(P, -3))
            common = self._in_letters(reduce(lambda P, Q: P.gcd(Q), of_roots))
            norms: list[Any] = []
            if is_line or sum(map(len, values)) <= MOST_MONOMIALS_OF_NORMS:
                norms = [self._in_letters(self._germs.norm(P)) for P in values]
                common = reduce(lambda P, Q: P.gcd(Q), norms)
            for P, _ in irreducible_factors(common):
                if self._is_condition([P], None, n):
                    yield self._condition(n, [P])
            self._points = n
            others = [P // common for P in norms if P != 0]
            pairs = pairs and 0 < sum(map(len, others)) <= MOST_MONOMIALS_OF_RESULTANTS
            if pairs:
                for several in self._two_equations(others, n):
                    yield self._condition(n, several)
                self._pairs = n

    def _condition(self, n: int, several: Sequence[Any]) -> Condition:
        functions = (without_constant(factored(P)) for P in several)
        renamed = (f.renamed(None, self._plane.map.letter) for f in functions)
        return Condition(self._plane.text(self._number), n, (*renamed,))

    def _in_letters(self, P: Any) -> Any:
        """Return P, which contains letters alone, in the ring of letters."""
        return self._ring.from_dict({e[:-3]: c for e, c in P.to_dict().items()})

    def _two_equations(self, norms: list[Any], n: int) -> Iterator[list[Any]]:
        """Yield polynomials [P, Q, ...], of which P lacks a letter, that are 0 together."""
        if len(norms) < 2 or any(P.is_constant() for P in norms):
            return
        weights = [[self._rng.randrange(1, 50) for _ in norms] for _ in range(3)]
        A, B, C = (sum(w * P for w, P in zip(row, norms, strict=True)) for row in weights)
        known: list[list[Any]] = []
        for place in reversed(range(self._plane.symbolic)):
            name = self._ring.names()[place]
            if not (A.degrees()[place] and B.degrees()[place]):
                continue
            eliminated = A.resultant(B, name).gcd(A.resultant(C, name))
            for P, _ in irreducible_factors(eliminated) if eliminated != 0 else ():
                if several := self._common_zeros(P, norms, place, n, known):
                    known.append(several)
                    yield several

    def _common_zeros(
        self, P: Any, norms: list[Any], place: int, n: int, known: list[list[Any]]
    ) -> list[Any]:
        """Return P and a factor of each norm that is 0 where P = 0, or [] if that is no condition.

        The letter number `place` is the one that P lacks. Conditions that are known are left out.
        """
        if not self._is_condition([P, *norms], place, n):
            return []
        p, zero = self._zero

        def vanishes(f: Any) -> bool:
            return bool(polynomials.modulo(f, p, zero) == 0)

        if any(all(map(vanishes, others)) for others in known):
            return []
        several = {str(P): P}
        for norm in norms:
            vanishing = [f for f, _ in irreducible_factors(norm) if vanishes(f)]
            best = min(vanishing, key=lambda f: (len(f), str(f)))
            several.setdefault(str(best), best)
        return [*several.values()]

    def _is_condition(self, several: Sequence[Any], place: int | None, n: int) -> bool:
        """Return True if the orbit ends after n points at random letters that satisfy `several`."""
        checks = 0
        for _ in range(TRIES_OF_CHECK):  # conjugate lines have no points modulo every second prime
            p = arithmetic.random_prime(self._rng, BITS_OF_PRIMES)
            zero = self._random_zero(several, place, p)
            if zero is None:
                continue
            if (ends := self._ends(p, zero, n)) is False:
                return False
            self._zero = p, zero
            if (checks := checks + bool(ends)) == CHECKS_OF_CANDIDATE:
                return True
        return False

    def _random_zero(
        self, several: Sequence[Any], place: int | None, p: int
    ) -> tuple[int, ...] | None:
        """Return random letters modulo p at which polynomials are 0; None if p has none there.

        The first polynomial gives one letter; then all others give the letter number `place`.
        """
        count = self._plane.symbolic
        first, *others = several
        free = [k for k in range(count) if k != place and first.degrees()[k]]
        if not free:
            return None
        at = [self._rng.randrange(1, p) for _ in range(count)]
        for polys, k in (([first], free[-1]), (others, place)):
            if k is None or not polys:
                continue
            x = [flint.nmod_poly([a], p) for a in at]
            x[k] = flint.nmod_poly([0, 1], p)
            on_line = [polynomials.value_at(P, x) for P in polys]
            common = reduce(lambda P, Q: P.gcd(Q), on_line)
            roots = [int(root) for root, _ in common.roots()] if common.degree() > 0 else []
            if not roots:
                return None
            at[k] = self._rng.choice(sorted(roots))
        return (*at,)

    def _ends(self, p: int, letters: tuple[int, ...], n: int) -> bool | None:
        """Return True if modulo p, at these letters, the orbit of a component ends at point n.

        The map must have its general degree there. The result is None if no component has points.
        """
        residues = PlaneModulo(self._plane, p, letters, self._rng.getrandbits(30))
        forms = [P for P in residues.forms if P != 0]
        if not forms or reduce(lambda P, Q: P.gcd(Q), forms).total_degree() > 0:
            return False
        lengths = [residues.length(f, n) for f in residues.components(self._number)]
        return n in lengths if lengths or residues.curves[self._number] == 0 else None


class Repair(NamedTuple):
    """Values of letters for which a map has a lower entropy, as `repairs` returns them."""

    values: dict[str, RationalFunction]  # functions of the other letters
    entropy: PlanarEntropy
    map: RationalMap  # the map with these values


@public
def repairs(
    map: RationalMap | Body, unknown: str, steps: int = 6, *, letters: Any = None
) -> tuple[Repair, ...]:
    """Find values of one or two letters for which a map of the plane has a lower entropy.

    The values solve one condition of `locus`, or the conditions of two contracted curves together.
    They are rational functions of the other letters, such as eps.

    Parameters
    ----------
    map
        As in :func:`locus`.
    unknown : str
        The names of one or two letters, not eps, as "a" or "b c".
    steps, letters
        As in :func:`locus`.

    Returns
    -------
    tuple of Repair
        Low entropies first, then simple values.

    Raises
    ------
    ValueError
        If `unknown` are not one or two letters of the map, besides the step size.

    Examples
    --------
    If a = 2, the flow of this field has an integral, y^2 (2 x^2 + y^2 / 2 + 1), and the map has
    none; if a = 2 + eps^2, the map has one.

    >>> from suslov_fast import Field
    >>> from suslov_fast.integrability import repairs
    >>> field = Field(lambda x, a: (a*x[0]**2 + x[1]**2 + 1, -2*x[0]*x[1]), "x y", a=2)
    >>> for values, entropy, _ in repairs(field, "a", 4, letters="a"):
    ...     print(values, round(entropy.entropy, 4), entropy.lengths)
    {'a': 1} 0.0 (3, 3, 3)
    {'a': -1} 0.0 (None, 1, 1)
    {'a': eps^2 + 2} 0.0 (2, 4, 4)
    {'a': eps^2/(2*eps^2 + 1)} 0.6094 (None, 4, 4)
    """
    map = checked_map(map, letters)
    names = unknown.replace(",", " ").split() if isinstance(unknown, str) else [*unknown]
    is_step = "eps" in names and hasattr(map, "in_letters")
    if not 1 <= len({*names}) == len(names) <= 2 or {*names} - {*map.letters} or is_step:
        known = f"one or two of the letters {', '.join(map.letters)}, without a step size"
        raise wrong("unknown", known, repr(unknown))
    found, numbers = dict[str, Repair](), _numbers(map.letters)
    general = planar_entropy(map.subs(**numbers)).entropy
    for values in _solutions(locus(map, steps), names, map.letters):
        if str(values) in found:
            continue
        with contextlib.suppress(ArithmeticError):  # no map
            repaired = with_values_of_letters(map, values)
            entropy = _with_letters(repaired, numbers)
            if entropy.entropy is not None and (general is None or entropy.entropy < general):
                found[str(values)] = Repair(values, planar_entropy(repaired), repaired)
    return tuple(sorted(found.values(), key=_order))


def _order(repair: Repair) -> tuple[Any, ...]:
    return repair.entropy.entropy, len(str(repair.values)), str(repair.values)


def _numbers(letters: Sequence[str]) -> dict[str, Fraction]:
    """Return random numbers for letters."""
    rng = random.Random(0)
    return {name: Fraction(rng.randrange(11, 99), rng.randrange(3, 11)) for name in letters}


def _with_letters(map: RationalMap, numbers: Mapping[str, Fraction]) -> PlanarEntropy:
    """Return the entropy of a map for numbers in place of letters, which takes little time."""
    known = {name: numbers[name] for name in map.letters}
    return planar_entropy(map.subs(**known) if known else map)


def _solutions(
    conditions: Conditions, names: Sequence[str], letters: Sequence[str]
) -> Iterator[dict[str, RationalFunction]]:
    """Yield the rational values of one or two letters that satisfy conditions."""
    ring = polynomials.polynomial_ring(0, letters)
    systems = dict[str, list[Any]]()

    def add(*several: RationalFunction) -> None:
        equations = [ring.from_dict(f.as_quotient()[0].to_dict()) for f in several]
        systems.setdefault(str(equations), equations)

    for condition in conditions:
        if len(condition.polynomials) == 1 == len(names):
            add(*condition.polynomials)
        if len(names) == 2 <= len(condition.polynomials):
            add(*condition.polynomials)
    single = [c for c in conditions if len(c.polynomials) == 1]
    if len(names) == 2:
        for a, b in combinations(single, 2):
            if a.curve != b.curve and str(a.polynomials) != str(b.polynomials):
                add(*a.polynomials, *b.polynomials)
    places = [letters.index(name) for name in names]
    others = [k for k in range(len(letters)) if k not in places]
    for equations in systems.values():
        for values in _rational_zeros(equations, places):
            yield {n: _of_letters(f, letters, others) for n, f in zip(names, values, strict=True)}


def _of_letters(f: RationalFunction, letters: Sequence[str], kept: list[int]) -> RationalFunction:
    """Return a function of letters as a function of the letters with the numbers `kept` alone."""
    names = [letters[k] for k in kept]
    ring = polynomials.polynomial_ring(0, names)
    parts = (
        ring.from_dict({tuple(e[k] for k in kept): c for e, c in P.to_dict().items()})
        for P in f.as_quotient(polynomials.polynomial_ring(0, letters))
    )
    numerator, denominator = map(factored, parts)
    return (numerator / denominator).renamed(None, names[0] if len(names) == 1 else "")


def _rational_zeros(equations: list[Any], places: list[int]) -> Iterator[list[RationalFunction]]:
    """Yield values of the letters number `places`, functions of others, that are zeros."""
    place, *others = places
    if others:
        name = equations[0].context().names()[others[0]]
        first, *rest = equations
        eliminated = [P for P in equations if not P.degrees()[others[0]]]
        eliminated = eliminated[:1] or [first.resultant(P, name) for P in rest]
    else:
        eliminated = equations
    common = reduce(lambda P, Q: P.gcd(Q), eliminated)
    if common == 0:
        return
    for P, _ in irreducible_factors(common):
        if P.degrees()[place] != 1:
            continue
        constant, slope = coefficients_in(P, place)
        (value,) = quotients_of([-constant, slope])
        if not others:
            yield [value]
            continue
        left = [_substituted(Q, place, -constant, slope) for Q in equations]
        if left := [Q for Q in left if Q != 0]:
            for (other,) in _rational_zeros(left, others):
                yield [value, other]


def _substituted(P: Any, place: int, numerator: Any, denominator: Any) -> Any:
    """Return P for the value numerator / denominator of a letter, times a denominator."""
    coefficients = coefficients_in(P, place)
    n = len(coefficients) - 1
    terms = (c * numerator**k * denominator ** (n - k) for k, c in enumerate(coefficients))
    return sum(terms, 0 * P)
