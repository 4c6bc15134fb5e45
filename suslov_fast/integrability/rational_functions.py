"""Rational functions in factors, ``c P_1**e_1 ... P_n**e_n`` with irreducible polynomials P_i.

Functions are functionally independent if the gradients of their logarithms, ``sum_i e_i grad P_i /
P_i``, are linearly independent at a random point, here modulo a prime.
"""

from __future__ import annotations

import math
import operator
import random
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import reduce
from typing import Any, TypeVar

import flint
import numpy as np

from ..checks import FloatArray, extra, real_array, short, wrong
from ..fields.latex import formula
from ..keywords import public
from . import arithmetic, polynomials
from .arithmetic import EPS, Values
from .interpolation import over_rationals
from .polynomials import Polynomials, decoded, degree_of, letters_of, modulo, value_at, variables_of

IDENTITY = "identity"
MODULAR = "modulo a prime, at random points"
L = TypeVar("L", bound="WithLetters")


class WithLetters:
    """The base of maps and functions with letters: symbols in their coefficients, such as eps."""

    letters: Any  # names of the letters
    _with: Any  # the method that returns the map or function with numbers for letters
    _may_lack_letters = False  # True for functions: `subs` without letters is no error

    @property
    def letter(self) -> str:
        """The name of the only letter; "" without one, or with several."""
        return self.letters[0] if len(self.letters) == 1 else ""

    @property
    def is_symbolic(self) -> bool:
        """True if eps, or another letter, is symbolic."""
        return bool(self.letters)

    @public
    def subs(self: L, *unnamed: Any, **values: Any) -> L:
        """Return the map or function for values of eps, or of other letters.

        Parameters
        ----------
        *unnamed, **values : int, Fraction, float or str
            The values of all letters, or of some letters of a function, by name. Values without a
            name are an error. A float is the decimal that was written, a string may be "1/3".

        Returns
        -------
        KahanMap, RationalMap or RationalFunction

        Examples
        --------
        >>> from suslov_fast import Field
        >>> from suslov_fast.integrability import kahan
        >>> (image,) = kahan(Field.from_terms([[[1]]]))([2])
        >>> image, image.subs(eps="1/3")
        (2/(-2*eps + 1), 6)
        """
        return self._with(self._numbers_for(values, unnamed))

    def _numbers_for(self, values: Mapping[str, Any], unnamed: Any) -> dict[str, Fraction]:
        """Return the numbers `values`, by letter, as fractions; raise an error for unnamed ones."""
        if not self.letters and not self._may_lack_letters:
            raise TypeError(f"{self} has no letter: its coefficients are numbers")
        if unnamed or (self.letters and (not values or {*values} - {*self.letters})):
            how = f"pass numbers by name, as {(self.letters or ('eps',))[0]}=Fraction(1, 3)"
            got = ", ".join([*map(short, unnamed), *values]) or "none"
            raise TypeError(f"{', '.join(self.letters) or self}: {how}, not {got}")
        return {name: arithmetic.constant(name, a) for name, a in values.items()}

    def _all_numbers(self, numbers: Mapping[str, Fraction]) -> list[Fraction]:
        """Return `numbers` in the order of the letters; raise an error if one is missing."""
        if missing := ", ".join(name for name in self.letters if name not in numbers):
            raise TypeError(f"{missing}: pass a number for each letter, by name")
        return [numbers[name] for name in self.letters]


