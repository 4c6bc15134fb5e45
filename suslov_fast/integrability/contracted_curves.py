"""Curves that a birational map of the plane contracts, and the orbits of their images.

A contracted curve C is mapped to a point q, then to f(q), f(f(q)), ... If one of these has no
image, the singularity may be confined: then a neighbourhood of C is mapped to a neighbourhood of
another curve. Take a germ c + t v, a series in t with a generic point c of C. The degrees of
iterates follow from orders in t of its images: the order of the common factor of the coordinates,
and the order of the equation of each contracted curve. They are computed modulo a prime, for two
germs.

If C is a line, or one of several conjugate lines, they are then proved for the general point of C.
Coordinates of the germ are polynomials in t, in a parameter s of the line, in an algebraic number r
that tells conjugate lines apart, and in eps if it is symbolic. For other curves, orders are exact
if they are the multiplicities of the polynomials at the points of one orbit.
"""

import random
from collections.abc import Iterator, Sequence
from functools import reduce
from itertools import islice
from typing import Any, NamedTuple

import flint

from . import arithmetic, polynomials
from .arithmetic import Values
from .base_points import NumberField, function_of_root
from .birational_maps import RationalMap
from .pencils import count_factors
from .polynomials import coefficients_in, cramer, determinant, irreducible_factors, primitive
from .rational_functions import RationalFunction, as_function, factored, without_constant
from .tolerances import (
    BITS_OF_PRIMES,
    LONGEST_PERIOD_OF_ORDERS,
    LONGEST_TRANSIENT,
    MOST_BITS_OF_PROOF,
    MOST_LINES_TO_A_POINT,
    MOST_MONOMIALS_OF_PROOF,
    MOST_PRIMES_THAT_AGREE,
    MOST_TERMS_OF_CURVES,
    MOST_TERMS_OF_POINT,
    POINTS_SHOWN,
    STEPS_OF_REPEATED_ORDERS,
)

_PAIRS = (0, 1), (0, 2), (1, 2)  # pairs of coordinates
_TERMS = 8, 32, 128, 512  # numbers of terms of power series in t, tried in this order


class Passage(NamedTuple):
    """Orders in t of the images of germs c + t v, where c is a point of a contracted curve.

    Image k is the image after k = 1, 2, ... steps. At some k the image of c itself (t = 0) is a
    point without an image; orders are listed up to the last such k.
    """

    common_orders: tuple[int, ...]  # the power of t that divides the coordinates of image k + 1
    curve_orders: tuple[tuple[int, ...], ...]  # orders in t of curves' equations at image k
    steps: int | None  # the first k for which image k of the curve is a curve; None if none is
    endless: bool = False  # True if the last point without an image was not reached
    # If orders repeat with a period T, their generating functions are quotients: the denominator is
    # 1 - z^T, and the orders above are the coefficients of the numerators.
    period: int = 0


class Plane:
    """A birational map of the plane in homogeneous coordinates, and its contracted `curves`."""

    def __init__(self, map: RationalMap) -> None:
        self.map, self.symbolic, self.degree = map, len(map.letters), map.degree
        self.ring = polynomials.polynomial_ring(3, map.letters)
        x = self.ring.gens()[self.symbolic :]
        self.forms = [polynomials.homogenized(F, self.degree, x, self.ring) for F in map.forms]
        derivatives = [[F.derivative(self.symbolic + j) for j in range(3)] for F in self.forms]
        powers = irreducible_factors(determinant(derivatives)) if self.degree > 1 else []
        self.curves = [P for P, _ in powers if polynomials.degree_of(P)]
        self.degrees = [polynomials.degree_of(P) for P in self.curves]

    def text(self, number: int) -> str:
        """Return the equation of a contracted curve, given by its number, as text."""
        P = polynomials.renamed(self._affine(number), self.map.names, self.map.letter)
        return "the line at infinity" if P == 1 else polynomials.decoded(f"{P} = 0")

    def is_long(self, number: int) -> bool:
        """Return True for conjugate curves with several letters whose points are not followed."""
        several = self.symbolic > 1 and self.degrees[number] > 1
        return several and len(self.curves[number]) > MOST_TERMS_OF_CURVES

    def count(self, number: int) -> int:
        """Return the number of complex curves into which the contracted curve `number` splits."""
        return max(1, count_factors(self._affine(number)))

    def _affine(self, number: int) -> Any:
        ring = self.map.ring
        return primitive(self.curves[number].compose(*ring.gens(), ring.constant(1), ctx=ring))


