"""A map restricted to a level of its first integrals, as a birational map of the plane.

Two rules make coordinates of a level: an integral of degree 1 in a variable is solved for it, and
one quadric in three variables is projected from one of its points. Points are homogeneous,
(x1, ..., xD, 1) times a factor: a number or, if a parameter is symbolic, a polynomial in it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

from ..checks import short, wrong
from ..fields.base import Body
from ..fields.names import labels
from ..keywords import public
from . import arithmetic, polynomials, rational_functions
from .arithmetic import EPS
from .birational_maps import RationalMap, check_one_letter
from .exact_maps import checked_map, has_inverse
from .polynomials import coprime, degree_of, homogenized, letters_in, polynomial_ring
from .rational_functions import RationalFunction, factored, independent, quotients_of
from .tolerances import WIDTH_OF_LEVEL

_OTHERS = 2, 1, 3, 5, 7, 4, 9  # coordinates in `generic_point`; one coordinate is a letter


@dataclass(frozen=True, repr=False)
class Level:
    """A map on a level of its integrals, as `on_level` returns it.

    `map` is the birational map in two coordinates of the level, x1 and x2. `chart` are these
    coordinates as functions of the variables, and `embedding` are the variables as functions of the
    coordinates. `how` says which level it is, and which rule made the coordinates.
    """

    map: RationalMap
    chart: tuple[RationalFunction, ...]
    embedding: tuple[RationalFunction, ...]
    how: str

    def __repr__(self) -> str:
        return f"Level({self.how})"


@public
def on_level(
    map: RationalMap | Body, integrals: Any, *, point: Any = None, letter: str = "h"
) -> Level:
    """Restrict a map of D variables to a level of D - 2 first integrals.

    The result is a birational map of the plane, for `planar_entropy` and `report`. Integrals that
    have degree 1 in a variable are solved for it; if one equation of degree 2 in three variables is
    left, it is projected from a point of the level.

    Parameters
    ----------
    map : KahanMap or RationalMap
        A birational map of three variables or more, with an inverse. If eps or another letter is
        symbolic, it stays so, and `point` is needed.
    integrals : sequence of RationalFunction or callable
        D - 2 independent first integrals, for example from a report. A callable takes the tuple of
        variables.
    point : sequence of D rational numbers, optional
        A point of the level. By default a letter stands for the value of the integral, or for a
        coordinate of a point of the level, so that the level is the generic one if D = 3. If D > 3,
        the other coordinates are small numbers.
    letter : str, optional
        The name of this letter, by default h.

    Returns
    -------
    Level
        Its `map` is planar and has an inverse.

    Raises
    ------
    TypeError, ValueError
        If these are not D - 2 independent integrals of the map, or the point is a singular one of
        their level, or no rule applies: then the message has the degrees of the equations left.
    ArithmeticError
        If the map does not take the level to itself, one to one, or no generic level is found.

    Examples
    --------
    >>> from suslov_fast.integrability import kahan, on_level, planar_entropy, zoo
    >>> map = kahan(*zoo()["Volterra chain, N = 3"])
    >>> level = on_level(map, [lambda x: x[0] + x[1] + x[2]])
    >>> level
    Level(x1 + x2 + x3 = h; solved for x1)
    >>> level.map.degree, planar_entropy(level.map).entropy
    (2, 0.0)
    """
    map = checked_map(map)
    D = map.dimension
    if D < 3 or not map.is_birational:
        raise wrong("map", "a birational map of 3 variables or more, with an inverse", f"{map}")
    if map.is_symbolic and point is None:
        raise wrong("point", f"a point of the level, because {map.letter} is symbolic", None)
    check_one_letter(map)
    taken = (*labels(D), *(map.names or ()))
    if not isinstance(letter, str) or not letter.isidentifier() or letter in taken:
        raise wrong("letter", "a name that no variable has, such as h", short(letter))
    equations = _Equations(map, integrals, map.letter or letter * (point is None))
    if point is not None:
        x = arithmetic.rationals("point", point, D)
        scale = math.lcm(*(a.denominator for a in x))
        start = [equations.ring.constant(int(a * scale)) for a in (*x, Fraction(1))]
        return equations.through(start, f"through ({', '.join([str(a) for a in x])})")
    return equations.by_value() or equations.through(*equations.generic_point())


class _Solved(NamedTuple):
    """Equations of a level: x_k = N / Q for (k, N, Q) in `steps`, and the `unsolved` equations."""

    steps: list[tuple[int, Any, Any]]  # number of a variable, its numerator and its denominator
    unsolved: list[Any]
    variables: list[int]  # variables that unsolved equations may contain


class _Equations:
    """The equations P / Q = constant for integrals P / Q of a map, which make a `Level`."""

    def __init__(self, map: RationalMap, integrals: Any, letter: str) -> None:
        self.map, self.letter = map, letter
        self.D = D = map.dimension
        # Rings of polynomials in x1, ..., xD, and in x1 and x2, with the letter if there is one.
        self.ring, self.plane = (polynomial_ring(n, [letter] * bool(letter)) for n in (D, 2))
        self.parts = [self._numerator_and_denominator(f) for f in integrals]
        functions = [factored(P) / factored(Q) for P, Q in self.parts]
        self.names = map.names or labels(D)
        shown = (rational_functions.without_constant(f) for f in functions)
        self.text = "; ".join(f.renamed(self.names, letter).text(WIDTH_OF_LEVEL) for f in shown)
        if len(functions) != D - 2 or len(independent(functions, map.prime)) < D - 2:
            raise wrong("integrals", f"{D - 2} independent ones", self.text or "none")
        self.forward, self.backward = (
            [_in_ring(F, self.ring) for F in forms] for forms in (map.forms, map.inverse.forms)
        )
        for given, (P, Q) in zip(integrals, self.parts, strict=True):
            if getattr(given, "basis", "") == rational_functions.IDENTITY:
                continue
            after, below = self._values(P, Q, self.forward)
            if after * Q != below * P:
                raise wrong("integrals", "conserved by the map", factored(P) / factored(Q))

    def _numerator_and_denominator(self, f: Any) -> tuple[Any, Any]:
        if not isinstance(f, RationalFunction):
            if not callable(f):
                raise wrong("integrals", "functions of the variables", short(f), TypeError)
            f = _function_by(f, [factored(x) for x in self.map.variables[:-1]])
        P, Q = f.as_quotient(None if f.factors else self.map.ring)
        if letters_in(P) and not self.map.is_symbolic:
            how = f'pass F.subs({f.letter}="{getattr(self.map, "eps", "1/3")}") in place of F'
            received = f"{short(f)}, in which {f.letter} is a letter: {how}"
            raise wrong("integrals", "functions of the variables alone", received)
        if polynomials.variables_of(P) != self.D:
            raise wrong("integrals", f"functions of {self.D} variables", short(f))
        return _in_ring(P, self.ring), _in_ring(Q, self.ring)

    # Which level.

    def by_value(self) -> Level | None:
        """Return the level {integral = letter}; None if D > 3 or no variable can be eliminated."""
        if self.D > 3:
            return None
        ((P, Q),) = self.parts
        solved = _solved([P - self.ring.gens()[0] * Q], [*range(self.D)], None)
        return None if solved.unsolved else self._made(solved, None, f"{self.text} = {self.letter}")

    def generic_point(self) -> tuple[list[Any], str]:
        """Return a point of a generic level, with the letter as one coordinate, and its text."""
        points = []
        for j in range(self.D):
            x = [self.ring.constant(a) for a in (*_OTHERS, *range(10, 10 + self.D))[: self.D]]
            x.insert(j, self.ring.gens()[0])
            x[-1] = self.ring.constant(1)
            values = [coprime(self._values(P, Q, x)) for P, Q in self.parts]
            degrees = [max(int(a.total_degree()) for a in pair) for pair in values]
            if all(any(pair) for pair in values) and any(degrees):
                points.append((sum(degrees), j, x))
        if not points:
            raise ArithmeticError(f"the points tried are on no level of {self.text}")
        _, j, x = min(points, key=lambda each: each[:2])
        names = [str(a) for a in x[:-1]]
        names[j] = self.letter
        return x, f"through ({', '.join(names)})"

    def _values(self, P: Any, Q: Any, x: Sequence[Any]) -> list[Any]:
        """Return the values of the numerator P and the denominator Q of an integral at a point."""
        degree = max(degree_of(P), degree_of(Q))
        return [homogenized(R, degree, x, self.ring) for R in (P, Q)]

    def through(self, x: list[Any], where: str) -> Level:
        """Return the `Level` through a point x; `where` describes the point."""
        equations = []
        for P, Q in self.parts:
            value, below = self._values(P, Q, x)
            if value == below == 0:
                raise wrong("point", f"one at which {self.text} has a value", where)
            equations.append(_component(below * P - value * Q, x))
        return self._made(_solved(equations, [*range(self.D)], x), x, f"{self.text} {where}")

    # Coordinates.

    def _made(self, solved: _Solved, x: list[Any] | None, text: str) -> Level:
        """Return the `Level` of solved equations, named `text`; a quadric is projected from x."""
        solved_for = ", ".join(self.names[k] for k, *_ in solved.steps)
        how = [f"solved for {solved_for}"] if solved_for else []
        degrees, kept = [degree_of(P) for P in solved.unsolved], solved.variables
        variables = self.ring.gens()[-self.D :]
        if not degrees:
            on_it = [*self.plane.gens()[-2:], self.plane.constant(1)]
            chart = [*(variables[k] for k in kept), self.ring.constant(1)]
        elif x is not None and len(kept) == 3 and degrees == [2]:
            on_it = self._on_quadric(solved.unsolved[0], kept, x)
            chart = [x[-1] * variables[k] - x[k] for k in kept]
            how.append("projected from this point")
        else:
            of_degrees, of_names = map(str, degrees), (self.names[k] for k in kept)
            left = f"of degree {', '.join(of_degrees)} in {', '.join(of_names)}"
            expected = "such that variables can be eliminated up to one quadric in three of them"
            raise wrong("integrals", expected, f"with equations left {left}")
        values = dict(zip(kept, quotients_of(on_it), strict=True))
        for k, *parts in reversed(solved.steps):
            known = [values.get(j, rational_functions.as_function(0)) for j in range(self.D)]
            point = rational_functions.over_common_denominator(known, self.plane)
            degree = max(map(degree_of, parts))
            (values[k],) = quotients_of(homogenized(R, degree, point, self.plane) for R in parts)
        functions = [values[k] for k in range(self.D)]
        embedding = rational_functions.over_common_denominator(functions, self.plane)
        return self._level(embedding, chart, "; ".join([text, *how]))

    def _on_quadric(self, quadric: Any, kept: list[int], x: list[Any]) -> list[Any]:
        """Return the point in which a line through x meets a quadric again, in four coordinates.

        They are the three homogeneous coordinates with the indices `kept`, and the last one. The
        direction of the line has the coordinates x1, x2 and 1 at `kept`, and 0 elsewhere; x1 and
        x2 are the variables of the plane.
        """
        one = self.plane.constant(1)
        start = [homogenized(a, 0, [one] * len(x), self.plane) for a in x]  # x in this ring
        d = [0 * one] * len(x)  # the direction
        for k, a in zip(kept, (*self.plane.gens()[-2:], one), strict=True):
            d[k] = a
        # On the line x + s d the quadric is a s**2 + b s, which is 0 again at s = -b / a.
        a = homogenized(quadric, 2, d, self.plane)
        ends = [p + e for p, e in zip(start, d, strict=True)]
        b = homogenized(quadric, 2, ends, self.plane) - a
        if b == 0:
            raise wrong("point", "a regular one of its level", "the vertex of a cone")
        return [a * start[k] - b * d[k] for k in (*kept, -1)]

    def _level(self, embedding: list[Any], chart: list[Any], how: str) -> Level:
        """Return the `Level` with these polynomials N_1, ..., Q of its functions N_i / Q."""
        maps = []
        for forms in (self.forward, self.backward):
            degree = max(map(degree_of, forms))
            image = coprime([homogenized(F, degree, embedding, self.plane) for F in forms])
            maps.append(coprime([homogenized(C, 1, image, self.plane) for C in chart]))
        forward, backward = maps
        if forward[-1] == 0 or backward[-1] == 0:
            raise ArithmeticError(f"the map takes the level {how} to poles of the coordinates")
        letters = (self.letter,) * bool(self.letter)
        inverse = RationalMap(backward, RationalMap(forward, None, letters), letters)
        restricted = RationalMap(forward, inverse, letters)
        if not has_inverse(restricted) or not self._is_restricted(restricted, embedding):
            raise ArithmeticError(f"the map does not take the level {how} to itself, one to one")
        coordinates = tuple(f.renamed(self.names, self.letter) for f in quotients_of(chart))
        variables = tuple(f.renamed(None, self.letter) for f in quotients_of(embedding))
        return Level(restricted, coordinates, variables, how)

    def _is_restricted(self, restricted: RationalMap, embedding: list[Any]) -> bool:
        """Return True if embedding(restricted(x)) = map(embedding(x)) at a point x modulo p."""
        p = restricted.prime
        x = arithmetic.random_point(2, p)

        def embedded(x: Sequence[Any]) -> list[Any]:
            *y, below = (polynomials.value_at(polynomials.modulo(P, p, EPS), x) for P in embedding)
            return [*(a / below for a in y), below**0]

        try:
            image = restricted.at_eps(EPS).image(x)
            return embedded(image) == self.map.at_eps(EPS).image(embedded(x))
        except ZeroDivisionError:
            return False


def _function_by(f: Any, variables: list[RationalFunction]) -> RationalFunction:
    """Return f((x1, ..., xD)) as a rational function, or raise an error about integrals."""
    must = "integrals must give quotients of polynomials in the variables, by +, -, *, /, **"
    try:
        return rational_functions.as_function(f(tuple(variables)))
    except (TypeError, AttributeError, ValueError, IndexError, ArithmeticError) as error:
        kind = TypeError if isinstance(error, TypeError | AttributeError) else ValueError
        raise kind(f"{must}: {error}") from error


def _solved(equations: list[Any], variables: list[int], x: list[Any] | None) -> _Solved:
    """Solve as many equations of a level as possible, each for one of the `variables`.

    If x is a point of the level, each equation that is left is replaced by its component
    through x.
    """
    best = _Solved([], equations, variables)
    candidates = []
    for P in equations:
        for k in variables:
            parts = polynomials.coefficients_in(P, letters_in(P) + k)
            if len(parts) == 2 and (x is None or _at(parts[1], x) != 0):
                sizes = [(degree_of(R), len(R)) for R in reversed(parts)]
                candidates.append((sizes, k, P, parts))
    for _, k, P, (B, A) in sorted(candidates, key=lambda each: each[:2]):
        others = [_substituted(Q, k, -B, A) for Q in equations if Q is not P]
        if x is not None:
            others = [_component(Q, x) for Q in others]
        solved = _solved(others, [j for j in variables if j != k], x)
        if len(solved.unsolved) < len(best.unsolved):
            best = solved._replace(steps=[(k, -B, A), *solved.steps])
        if not best.unsolved:
            break
    return best


def _substituted(P: Any, k: int, numerator: Any, denominator: Any) -> Any:
    """Return the numerator of P after x_k is replaced by numerator / denominator."""
    parts = polynomials.coefficients_in(P, letters_in(P) + k)
    n = len(parts) - 1
    powers = (c * numerator**j * denominator ** (n - j) for j, c in enumerate(parts))
    return sum(powers, P.context().constant(0))


def _at(P: Any, x: list[Any]) -> Any:
    """Return the value of a polynomial at a point, times a power of its last coordinate."""
    return homogenized(P, degree_of(P), x, P.context())


def _component(P: Any, x: list[Any]) -> Any:
    """Return the irreducible factor of a polynomial P that vanishes at a point x."""
    factors = [f for f, _ in polynomials.irreducible_factors(P) if degree_of(f)] if P != 0 else []
    through = [f for f in factors if _at(f, x) == 0]
    if len(through) != 1:
        where = "where its components meet" if through else "where the integrals depend"
        raise wrong("point", "a regular one of its level", f"one {where}")
    return through[0]


def _in_ring(P: Any, ring: Any) -> Any:
    """Return a polynomial in `ring`, which may have a letter that the polynomial lacks."""
    lacking = ring.nvars() - P.context().nvars()
    return ring.from_dict({(*[0] * lacking, *e): c for e, c in P.terms()})