@dataclass(frozen=True, repr=False)
class RationalFunction(WithLetters):
    """A product of powers of polynomials and a constant, exact.

    Called with a point, D rational numbers, it returns a fraction. Called with the states of an
    orbit, as ``F(run.states)``, it returns an array of floats. Functions and numbers can be
    combined by ``+``, ``-``, ``*``, ``/`` and powers. ``sympy.sympify(f)`` converts one to SymPy.
    In a report, `basis` says how a function was confirmed. `cofactor` is C for a Darboux polynomial
    P(Phi) = C P, and -1 for a density up to sign. `subs` replaces a symbolic letter by a number.
    """

    factors: tuple[tuple[Any, int], ...]  # polynomials and their exponents
    constant: Fraction = Fraction(1)
    basis: str = ""
    cofactor: RationalFunction | None = None
    _may_lack_letters = True

    @public
    def __call__(self, x: Any, *unnamed: Any, **values: Any) -> Any:
        """Return the value at a point as a fraction, or at states (..., n, D) as floats.

        If the function has letters, such as a symbolic eps, pass a number for each by name.
        """
        numbers = self._numbers_for(values, unnamed) if self.letters or unnamed else {}
        point = self._all_numbers(numbers)
        if np.ndim(x) > 1:
            return self._in_floats(real_array("x", x, allow_nan=True), [*map(float, point)])
        if self.factors:
            point += arithmetic.rationals("x", x, variables_of(self.factors[0][0]))
        powers = (Fraction(value_at(P, point)) ** e for P, e in self.factors)
        return math.prod(powers, start=self.constant)

    def _in_floats(self, x: FloatArray, letters: list[float]) -> FloatArray:
        """Return floats of shape (...) at states x (..., D), with numbers `letters` for letters."""
        product = np.full(x.shape[:-1], float(self.constant))
        for P, e in self.factors:
            if x.shape[-1] != (D := variables_of(P)):
                raise wrong("x", f"have the shape (..., {D})", x.shape)
            point = [*letters, *np.moveaxis(x, -1, 0)][-P.context().nvars() :]
            with np.errstate(all="ignore"):
                product = product * value_at(P, point) ** float(e)
        return product

    @property
    def letters(self) -> tuple[str, ...]:
        """The names of the symbols in the coefficients, such as eps."""
        return tuple(map(decoded, letters_of(self._ring))) if self.factors else ()

    def _with(self, values: Mapping[str, Fraction]) -> RationalFunction:
        numbers = {name: arithmetic.fmpq(a) for name, a in values.items()}
        try:
            powers = [factored(polynomials.with_values(P, numbers)) ** e for P, e in self.factors]
        except ZeroDivisionError:
            where = ", ".join(f"{name} = {a}" for name, a in values.items())
            raise ZeroDivisionError(f"{self} has no value at {where}") from None
        product = math.prod(powers, start=RationalFunction((), self.constant))
        cofactor = self.cofactor and self.cofactor._with(values)
        return replace(product, basis=self.basis, cofactor=cofactor)

    def __bool__(self) -> bool:
        return self.constant != 0

    def _sympy_(self) -> Any:
        """Return the formula for SymPy, with symbols also for names such as S, I, E, N and beta."""
        sympy, names = extra("sympy", "test"), self._ring.names() if self.factors else ()
        symbols = {name: sympy.Symbol(name) for name in map(decoded, names)}
        return sympy.sympify(str(self), symbols)

    def renamed(self, names: Sequence[str] | None, letter: str = "") -> RationalFunction:
        """Return the function with new `names` of variables and `letter`; None and "" keep them."""
        factors = tuple((polynomials.renamed(P, names, letter), e) for P, e in self.factors)
        cofactor = self.cofactor and self.cofactor.renamed(names, letter)
        return replace(self, factors=factors, cofactor=cofactor)

    def in_ring(self, ring: Any) -> RationalFunction:
        """Return the function with the letters and variables of a ring, in their order."""
        factors = tuple((ring.from_dict(P.to_dict()), e) for P, e in self.factors)
        return replace(self, factors=factors)

    def __mul__(self, other: Any) -> RationalFunction:
        other = as_function(other)
        basis = MODULAR if MODULAR in (self.basis, other.basis) else self.basis
        return product_of(self.factors + other.factors, self.constant * other.constant, basis)

    def __add__(self, other: Any) -> RationalFunction:
        other = as_function(other)
        ring = self._ring or other._ring or polynomials.polynomial_ring(0)
        *numerators, denominator = over_common_denominator((self, other), ring)
        return factored(sum(numerators)) / factored(denominator)

    __radd__ = __add__
    __rmul__ = __mul__

    def __neg__(self) -> RationalFunction:
        return self * -1

    def __sub__(self, other: Any) -> RationalFunction:
        return self + -as_function(other)

    def __rsub__(self, other: Any) -> RationalFunction:
        return as_function(other) - self

    def __truediv__(self, other: Any) -> RationalFunction:
        return self * as_function(other) ** -1

    def __rtruediv__(self, other: Any) -> RationalFunction:
        return as_function(other) / self

    def __pow__(self, power: int) -> RationalFunction:
        power = operator.index(power)
        if power < 0 and self.constant == 0:
            raise ZeroDivisionError("a denominator is 0")
        powers = tuple((P, power * e) for P, e in self.factors if power)
        return RationalFunction(powers, self.constant**power, self.basis)

    @property
    def numerator(self) -> Any:
        """The numerator as one polynomial of python-flint, in the letters and the variables."""
        return polynomials.with_plain_letters(self.as_quotient()[0])

    @property
    def denominator(self) -> Any:
        """The denominator as one polynomial of python-flint, in the letters and the variables."""
        return polynomials.with_plain_letters(self.as_quotient()[1])

    def as_quotient(self, ring: Any = None) -> tuple[Any, Any]:
        """Return numerator and denominator as polynomials; a constant needs their `ring`."""
        ring = ring or self._ring or polynomials.polynomial_ring(0)
        numerator = ring.constant(self.constant.numerator)
        denominator = ring.constant(self.constant.denominator)
        numerator *= math.prod(P**e for P, e in self._powers(1))
        denominator *= math.prod(P**e for P, e in self._powers(-1))
        return numerator, denominator

    @property
    def _ring(self) -> Any:
        return self.factors[0][0].context() if self.factors else None

    def _powers(self, sign: int) -> tuple[tuple[Any, int], ...]:
        """Return pairs (P, e), e > 0, of the numerator, or of the denominator if `sign` is -1."""
        return tuple((P, sign * e) for P, e in self.factors if sign * e > 0)

    @property
    def degree(self) -> int:
        """The degree in x of the numerator or of the denominator, whichever is larger."""
        return max(sum(degree_of(P) * e for P, e in self._powers(sign)) for sign in (1, -1))

    def values_modulo(self, p: int, eps: Sequence[int], points: Sequence[Any]) -> list[Any]:
        """Return the values modulo p at points (x1, ..., xD, 1), with numbers `eps` for letters."""
        values = [flint.nmod(arithmetic.fmpq(self.constant), p)] * len(points)
        for P, e in self.factors:
            P = modulo(P, p, eps)
            powers = (flint.nmod(P(*x[:-1]), p) ** e for x in points)
            values = [c * a for c, a in zip(values, powers, strict=True)]
        return values

    def gradient_of_logarithm(self, p: int) -> list[Any]:
        """Return grad log(f) at `arithmetic.random_point` modulo p, to find dependent functions."""
        n = variables_of(self.factors[0][0])
        x = arithmetic.random_point(n, p)
        powers = [(modulo(P, p, EPS), e) for P, e in self.factors]
        scaled = [(P, e / value_at(P, x)) for P, e in powers]
        return [sum(c * value_at(P.derivative(i), x) for P, c in scaled) for i in range(n)]

    def __hash__(self) -> int:
        return hash(str(self))

    def __repr__(self) -> str:
        return self.text()

    def text(self, longest: int | None = None) -> str:
        """Return the formula; polynomials over `longest` characters appear as degree and size."""
        is_one_polynomial = self.constant == 1 and [e for _, e in self.factors] == [1]

        def texts(number: int, sign: int) -> list[str]:
            powers = self._powers(sign)
            numbers = [] if number == 1 and powers else [str(number)]
            return numbers + [_power_text(P, e, is_one_polynomial, longest) for P, e in powers]

        numerator = "*".join(texts(abs(self.constant.numerator), 1))
        denominators = texts(self.constant.denominator, -1)
        denominator = "*".join(denominators)
        if len(denominators) > 1:
            denominator = f"({denominator})"
        minus = "-" if self.constant < 0 else ""
        return f"{minus}{numerator}" + (f"/{denominator}" if denominator != "1" else "")

    def _latex(self, _: Any) -> str:
        """Return the formula for ``sympy.latex``."""
        return formula(str(self)).replace(r"\mathrm{eps}", r"\varepsilon")

    def _repr_latex_(self) -> str:
        return f"$\\displaystyle {self._latex(None)}$"


