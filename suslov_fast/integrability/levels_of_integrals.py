"""The pencil of levels N = h D of an integral N / D: reducible members, base points, genus."""

import contextlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import reduce
from itertools import product
from math import comb, gcd
from typing import Any, NamedTuple

from ..checks import kind_of, wrong
from ..keywords import public
from . import polynomials
from .base_points import Points, function_of_root, points_of
from .interpolation import Watch, watch
from .pencils import AllReducible, conjugate_members, count_factors, reducible_members
from .polynomials import coefficients_in, degree_of, irreducible_factors, letters_of, variables_of
from .rational_functions import RationalFunction, factored, quotient_of, without_constant
from .tolerances import HIGHEST_PENCIL

_ROOTS = "r", "s", "t", "root"  # names of roots, of which the first unused one is taken
_SHIFTS = 0, 1, -1, 2, -2, 3, -3, 5  # lines x = constant that are tried


class Lines(NamedTuple):
    """Conjugate lines ``line = 0``, one for each root r of the polynomial `root`.

    A rational line has the `root` None. `line` and `root` are polynomials in letters and r.
    """

    line: RationalFunction
    root: RationalFunction | None
    number: int

    def __str__(self) -> str:
        if self.root is None:
            return f"{self.line} = 0"
        return f"{self.number} lines {self.line} = 0, where {self.root} = 0"


@dataclass(frozen=True, repr=False)
class Member:
    """A reducible level N = h D, or conjugate ones, which irrational h give.

    `polynomial` is the product of `conjugates` members, and `value` the irreducible polynomial in h
    whose roots belong to them (a constant for the level D = 0). Each member has `components`
    different curves over the complex numbers, with the line at infinity if the degree is lower.
    `lines` are those that are lines.
    """

    polynomial: RationalFunction
    conjugates: int
    value: RationalFunction
    components: int
    lines: tuple[Lines, ...]

    def __repr__(self) -> str:
        several = f"{self.conjugates} conjugate members, " if self.conjugates > 1 else ""
        each = " each" * (self.conjugates > 1)
        text = f"{several}{self.polynomial.text(150)}: {self.components} components{each}"
        conjugate = [str(lines) for lines in self.lines if lines.root is not None]
        return "; ".join([text, *conjugate])


class BasePoint(NamedTuple):
    """A point, or conjugate ones, on all levels of an integral.

    `coordinates` are homogeneous, (x, y, 1) for finite points, and functions of letters and of a
    root r of the polynomial `root`; None if they were not found. `intersection` is the intersection
    number of two levels there, `multiplicity` that of the general level, None if unknown.
    """

    coordinates: tuple[RationalFunction, ...] | None
    root: RationalFunction | None
    number: int
    intersection: int
    multiplicity: int | None


@dataclass(frozen=True, repr=False)
class Pencil:
    """The levels N = h D of an integral N / D, as `pencil` returns them.

    `members` are the reducible levels, those with most components first; conjugate ones follow.
    `base_points` and `genus`, of the general level, are known for maps of the plane. If `genus` is
    not None, it is proved; else `reason` says what is missing.
    """

    integral: RationalFunction
    degree: int
    members: tuple[Member, ...]
    base_points: tuple[BasePoint, ...]
    genus: int | None
    reason: str

    def __repr__(self) -> str:
        members = "".join(f"\n  {member}" for member in self.members)
        points = sum(point.number for point in self.base_points)
        genus = f"genus {self.genus}" if self.genus is not None else f"genus unknown: {self.reason}"
        return f"Pencil(degree {self.degree}, {points} base points, {genus}){members}"


class _Strict(Watch):
    """Raises an error where a search gives up."""

    def gave_up(self, reason: str) -> None:
        raise ArithmeticError(f"the reducible members were not found, because {reason}")