class Step(NamedTuple):
    """One step of a germ: a curve through a point, given by power series in t."""

    germ: list[Any]  # the image, divided by t**common_order
    common_order: int
    curve_orders: tuple[int, ...]  # orders in t of curves' equations on the germ before the step


class PlaneModulo:
    """A `Plane` modulo a prime, with numbers in place of letters; it follows germs step by step."""

    def __init__(self, plane: Plane, p: int, eps: Values, seed: int) -> None:
        self.p, self.rng = p, random.Random(seed)
        self.forms = [polynomials.modulo(F, p, eps) for F in plane.forms]
        self.curves = [polynomials.modulo(C, p, eps) for C in plane.curves]
        # Each monomial is evaluated once, for all polynomials that contain the monomial.
        terms = [P.to_dict() for P in (*self.forms, *self.curves)]
        self._monomials = tuple({e: None for of_one in terms for e in of_one})
        self._terms = [[(e, int(c)) for e, c in of_one.items()] for of_one in terms]

    def component(self, number: int) -> Any:
        """Return the first of `components`; None without any."""
        return next(self.components(number), None)

    def components(self, number: int) -> Iterator[Any]:
        """Yield the components of curve `number` modulo p on which germs can begin.

        A curve may split modulo p, into conjugate lines that are contracted to different points.
        """
        P = self.curves[number]
        if P != 0:
            for factor, _ in sorted(P.factor()[1], key=lambda f: int(f[0].total_degree())):
                if factor.total_degree() > 0 and self.germ(factor) is not None:
                    yield factor

    def length(self, component: Any, most: int) -> int | None:
        """Return the number of points, up to `most`, of the orbit of a curve; None for more."""
        x = [P[0] for P in self.germ(component) or ()]
        for n in range(most + 1):
            x = [F(*x) for F in self.forms] if x else []
            if not any(x):
                return n
        return None

    def germ(self, component: Any) -> list[Any] | None:
        """Return a germ: three polynomials c + t v, c a random zero of `component`; or None."""
        p = self.p
        for _ in range(MOST_LINES_TO_A_POINT):
            ends = [(self.rng.randrange(p), self.rng.randrange(p)) for _ in range(3)]
            on_line = polynomials.value_at(component, [flint.nmod_poly([*end], p) for end in ends])
            if on_line.degree() < 1:
                continue
            for root, multiplicity in on_line.roots():
                if multiplicity == 1:
                    point = [a + b * int(root) for a, b in ends]
                    return [flint.nmod_poly([c, self.rng.randrange(p)], p) for c in point]
        return None

    def step(self, germ: Sequence[Any], terms: int) -> Step | None:
        """Return the `Step` of a germ with `terms` powers of t; None if all are 0 in its image."""
        values = polynomials.monomial_values(self._monomials, germ)
        by_monomial = dict(zip(self._monomials, values, strict=True))
        series = [
            sum((c * by_monomial[e] for e, c in of_one), 0 * germ[0]) for of_one in self._terms
        ]
        image, curve_orders = series[:3], tuple(_order(P, terms) for P in series[3:])
        common_order = min(_order(P, terms) for P in image)
        if common_order == terms:
            return None
        divided = [flint.nmod_poly(P.coeffs()[common_order:terms], self.p) for P in image]
        return Step(divided, common_order, curve_orders)

    def orders(self, component: Any, steps: int) -> list[tuple[int, ...]]:
        """Return (common order, *curve orders) of up to `steps` images of a germ at a curve."""
        germ, terms, found = self.germ(component), _TERMS[-1], list[tuple[int, ...]]()
        while len(found) <= steps and germ and (step := self.step(germ, terms)):
            found.append((step.common_order, *step.curve_orders))
            germ = step.germ
            terms -= step.common_order
        return found[1:]

    def passage(self, component: Any, most: int) -> Passage | None:
        """Return the `Passage` of two germs from the curve `component`; None if orders differ."""
        for terms in _TERMS:
            germs = [self.germ(component) for _ in range(2)]
            if None in germs:
                return None
            passage = self._follow(germs, terms, most)
            if passage is None or not passage.endless:
                return passage
        return passage

    def _follow(self, germs: Any, terms: int, most: int) -> Passage | None:
        """Return the `Passage` of two germs, series with `terms` powers of t.

        Return None if steps of the two germs have different orders in t. The passage is `endless`
        if it needs more terms, or more than `most` steps.
        """
        common_orders: list[int] = []
        curve_orders: list[tuple[int, ...]] = []
        exact = 0  # steps up to which orders of curves are exact: all are less than `terms`
        steps: int | None = None
        endless = Passage((), (), None, endless=True)
        for k in range(most + 1):
            if k and not self._at_one_point(*germs):
                steps = k
                break
            first, second = (self.step(germ, terms) for germ in germs)
            if first is None or second is None:
                return endless
            if first._replace(germ=second.germ) != second:
                return None
            germs = first.germ, second.germ
            if k:
                if exact == k - 1 and max(first.curve_orders) < terms:
                    exact = k
                common_orders.append(first.common_order)
                curve_orders.append(first.curve_orders)
            terms -= first.common_order
        # After `last` steps the germ is at the last point without an image.
        last = max((k for k, order in enumerate(common_orders, start=1) if order), default=0)
        never_stops = steps is None and last > len(common_orders) // 2
        if last > exact or never_stops:
            return endless
        return Passage(tuple(common_orders[:last]), tuple(curve_orders[:last]), steps)

    def _at_one_point(self, first: Sequence[Any], second: Sequence[Any]) -> bool:
        """Return True if two germs begin at the same point."""
        a, b = ([int(P[0]) for P in germ] for germ in (first, second))
        return all((a[i] * b[j] - a[j] * b[i]) % self.p == 0 for i, j in _PAIRS)


