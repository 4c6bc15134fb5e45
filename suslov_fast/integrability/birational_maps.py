"""Exact birational maps Phi, x_i~ = F_i(x) / F_0(x): the base class of Kahan maps and other maps.

The pullback of a polynomial P of degree d is F_0**d P(F / F_0). If P(Phi) = C P, then P is a
Darboux polynomial, and C is its cofactor.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any

import flint
import numpy as np

from ..checks import wrong
from ..core.cached import cached_property
from ..fields.names import labels
from ..keywords import public
from . import arithmetic, polynomials, rational_functions
from .arithmetic import EPS, Point, Values
from .polynomials import coprime, degree_of, irreducible_factors, modulo, sort_key, value_at
from .rational_functions import RationalFunction, factored, over_common_denominator, rational_roots
from .tolerances import (
    FEW_MONOMIALS,
    LONGEST_PULLBACK,
    MOST_TERMS_FACTORED,
    MOST_TERMS_FACTORED_IN_LETTERS,
)


class RationalMap(rational_functions.WithLetters):
    """An exact birational map x_i~ = F_i(x) / F_0(x), made by `rational_map`.

    Called with a point, D rational numbers, it returns the next point, a tuple of fractions. At a
    pole, a point without an image, methods raise `ZeroDivisionError`. `inverse` may be None.
    """

    letters: tuple[str, ...] = ()  # symbols in the coefficients, such as eps
    names: tuple[str, ...] | None  # names of the variables, if not x1, ..., xD
    given: Mapping[str, Fraction]  # the values that letters had in a `Map`
    inverse: Any
    forms: Any  # polynomials F_1, ..., F_D, F_0 without a common factor
    hamiltonian: Any = None  # Hamiltonian of the field of a Kahan map, a polynomial
    modified_energy: Any = None  # the first integral H + O(eps) of this map; None if constant
    _latest: tuple[Any, Any] = None, None  # the last modulus, and the forms modulo it
    _latest_numbers: Any = None, None  # the last numbers for letters, and the map for them

    def __init__(
        self,
        forms: Sequence[Any],
        inverse: RationalMap | None = None,
        letters: Sequence[str] = (),
        names: tuple[str, ...] | None = None,
        given: Mapping[str, Fraction] | None = None,
    ) -> None:
        if callable(forms):
            raise TypeError("RationalMap: a function f of x makes a map by Map(f, names)")
        self.dimension, self.forms, self.inverse = len(forms) - 1, list(forms), inverse
        self.letters, self.names, self.given = tuple(letters), checked_names(names), given or {}

    @property
    def formulas(self) -> tuple[RationalFunction, ...]:
        """The components F_i / F_0 of the map, as functions of its variables and letters."""
        return rational_functions.quotients_of(self.forms, self.names, self.letter)

    def __repr__(self) -> str:
        return f"rational_map({', '.join(map(str, self.formulas))})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RationalMap) and self.__reduce__() == other.__reduce__()

    def __hash__(self) -> int:
        return hash(self.dimension)  # a fast hash, because points are cached by map

    def __reduce__(self) -> Any:
        return RationalMap, (self.forms, self.inverse, self.letters, self.names, self.given)

    def _with(self, numbers: Mapping[str, Fraction]) -> RationalMap:
        values = [arithmetic.fmpq(a) for a in self._all_numbers(numbers)]
        forms = polynomials.cleared(*(modulo(F, 0, values) for F in self.forms))
        if not any(forms) or forms[-1] == 0:
            where = ", ".join(f"{name} = {a}" for name, a in numbers.items())
            raise ArithmeticError(f"{self} is no map at {where}")
        inverse = self.inverse and self.inverse._with(numbers)
        return RationalMap(coprime(forms), inverse, names=self.names)

    def at_eps(self, values: Values) -> RationalMap:
        """Return the map with the numbers `values` in place of its letters, if it has any."""
        if not self.is_symbolic:
            return self
        latest = self._latest_numbers
        if latest[0] != values:
            latest = self._latest_numbers = values, self._at_numbers(values)
        return latest[1]

    def _at_numbers(self, values: Values) -> RationalMap:
        return self._with(dict(zip(self.letters, map(Fraction, values), strict=False)))

    @cached_property
    def coefficients(self) -> list[int]:
        """The integer coefficients of F_1, ..., F_D, F_0, from which `prime` follows."""
        return [int(c) for F in self.forms for c in F.coeffs()]

    def generator(self, number: int = 0) -> random.Random:
        """Return a generator of random numbers, with a seed made of the map and a number."""
        return random.Random(f"{number} {self.prime}")

    @cached_property
    def prime(self) -> int:
        """The prime for computations that need only one; `coefficients` determine it."""
        return arithmetic.prime_for(self.coefficients)

    # Points are (x1, ..., xD, 1), of numbers of any kind.

    def homogeneous_image(self, x: Sequence[Any]) -> list[Any]:
        """Return a multiple of [F_1, ..., F_0] at a point [x1, ..., xD, 1] or D + 1 polynomials."""
        if self.is_symbolic:
            return [self.pullback(F, self.degree, x) for F in self.forms]
        if isinstance(x[0], flint.nmod | flint.fmpq):
            return self._values(x)[0]
        return [value_at(F, x, self.degree) for F in self.forms]

    def _values(self, x: Sequence[Any], slopes: bool = False) -> list[list[Any]]:
        """Return the row F_1, ..., F_D, F_0 at x, and, with `slopes`, a row grad F for each F."""
        modulus = arithmetic.moduli(x[0])
        if self._latest[0] != modulus:
            forms = [modulo(F, sum(modulus), EPS) for F in self.forms]
            derivatives = ([P.derivative(i) for i in range(self.dimension)] for P in forms)
            self._latest = modulus, [forms, *derivatives]
        rows, number = self._latest[1], type(x[0])
        rows = rows if slopes else rows[:1]
        return [[number(P(*x[:-1]), *modulus) for P in row] for row in rows]

    def coprime_image(self, x: Sequence[Any]) -> list[Any]:
        """Return [F_1, ..., F_0] at D + 1 polynomials x, divided by the greatest common divisor."""
        return coprime(self.homogeneous_image(x))

    def image(self, x: Sequence[Any]) -> list[Any]:
        try:
            *numerators, denominator = self.homogeneous_image(x)
            return [*(a / denominator for a in numerators), x[-1] ** 0]
        except ZeroDivisionError:
            where = ", ".join(map(str, x[:-1]))
            raise ZeroDivisionError(f"({where}) has no image: it is a pole of the map") from None

    def orbit(self, x: Sequence[Any], length: int) -> Iterator[Sequence[Any]]:
        for k in range(length):
            if k:
                x = self.image(x)
            yield x

    def variations(self, x: Sequence[Any], length: int) -> Iterator[tuple[Sequence[Any], Any]]:
        """Yield (y, matrix dy / dx) for `length` points y of the orbit of x modulo a prime."""
        p, identity = int(x[0].modulus()), np.eye(self.dimension, dtype=int)
        derivative = flint.nmod_mat(identity.tolist(), p)
        for y in self.orbit(x, length):
            yield y, derivative
            derivative = self.derivative(y) * derivative

    def derivative(self, x: Sequence[Any]) -> Any:
        """Return the matrix DPhi at a point: its rows are (grad F_i - Phi_i grad F_0) / F_0."""
        y, columns = self.image(x), range(self.dimension)
        (*_, below), *numerators, denominator = self._values(x, slopes=True)
        rows = [
            [row[i] - a * denominator[i] for i in columns]
            for a, row in zip(y, numerators, strict=False)
        ]
        return arithmetic.matrix(rows) * (1 / below)

    @public
    def __call__(self, point: Any) -> tuple[Any, ...]:
        """Return the image of a point, exactly; functions of eps if eps is symbolic.

        The point itself may consist of functions of eps, as in ``map(map(x))``.
        """
        if not isinstance(point, tuple) or not any(isinstance(a, RationalFunction) for a in point):
            if not self.is_symbolic:
                return tuple(map(arithmetic.fraction, self.image(self._numbers(point))[:-1]))
            point = arithmetic.rationals("point", point, self.dimension)
        functions = [rational_functions.as_function(a).in_ring(self.ring) for a in point]
        image = self.homogeneous_image(over_common_denominator(functions, self.ring))
        return rational_functions.quotients_of(image, self.names, self.letter)

    @public
    def jacobian(self, point: Any) -> tuple[Point, ...]:
        """Return the derivatives at a point, D exact numbers, as a tuple of rows of fractions."""
        rows = self.derivative(self._numbers(point)).tolist()
        return tuple(tuple(map(arithmetic.fraction, row)) for row in rows)

    @public
    def determinant(self, point: Any) -> Fraction:
        """Return the determinant of :meth:`jacobian` at a point, an exact fraction."""
        return arithmetic.fraction(self.derivative(self._numbers(point)).det())

    def _numbers(self, point: Any) -> list[Any]:
        if self.is_symbolic:
            how = f"set it by map.subs({self.letters[0]}=Fraction(1, 3)); for a formula of it "
            how += "sympy.Matrix([sympy.sympify(F) for F in map.formulas]).jacobian(symbols)"
            raise TypeError(f"{self.letters[0]} is symbolic here: {how}")
        x = arithmetic.rationals("point", point, self.dimension)
        return [arithmetic.fmpq(a) for a in (*x, 1)]

    # Kinds of maps.

    @cached_property
    def is_invertible(self) -> bool:
        """True if det DPhi has a value, not 0, at a random point modulo a prime."""
        try:
            x = arithmetic.random_point(self.dimension, self.prime)
            return bool(self.at_eps(EPS).derivative(x).det() != 0)
        except ZeroDivisionError:
            return False

    @property
    def is_birational(self) -> bool:
        """True if the map has a known inverse."""
        return self.inverse is not None and self.is_invertible

    @property
    def is_planar(self) -> bool:
        """True for a birational map of two variables, with a known inverse."""
        return self.dimension == 2 and self.is_birational

    # Polynomials.

    @cached_property
    def ring(self) -> Any:
        """The ring of polynomials in x, and in the letters."""
        return polynomials.polynomial_ring(self.dimension, self.letters)

    @property
    def variables(self) -> list[Any]:
        """The list [x1, ..., xD, 1] of polynomials of `ring`."""
        return [*self.ring.gens()[len(self.letters) :], self.ring.constant(1)]

    @cached_property
    def degree(self) -> int:
        """The degree of the map in homogeneous coordinates: the highest of F_1, ..., F_D, F_0."""
        return max(map(degree_of, self.forms))

    @property
    def denominator(self) -> Any:
        """The polynomial F_0, or a multiple of F_0; cofactors may contain its factors."""
        return self.forms[-1]

    def pullback(self, P: Any, degree: int, forms: Sequence[Any] | None = None) -> Any:
        """Return F_0^degree P(F / F_0), for `forms` F_1, ..., F_D, F_0, by default the map's."""
        return polynomials.homogenized(P, degree, forms or self.forms, self.ring)

    def pullbacks(self, space: polynomials.Polynomials) -> list[Any]:
        """Return F_0^d P(F / F_0) for all P, up to a common factor, for their highest degree d."""
        degree = max(map(degree_of, space))
        return [self.pullback(P, degree) for P in space]

    def cost_of_pullbacks(self, space: polynomials.Polynomials) -> float:
        """Return the estimated seconds for `pullbacks`."""
        degree = max(map(degree_of, space))
        return sum(self.cost_of_pullback(P, degree) for P in space)

    def terms_of_degree(self, degree: int) -> int:
        """Return the largest number of terms of a polynomial of this degree in x, for estimates."""
        degrees = zip(*(F.degrees()[: len(self.letters)] for F in self.forms), strict=True)
        letters = math.prod(1 + int(max(of_letter)) for of_letter in degrees)
        return math.comb(self.dimension + degree, self.dimension) * letters

    @cached_property
    def _monomials(self) -> int:
        """The number of different monomials in F_1, ..., F_0."""
        return len({e for F in self.forms for e in polynomials.exponents_in_x(F)})

    @cached_property
    def length(self) -> float:
        """The relative cost of the image of a line: 1 for a map of few monomials, else more."""
        return max(1.0, self._monomials * self.degree / FEW_MONOMIALS)

    def cost_of_pullback(self, P: Any, degree: int) -> float:
        """Return the estimated seconds for the pullback F_0^degree P(F / F_0) and its factors."""
        all_monomials = math.comb(self.dimension + self.degree, self.dimension)
        most = self.terms_of_degree(degree * self.degree) * self._monomials / all_monomials
        lengths = [len(F) for F in self.forms]
        exponents = ((*e, degree - sum(e)) for e in polynomials.exponents_in_x(P))
        powers = (zip(lengths, e, strict=True) for e in exponents)
        # Each term of P becomes a product of powers of forms. The power n of a form with t terms
        # has a term for each monomial of degree n in t variables.
        terms = (math.prod(math.comb(t + n - 1, n) for t, n in product) for product in powers)
        return 1e-9 * sum(min(most, count) for count in terms) * max(lengths)

    # The Jacobian determinant, its factors, and the cofactors that are products of these factors.

    def _determinant(self) -> RationalFunction | None:
        """Return det DPhi in factors; None if the factors are too long."""
        if self.cost_of_factors > LONGEST_PULLBACK:
            return None
        # The matrix with the rows (grad F_i, F_i) has the determinant F_0^(D + 1) det DPhi.
        places = range(len(self.letters), len(self.letters) + self.dimension)
        rows = [[*(F.derivative(i) for i in places), F] for F in self.forms]
        multiple = self._in_factors(polynomials.determinant(rows))
        return multiple and multiple / factored(self.forms[-1]) ** (self.dimension + 1)

    def _in_factors(self, P: Any) -> RationalFunction | None:
        """Return P in factors; None if it is too long after division by factors of the F_i."""
        most = MOST_TERMS_FACTORED if len(self.letters) < 2 else MOST_TERMS_FACTORED_IN_LETTERS
        known = [f for F in self.forms if len(F) <= most for f, _ in irreducible_factors(F)]
        powers = []
        for f in {str(f): f for f in known}.values():
            P, power = arithmetic.divided_out(P, f)
            powers.append((f, power))
        if len(P) > most:
            return None
        return factored(P) * rational_functions.product_of(powers, Fraction(1))

    @cached_property
    def jacobian_cofactor(self) -> RationalFunction | None:
        """The function det DPhi in factors; None if it is 0, or has too many terms to factor."""
        return self._determinant() if self.is_invertible else None

    @property
    def cost_of_factors(self) -> float:
        """An estimate of the seconds that `factors` takes."""
        return 2e-6 * self.terms_of_degree((self.dimension + 1) * (self.degree - 1))

    @cached_property
    def factors(self) -> list[Any] | None:
        """The irreducible factors of F_0 and of det DPhi; None if `jacobian_cofactor` is None."""
        if self.jacobian_cofactor is None:
            return None
        powers = (*self.jacobian_cofactor.factors, *irreducible_factors(self.denominator))
        return sorted({str(f): f for f, _ in powers if degree_of(f)}.values(), key=sort_key)

    @cached_property
    def _on_random_line(self) -> tuple[Any, ...]:
        """A random line modulo a prime, and F_1, ..., F_0 and `factors` as polynomials on it."""
        p = self.prime
        *line, _ = polynomials.random_line(self.dimension, p, random.Random(0))
        line.append(flint.nmod_poly([1], p))
        factors = [value_at(modulo(f, p, EPS), line) for f in self.factors or ()]
        return line, self.at_eps(EPS).homogeneous_image(line), factors

    def cofactor(self, P: Any) -> RationalFunction | None:
        """Return the cofactor C of a polynomial P, with P(Phi) = C P for the map Phi; or None.

        C is a constant times powers of the map's `factors`. A random line modulo a prime shows the
        powers, and values at random points the constant.
        """
        degree, (line, F, factors) = degree_of(P), self._on_random_line
        at_number, powers = modulo(P, self.prime, EPS), []
        numerator = value_at(at_number, F, degree)
        denominator = value_at(at_number, line) * F[-1] ** degree
        for f, divisor in zip(self.factors or (), factors, strict=True):
            numerator, more = arithmetic.divided_out(numerator, divisor)
            denominator, less = arithmetic.divided_out(denominator, divisor)
            powers.append((f, more - less))
        if any(a.degree() for a in coprime([numerator, denominator])):
            return None
        C = rational_functions.product_of(powers, Fraction(1))

        def search(p: int, eps: Values) -> list[int]:
            x = arithmetic.random_point(self.dimension, p, random.Random(p))
            here, there = (modulo(P, p, eps)(*y[:-1]) for y in (x, self.at_eps(eps).image(x)))
            return [-int(flint.nmod(int(there), p) / here / C.values_modulo(p, eps, [x])[0]), 1]

        constant = next(rational_roots(self.generator(), search, self.ring), None)
        return constant and constant * C


def checked_names(names: Any) -> Any:
    """Return `names` of variables, None for x1, ..., xD; raise an error if one of them is eps."""
    if "eps" in (names or ()):
        raise wrong("names", "no eps, which is the step size in formulas", ", ".join(names))
    return None if not names or names == labels(len(names)) else names


def check_one_letter(map: RationalMap) -> None:
    """Raise an error for a map with several letters."""
    if len(map.letters) > 1:
        numbers = ", ".join(f"{name}=1" for name in map.letters)
        received = f"{', '.join(map.letters)}: pass map.subs({numbers}), for example"
        raise wrong("map", "one with at most one letter", received)


def check_map(map: Any) -> None:
    """Raise an error unless `map` is a `RationalMap` that maps a random point, and its image."""
    if not isinstance(map, RationalMap):
        how = "pass a Field, a Map, kahan(field, eps) or rational_map(map, inverse)"
        raise TypeError(f"map is a {type(map).__name__}: {how}")
    x = arithmetic.random_point(map.dimension, map.prime)
    for why in ("is no map, because its equations have no solution", "has an image of poles"):
        try:
            x = map.at_eps(EPS).image(x)
        except ZeroDivisionError:
            raise ArithmeticError(f"{map} {why}") from None