@public
def pencil(integral: RationalFunction) -> Pencil:
    """Find the reducible members, the base points and the genus of the levels N = h D.

    Quotients of two members are integrals, too. Conjugate members belong to irrational h; lines in
    them are given by a root of a polynomial.

    Parameters
    ----------
    integral : RationalFunction
        N / D, from a report, of degree 2 to 6. If it is a power, its root stands for it.

    Returns
    -------
    Pencil

    Raises
    ------
    ValueError
        If the degree is lower or higher, or all levels are reducible.
    ArithmeticError
        If formulas in letters become too long.

    Examples
    --------
    >>> from suslov_fast import Field
    >>> from suslov_fast.integrability import pencil, report
    >>> field = Field.from_hamiltonian(lambda x: x[0] * x[1] * (x[0] + x[1] + 1), "x y")
    >>> found = pencil(report(field, eps=1).integrals[0])
    >>> triangle, lines, *_ = found.members
    >>> triangle.polynomial / lines.polynomial
    x*y*(x + y + 1)/((2*x + 3)*(2*y + 3)*(2*x + 2*y - 1))
    >>> found.genus, sum(point.number * point.intersection for point in found.base_points)
    (1, 9)
    """
    if not isinstance(integral, RationalFunction):
        raise wrong("integral", "one of a report", kind_of(integral), TypeError)
    power = max(1, gcd(*(e for _, e in integral.factors)))
    if power > 1:
        root = tuple((P, e // power) for P, e in integral.factors)
        integral = RationalFunction(root, basis=integral.basis)
    if not 2 <= (degree := integral.degree) <= HIGHEST_PENCIL:
        raise wrong("integral", f"of degree 2 to {HIGHEST_PENCIL}", f"of degree {degree}")
    space, token = integral.as_quotient(), watch.set(_Strict())
    try:
        found = [_member(P, equation, integral) for P, equation in conjugate_members(space)]
    except AllReducible:
        what = "one with irreducible levels, no function of a simpler integral"
        raise wrong("integral", what, f"{integral}") from None
    finally:
        watch.reset(token)
    members = tuple(sorted(found, key=_order))
    if variables_of(space[0]) != 2:
        return Pencil(integral, degree, members, (), None, "the levels are no plane curves")
    points = points_of(*space)
    names = _names(integral)
    shown = tuple(_shown(point, names, integral) for point in points)
    losses = [point.loss for point in points]
    if None in losses:
        letters = ", ".join(integral.letters)
        reason = "common tangents are irrational"
        reason = f"set {letters}, by F.subs, for a proof" if letters else reason
        return Pencil(integral, degree, members, shown, None, reason)
    lost = sum(point.number * (point.loss or 0) for point in points)
    return Pencil(integral, degree, members, shown, comb(degree - 1, 2) - lost, "")


def quotient_of_lines(
    integral: RationalFunction, known: Iterable[tuple[list[Any], list[Any]]]
) -> RationalFunction | None:
    """Return a function of an integral that is a quotient of products of lines; None without one.

    Numerator and denominator have independent limits for eps to 0. If the integral is such a
    quotient itself, or the pencil has no two members that are products of lines, return None.
    `known` are pencils with their reducible members.
    """
    space = integral.as_quotient()
    if not 2 <= integral.degree <= HIGHEST_PENCIL or all(map(_is_product_of_lines, space)):
        return None
    with contextlib.suppress(ArithmeticError):  # all levels are reducible, or formulas too long
        same = (members for pair, members in known if polynomials.rank([*space, *pair]) == 2)
        if (members := next(same, None)) is None:
            members = [*reducible_members(space)]
        lines = sorted(filter(_is_product_of_lines, members), key=polynomials.sort_key)
        lines.sort(key=lambda P: degree_of(polynomials.limit(P)))
        own = [P for P in lines if str(P) == str(polynomials.without_content(space[0]))]
        for numerator, denominator in product([*own, *lines[::-1]], lines):
            if polynomials.rank([*map(polynomials.limit, (numerator, denominator))]) == 2:
                return quotient_of(numerator, denominator, integral.basis)
    return None


def _is_product_of_lines(P: Any) -> bool:
    return all(degree_of(f) <= 1 for f, _ in irreducible_factors(P))


def _names(integral: RationalFunction) -> tuple[str, ...]:
    """Return the names of the variables of an integral."""
    return tuple(integral.factors[0][0].context().names()[-2:])


def _order(member: Member) -> tuple[Any, ...]:
    P = member.polynomial.as_quotient()[0]
    return member.conjugates, -member.components, polynomials.sort_key(P)


def _member(P: Any, equation: list[Any], integral: RationalFunction) -> Member:
    conjugates, factors = len(equation) - 1, [f for f, _ in irreducible_factors(P) if degree_of(f)]
    total = sum(map(count_factors, factors))
    is_lower = degree_of(P) < conjugates * integral.degree
    lines = [each for f in factors for each in _lines(f)] if variables_of(P) == 2 else []
    function = quotient_of(P, P**0, integral.basis)
    components = total // conjugates + is_lower
    return Member(function, conjugates, _equation(equation, integral), components, (*lines,))


def _equation(coefficients: list[Any], integral: RationalFunction) -> RationalFunction:
    """Return the polynomial in h with these coefficients, polynomials in letters."""
    letters = integral.letters
    ring, count = polynomials.polynomial_ring(1, letters), len(letters)
    h, P = ring.gens()[-1], ring.constant(0)
    for k, c in enumerate(coefficients):
        P += ring.from_dict({(*e[:count], 0): a for e, a in c.to_dict().items()}) * h**k
    common = reduce(lambda a, b: a.gcd(b), coefficients_in(P, -1))
    return without_constant(factored(P // common)).renamed(("h",), integral.letter)


def _lines(f: Any) -> Iterator[Lines]:
    """Yield the line f = 0, or the conjugate lines into which an irreducible curve f = 0 splits."""
    degree, names = degree_of(f), f.context().names()
    if degree == 1:
        yield Lines(without_constant(factored(f)), None, 1)
        return
    if count_factors(f) < degree:
        return
    letters = tuple(map(polynomials.decoded, letters_of(f.context())))
    letter = next(name for name in _ROOTS if name not in (*letters, *names))
    ring, k = polynomials.polynomial_ring(2, (*letters, letter)), len(letters)
    *first, r, x, y = ring.gens()
    for is_swapped, c in product((False, True), _SHIFTS):
        # A point of each line is (c, r), or (r, c) for lines x = constant.
        at = [ring.constant(c), r][:: -1 if is_swapped else 1]
        root = f.compose(*first, *at, ctx=ring)
        factors = [power for power in irreducible_factors(root) if power[0].degrees()[k]]
        if [(int(g.degrees()[k]), m) for g, m in factors] != [(degree, 1)]:
            continue
        modulus = factors[0][0]
        slopes = (f.derivative(k + i).compose(*first, *at, ctx=ring) for i in range(2))
        dx, dy = (_remainder(slope, modulus, k) for slope in slopes)
        on_line = f.compose(*first, at[0] + x * dy, at[1] - x * dx, ctx=ring)
        if any(_remainder(each, modulus, k) != 0 for each in coefficients_in(on_line, k + 1)):
            return
        line = _remainder(dx * (x - at[0]) + dy * (y - at[1]), modulus, k)
        line = polynomials.without_content(line)
        new = names[-2:], letter if not letters else ""
        of_line, of_root = (without_constant(factored(P)).renamed(*new) for P in (line, modulus))
        yield Lines(of_line, of_root, degree)
        return


def _remainder(P: Any, modulus: Any, place: int) -> Any:
    """Return a multiple of P, by a polynomial in letters, modulo the polynomial of a root."""
    *_, leading = coefficients_in(modulus, place)
    n, r = int(modulus.degrees()[place]), P.context().gens()[place]
    while P != 0 and (k := int(P.degrees()[place])) >= n:
        P = leading * P - coefficients_in(P, place)[k] * r ** (k - n) * modulus
    return P


def _shown(points: Points, names: tuple[str, ...], integral: RationalFunction) -> BasePoint:
    """Return base points with functions for users."""
    coordinates: Any = None
    root: Any = None
    letter = next(name for name in _ROOTS if name not in (*integral.letters, *names))
    if integral.letters:
        if points.coordinates is not None:
            *_, last = (a for a in points.coordinates if a != 0)
            functions = (factored(a) / factored(last) for a in points.coordinates)
            coordinates = tuple(f.renamed(names, integral.letter) for f in functions)
    else:
        coordinates = tuple(function_of_root(a, letter) for a in points.coordinates or ())
        root = points.root and without_constant(function_of_root(points.root, letter))
    return BasePoint(coordinates, root, points.number, points.intersection, points.multiplicity)