def _order(P: Any, terms: int) -> int:
    """Return the lowest power of t among `terms` terms of a series P; `terms` if all are 0."""
    return next((k for k, c in enumerate(P.coeffs()[:terms]) if c), terms)


def passages_across(plane: Plane, most: int) -> list[Passage] | None:
    """Return the `Passage` from each curve by up to `most` steps; None unless two primes agree."""
    rng, numbers = plane.map.generator(), range(len(plane.curves))
    of_primes: list[list[Passage]] = [[] for _ in numbers]
    agreed: dict[int, Passage] = {}
    for _ in range(MOST_PRIMES_THAT_AGREE):
        p = arithmetic.random_prime(rng, BITS_OF_PRIMES)
        residues = PlaneModulo(plane, p, arithmetic.random_values(rng, p), rng.getrandbits(30))
        for number in numbers:
            if number in agreed or (component := residues.component(number)) is None:
                continue
            if (passage := residues.passage(component, most)) in of_primes[number]:
                agreed[number] = passage
            elif passage is not None:
                of_primes[number].append(passage)
        if len(agreed) == len(numbers):
            return [agreed[number] for number in numbers]
    return None


def periodic_passage(plane: Plane, number: int) -> Passage | None:
    """Return the `Passage` of an endless orbit whose orders repeat modulo two primes; else None."""
    rng, found = plane.map.generator(number), list[list[Any]]()
    for _ in range(MOST_PRIMES_THAT_AGREE):
        p = arithmetic.random_prime(rng, BITS_OF_PRIMES)
        residues = PlaneModulo(plane, p, arithmetic.random_values(rng, p), rng.getrandbits(30))
        if (component := residues.component(number)) is not None:
            found.append(orders := residues.orders(component, STEPS_OF_REPEATED_ORDERS))
            if len(orders) == STEPS_OF_REPEATED_ORDERS and found.count(orders) > 1:
                break
    else:
        return None
    for start in range(LONGEST_TRANSIENT):
        for period in range(1, LONGEST_PERIOD_OF_ORDERS + 1):
            if orders[start:-period] == orders[start + period :]:
                numerators = [
                    [
                        order - before
                        for order, before in zip(sequence, [0] * period + [*sequence], strict=False)
                    ][: start + period]
                    for sequence in zip(*orders, strict=True)
                ]
                common, *curves = map(tuple, numerators)
                return Passage(common, (*zip(*curves, strict=True),), None, period=period)
    return None


_TERMS_OF_PROOFS = 4, 8, 16, 32  # numbers of terms of power series in t, tried in this order
_NUMBERS = range(1, 9)  # numbers that are tried in place of s, the parameter of points