def _power_text(P: Any, e: int, is_one_polynomial: bool, longest: int | None) -> str:
    """Return the text of P**e; a P of over `longest` characters appears as degree and size."""
    text = decoded(str(P))
    if longest is not None and len(text) > longest:
        text = f"[degree {degree_of(P)}, {len(P)} terms]"
    elif not is_one_polynomial and not re.fullmatch(r"[^\W\d]\w*|\d+", text):  # no name, no number
        text = f"({text})"
    return f"{text}^{e}" if e > 1 else text


# Functions from numbers and polynomials.


def as_function(value: Any) -> RationalFunction:
    """Return a number as a constant function, and a function unchanged."""
    if isinstance(value, RationalFunction):
        return value
    return RationalFunction((), arithmetic.constant("number", value))


def factored(P: Any) -> RationalFunction:
    """Return a polynomial as a `RationalFunction`, in irreducible factors."""
    if P == 0:
        return RationalFunction((), Fraction(0))
    powers = polynomials.irreducible_factors(P)
    leading = math.prod(int(f.leading_coefficient()) ** e for f, e in powers)
    return product_of(powers, arithmetic.fraction(flint.fmpq(P.leading_coefficient())) / leading)


def quotients_of(
    forms: Iterable[Any], names: Sequence[str] | None = None, letter: str = ""
) -> tuple[RationalFunction, ...]:
    """Return F_i / F_0 for polynomials F_1, ..., F_n, F_0, with new names as in `renamed`."""
    *numerators, denominator = (factored(F).renamed(names, letter) for F in forms)
    return tuple(F / denominator for F in numerators)