def is_proved(plane: Plane, number: int, passage: Passage) -> bool:
    """Return True if the orders in the `passage` of curve `number` are proved to be exact.

    The orders were found modulo primes. Such an order may be too large, never too small. So an
    order 0 is exact.
    """
    if not passage.common_orders:
        return passage.steps is None
    if plane.is_long(number):
        return False
    germs = Germs(plane, number)
    if germs.have_multiplicities(passage):
        return True
    expected = [*zip(passage.common_orders, passage.curve_orders, strict=True)]
    for terms in _TERMS_OF_PROOFS if germs.first else ():
        followed = germs.orders(terms, len(expected))
        if followed is None:
            return False
        orders, last = followed
        if orders == expected:
            return germs.begin_at_point(last) == (passage.steps is None)
    return False


def points_of_orbit(
    plane: Plane, number: int, passage: Passage
) -> tuple[tuple[tuple[RationalFunction, ...], ...], RationalFunction | None]:
    """Return the points that curve `number` visits, and the polynomial of their root or None."""
    if plane.is_long(number):
        return (), None
    germs = Germs(plane, number)
    count = POINTS_SHOWN if passage.steps is None else passage.steps - 1
    coordinates = [*islice(germs.points(passage, count), count)]
    return germs.for_users(coordinates)


_OF_POINTS = ((2, 3), (5, 7), (11, -4)), ((3, -5), (7, 2), (4, 9))  # lines with points of curves


class Germs:
    """Exact germs at a curve: polynomials in t, s (which point), r (which line) and eps."""

    def __init__(self, plane: Plane, number: int, line: int = 0) -> None:
        self._plane, self._curve, self._line = plane, plane.curves[number], _OF_POINTS[line]
        names = [*(f"a{k}" for k in range(plane.symbolic)), "r", "s", "t"]
        self._ring = flint.fmpz_mpoly_ctx.get(names, ordering="deglex")
        *self._eps, self._r, self._s, self._t = self._ring.gens()
        self._modulus = self._r  # a monic polynomial with the root r; the polynomial r means r = 0
        degree, count = plane.degrees[number], 1
        if degree > 1:
            self._point, count = self._point_of_curve(), plane.count(number)
        else:
            self._point = self._point_of_line()
        gradient = self._values(self._slopes(self._curve), self._point)
        # The first germ if the curve consists of lines; [] for other curves.
        self.first = self._across_line(gradient) if degree == count else []
        if self.first and _order_in_t(self._values([self._curve], self.first, 2)[0], 2) != 1:
            self.first = []

    def _point_of_curve(self) -> list[Any]:
        """Return a point of the curve on a fixed line; coordinates are polynomials in a root r."""

        def on_line(unit: Any) -> list[Any]:
            return [a * unit + b * self._r for a, b in self._line]

        P = self._curve.compose(*self._eps, *on_line(self._ring.constant(1)), ctx=self._ring)
        every = (coefficients_in(f, -3) for f, _ in irreducible_factors(P))
        *lower, leading = next(coefficients for coefficients in every if len(coefficients) > 1)
        n = len(lower)
        terms = (c * leading ** (n - 1 - k) * self._r**k for k, c in enumerate(lower))
        self._modulus = sum(terms, self._r**n)  # its roots: `leading` times those of a factor of P
        return on_line(leading)

    def _point_of_line(self) -> list[Any]:
        """Return a point of the curve, a line; coordinates are polynomials in letters."""
        a, b, c = self._values(self._slopes(self._curve), [self._ring.constant(1)] * 3)
        i, j, k = (first for first, _ in self._line)  # of a line that meets the curve there
        return without_common_factor([b * k - c * j, c * i - a * k, a * j - b * i])

    def _across_line(self, line: list[Any]) -> list[Any]:
        """Return a germ at a line with these coefficients: line . germ is a multiple of t."""
        pivot = next(j for j in range(3) if line[j] != 0)
        i, j = (k for k in range(3) if k != pivot)
        u, v = 2 + 3 * self._s, 5 + 7 * self._s
        germ = [0 * self._s] * 3
        germ[i], germ[j] = line[pivot] * u, line[pivot] * v
        germ[pivot] = self._t - line[i] * u - line[j] * v
        return germ

    def _slopes(self, P: Any) -> list[Any]:
        return [P.derivative(self._plane.symbolic + j) for j in range(3)]

    def _values(self, forms: Sequence[Any], x: Sequence[Any], terms: int = 1) -> list[Any]:
        """Return the values of forms at x, without the powers t**k with k >= `terms`."""
        values = (F.compose(*self._eps, *x, ctx=self._ring) for F in forms)
        return [self._reduced(P % self._t**terms) for P in values]

    def _reduced(self, P: Any) -> Any:
        """Return the remainder of P modulo the polynomial that has the root r."""
        n = int(self._modulus.degrees()[-3])
        while (k := int(P.degrees()[-3])) >= n:
            P -= coefficients_in(P, -3)[k] * self._r ** (k - n) * self._modulus
        return P

    def orders(
        self, terms: int, steps: int
    ) -> tuple[list[tuple[int, tuple[int, ...]]], list[Any]] | None:
        """Follow the germ `first`; return its orders in t at each step, and the last germ.

        The orders are (common order, curve orders): powers of t that divide the coordinates, and
        the equations of curves, on images of the germ. There are `steps` steps, or fewer if `terms`
        powers of t do not suffice. The result is None if coordinates become too large.
        """
        germ, orders = self.first, []
        for k in range(steps + 1):
            image = self._values(self._plane.forms, germ, terms)
            order = min(_order_in_t(P, terms) for P in image)
            if order == terms:
                break
            if k:
                curves = self._values(self._plane.curves, germ, terms)
                orders.append((order, tuple(_order_in_t(P, terms) for P in curves)))
            germ = without_common_factor([P // self._t**order for P in image])
            terms -= order
            if _is_large(germ):
                return None
        return orders, germ

    def values_along(self, steps: int, most: int) -> Iterator[list[Any]]:
        """Yield the values of the forms at points n = 1, ..., `steps` of the orbit of a point.

        Coordinates of these points have no common factor. Values that are all 0, at a point without
        an image, are the last ones, or those with over `most` terms.
        """
        x = self._point
        for n in range(steps + 1):
            image = self._values(self._plane.forms, x)
            if n:
                yield image
            if not any(image) or sum(map(len, image)) > most:
                return
            x = without_common_factor(image)
            x = x if self._modulus == self._r else self._simplest(x)

    def points(self, passage: Passage, count: int) -> Iterator[list[Any]]:
        """Yield the coordinates of points of the orbit while they are short, up to `count` points.

        Points that follow points without an image are limits of germs.
        """
        if not any(passage.common_orders[:-1]) and not passage.endless:
            x = self._point
            while any(image := self._values(self._plane.forms, x)):
                x = without_common_factor(image)
                x = x if self._modulus == self._r else self._simplest(x)
                if sum(map(len, x)) > MOST_TERMS_OF_POINT:
                    return
                yield x
            return
        # Two points of the curve, given by numbers for s, must have the same orbit.
        numbers = [n + 0 * self._s for n in (5, 7)]
        germs = [[P.compose(*self._eps, self._r, n, self._t) for P in self.first] for n in numbers]
        terms = _TERMS_OF_PROOFS[-1]
        for _ in range(count if self.first else 0):
            orders = set()
            for k, germ in enumerate(germs):
                image = self._values(self._plane.forms, germ, terms)
                orders.add(order := min(_order_in_t(P, terms) for P in image))
                if order == terms or _is_large(image):
                    return
                germs[k] = without_common_factor([P // self._t**order for P in image])
            terms -= max(orders)
            x, y = (without_common_factor([P % self._t for P in germ]) for germ in germs)
            if len(orders) > 1 or any(x[i] * y[j] != x[j] * y[i] for i, j in _PAIRS):
                return
            if sum(map(len, x)) > MOST_TERMS_OF_POINT:
                return
            yield x

    def for_users(
        self, points: Sequence[Any]
    ) -> tuple[tuple[tuple[RationalFunction, ...], ...], RationalFunction | None]:
        """Return points with functions of letters, and of r, as coordinates; and its polynomial."""
        is_line, letters = self._modulus == self._r, self._plane.map.letters
        root_name = next(name for name in ("r", "s") if name not in letters)
        names = letters if is_line else (*letters, root_name)
        ring, name = polynomials.polynomial_ring(0, names), names[0] if len(names) == 1 else ""

        def function(P: Any) -> RationalFunction:
            P = ring.from_dict({e[: len(names)]: c for e, c in P.to_dict().items()})
            return factored(P).renamed(None, name)

        if not is_line and not letters:
            field = NumberField(_in_r(self._modulus))
            simple, root = field.simplest([[*map(_in_r, x)] for x in points])
            known = tuple(tuple(function_of_root(P, root_name) for P in x) for x in simple)
            return known, root and without_constant(function_of_root(root, root_name))
        found = []
        for x in points:
            last = next(P for P in reversed(x) if P != 0)
            scale = function(last) if int(last.degrees()[-3]) <= 0 else as_function(1)
            found.append(tuple(function(P) / scale for P in x))
        contains_root = any(int(P.degrees()[-3]) > 0 for x in points for P in x)
        root = without_constant(function(self._modulus)) if contains_root else None
        return (*found,), root

    def norm(self, P: Any) -> Any:
        """Return the product of the values of P, polynomials in letters, for all roots r."""
        return P if self._modulus == self._r else self._modulus.resultant(P, "r")

    def have_multiplicities(self, passage: Passage) -> bool:
        """Return True if the orders in `passage` are multiplicities of polynomials at the orbit.

        Such orders are exact. The tests are that derivatives of lower order are 0 at these points,
        and that only the last point has no image.
        """
        x, steps = self._point, len(passage.common_orders)
        if any(passage.common_orders[:-1]) or passage.steps is None:
            return False
        for k in range(steps + 1):
            if k:
                orders = [*zip(self._plane.curves, passage.curve_orders[k - 1], strict=True)]
                orders += [(F, passage.common_orders[k - 1]) for F in self._plane.forms]
                for P, order in orders:
                    derivatives = [P] if order else []
                    for _ in range(order - 1):
                        derivatives = [slope for D in derivatives for slope in self._slopes(D)]
                    if any(self._values(derivatives, x)):
                        return False
            image = self._values(self._plane.forms, x)
            if not any(image) or k == steps:
                return not any(image) and k == steps
            x = self._simplest(without_common_factor(image))
            if _is_large(x):
                return False
        return False

    def _simplest(self, x: list[Any]) -> list[Any]:
        """Return the point x in homogeneous coordinates, one of which does not contain r."""
        n, last = int(self._modulus.degrees()[-3]), next(P for P in reversed(x) if P != 0)
        zeros = [self._ring.constant(0)] * n

        def coefficients(P: Any) -> list[Any]:
            return [*coefficients_in(P, -3), *zeros][:n]

        # A linear system gives 1 / `last`, up to a factor: this coordinate becomes free of r.
        products = [coefficients(self._reduced(last * self._r**k)) for k in range(n)]
        *inverse, _ = cramer([*map(list, zip(*products, coefficients(self._r**0), strict=True))])
        multiple = sum(c * self._r**k for k, c in enumerate(inverse))
        return without_common_factor([self._reduced(P * multiple) for P in x])

    def begin_at_point(self, germ: Sequence[Any]) -> bool:
        """Return True if a germ begins at the same point for all s."""
        x = [P % self._t for P in germ]
        for number in _NUMBERS:
            y = [P.compose(*self._eps, self._r, number + 0 * self._s, self._t) for P in x]
            if any(y):
                return all(self._reduced(x[i] * y[j] - x[j] * y[i]) == 0 for i, j in _PAIRS)
        return False


def _in_r(P: Any) -> Any:
    """Return a polynomial in r alone, with numbers as coefficients."""
    return flint.fmpq_poly([int(c.coeffs()[0]) if c != 0 else 0 for c in coefficients_in(P, -3)])


def _order_in_t(P: Any, terms: int) -> int:
    """Return the lowest power of t in a polynomial, or `terms` if the polynomial is 0."""
    return min((int(e[-1]) for e in P.monoms()), default=terms)


def without_common_factor(x: Sequence[Any]) -> list[Any]:
    """Return polynomials x, divided by the largest common factor free of the last variable."""
    common = reduce(lambda P, Q: P.gcd(Q), (c for P in x for c in coefficients_in(P, -1)))
    return [P // common for P in x]


def _is_large(x: Sequence[Any]) -> bool:
    """Return True if coordinates x have too many terms, or too large numbers, to continue."""
    bits = max((int(abs(c)).bit_length() for P in x for c in P.coeffs()), default=0)
    return bits > MOST_BITS_OF_PROOF or sum(map(len, x)) > MOST_MONOMIALS_OF_PROOF