def without_constant(f: RationalFunction) -> RationalFunction:
    """Return f divided by its constant factor, which leaves primitive factors with fixed signs."""
    return RationalFunction(f.factors, basis=f.basis)


def quotient_of(P: Any, Q: Any, basis: str) -> RationalFunction:
    """Return P / Q in factors, up to a constant; `basis` says how the function was confirmed."""
    return replace(factored(P) / factored(Q), constant=Fraction(1), basis=basis)


def over_common_denominator(functions: Iterable[RationalFunction], ring: Any) -> list[Any]:
    """Return polynomials [N_1, ..., N_n, D] of a ring such that the functions are N_i / D."""
    pairs = [f.as_quotient(ring) for f in functions]
    common = reduce(lambda P, Q: P * Q // P.gcd(Q), (Q for _, Q in pairs), ring.constant(1))
    return [*(P * (common // Q) for P, Q in pairs), common]


def product_of(
    powers: Iterable[tuple[Any, int]], constant: Fraction, basis: str = ""
) -> RationalFunction:
    """Return constant * product of P**e for (P, e) in `powers`, with equal P merged, and sorted."""
    exponents: dict[str, tuple[Any, int]] = {}  # by texts of the polynomials
    for P, e in powers:
        exponents[str(P)] = P, exponents.get(str(P), (P, 0))[1] + e
    factors = [(P, e) for P, e in exponents.values() if e and constant]
    factors.sort(key=lambda power: polynomials.sort_key(power[0]))
    return RationalFunction(tuple(factors), constant, basis)


def rational_roots(rng: random.Random, search: Any, ring: Any) -> Iterator[RationalFunction]:
    """Yield the rational functions of letters that are roots of the polynomial of `search`."""
    for linear in (g for g in factors_in_t(rng, search, ring) if degree_of(g) == 1):
        *letters, t = linear.context().gens()
        slope = linear.derivative(len(letters))
        yield from quotients_of(P.project_to_context(ring) for P in (slope * t - linear, slope))


def factors_in_t(rng: random.Random, search: Any, ring: Any) -> Iterator[Any]:
    """Yield the irreducible factors of a polynomial in t and the letters of a ring.

    ``search(p, values)`` returns its coefficients modulo p, lowest first, with the numbers `values`
    for the letters of `ring`; or [] if there is no such polynomial.
    """
    letters = letters_of(ring)

    def row(p: int, values: Values) -> list[list[int]]:
        coefficients = [int(c) for c in search(p, values)]
        return [coefficients] if coefficients else []

    if not (rows := over_rationals(rng, row, len(letters))):
        return
    (f,) = polynomials.polynomials_with(rows, tuple((k,) for k in range(len(rows[0]))), letters)
    yield from (g for g, _ in polynomials.irreducible_factors(f) if degree_of(g))


# Independence.


def independent(candidates: Iterable[RationalFunction], p: int) -> tuple[RationalFunction, ...]:
    """Return a maximal set of functionally independent candidates, modulo p, low degrees first."""
    by_degree = sorted((f for f in candidates if f.degree), key=lambda f: f.degree)
    return tuple(independent_of((), by_degree, p))


def independent_of(known: Iterable[Any], candidates: Iterable[Any], p: int) -> Iterator[Any]:
    """Yield candidates that are independent, modulo p, of `known` functions and of earlier ones."""
    gradients = [f.gradient_of_logarithm(p) for f in known]
    for f in candidates:
        more = [*gradients, f.gradient_of_logarithm(p)]
        if flint.nmod_mat(more, p).rank() == len(more):
            gradients = more
            yield f


def rank_of_quotients(space: Polynomials) -> int:
    """Return how many quotients P / Q of polynomials are functionally independent."""
    quotients = (quotient_of(P, space[0], MODULAR) for P in space[1:])
    return len(independent(quotients, polynomials.prime_of(space)))
