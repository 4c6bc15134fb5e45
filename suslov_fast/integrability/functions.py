"""Rational functions, ``c P_1**e_1 ... P_n**e_n`` with irreducible polynomials P_i.

Their arithmetic and their text; they are independent if the gradients of their logarithms,
``sum_i e_i grad P_i / P_i``, at a random point modulo a prime are.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import reduce
from typing import Any

import flint

from ..bodies.names import latex
from ..checks import extra
from . import arithmetic
from .arithmetic import EPS, PRIME, Polynomials, decoded, degree_of, modulo, value_at

IDENTITY, MODULAR = "identity", "modulo a prime, at random points"
_NAME = r"[^\W\d]\w*"


@dataclass(frozen=True, repr=False)
class RationalFunction:
    """A product of powers of polynomials and a constant, exact.

    Called with a point, D rational numbers, it returns a fraction. Functions and numbers can be
    combined by ``+``, ``-``, ``*``, ``/`` and powers. ``sympy.sympify(str(f), f.symbols())``
    converts one to SymPy. In a report, `basis` says what a function rests on, and `cofactor` is
    that of a Darboux polynomial, or -1 for a density up to sign. If eps is symbolic, `subs`
    replaces it by a number, and `special` holds the rational values of eps for which a factor of
    the formula is 0 for all x.
    """

    factors: tuple[tuple[Any, int], ...]  # polynomials and their exponents
    constant: Fraction = Fraction(1)
    basis: str = ""
    cofactor: RationalFunction | None = None

    def __call__(self, x: Sequence[Any], eps: Any = None) -> Fraction:
        """Return the value at a point; a function with a symbolic eps needs its value."""
        if self.has_letter and eps is None:
            raise TypeError("eps is symbolic here: pass a number, as in f(x, eps=Fraction(1, 3))")
        point = [arithmetic.step_size(eps)] if self.has_letter else []
        point += [arithmetic.rational("x", a) for a in x]
        values = (Fraction(value_at(P, point)) ** e for P, e in self.factors)
        return math.prod(values, start=self.constant)

    @property
    def has_letter(self) -> bool:
        """True if eps is symbolic."""
        return any(arithmetic.has_letter(P) for P, _ in self.factors)

    def subs(self, eps: Any) -> RationalFunction:
        """Return the function of x alone for a value of eps.

        Examples
        --------
        >>> from suslov_fast import QuadraticField
        >>> from suslov_fast.integrability import kahan
        >>> (image,) = kahan(QuadraticField([[[1]]]))([2])
        >>> image, image.subs(eps="1/3")
        (2/(-2*eps + 1), 6)
        """
        value = arithmetic.step_size(eps)
        powers = (factored(modulo(P, 0, arithmetic.fmpq(value))) ** e for P, e in self.factors)
        try:
            found = math.prod(powers, start=RationalFunction((), self.constant))
        except ZeroDivisionError:
            raise ZeroDivisionError(f"{self} has no value at eps = {value}") from None
        return replace(
            found, basis=self.basis, cofactor=self.cofactor and self.cofactor.subs(value)
        )

    def symbols(self) -> dict[str, Any]:
        """Return the symbols of SymPy for the names in the formula.

        Without them SymPy takes names such as S, I, E, N and beta for objects of its own.

        Examples
        --------
        >>> import sympy
        >>> from suslov_fast import QuadraticField
        >>> from suslov_fast.integrability import report
        >>> (f,) = report(QuadraticField([[[0, 0], [0, 0]], [[1, 0], [0, 0]]])).integrals
        >>> f, sympy.sympify(str(f), locals=f.symbols())
        (x1, x1)
        """
        names = self._ring.names() if self.factors else ()
        return {name: extra("sympy", "test").Symbol(name) for name in map(decoded, names)}

    def renamed(self, names: Sequence[str] | None) -> RationalFunction:
        """Return the function with other names of its variables."""
        if names is None:
            return self
        factors = tuple((arithmetic.renamed(P, names), e) for P, e in self.factors)
        cofactor = self.cofactor and self.cofactor.renamed(names)
        return replace(self, factors=factors, cofactor=cofactor)

    @property
    def special(self) -> tuple[Fraction, ...]:
        """The rational eps at which a factor is 0 for all x."""
        found = set()
        for P, _ in self.factors:
            if degree_of(P) == 0 and P.total_degree() == 1:  # a * eps + b
                a, *b = map(int, P.coeffs())
                found.add(Fraction(-sum(b), a))
        return tuple(sorted(found))

    def __mul__(self, other: Any) -> RationalFunction:
        other = as_function(other)
        basis = MODULAR if MODULAR in (self.basis, other.basis) else self.basis
        return product_of(self.factors + other.factors, self.constant * other.constant, basis)

    def __add__(self, other: Any) -> RationalFunction:
        other = as_function(other)
        of = self._ring or other._ring or arithmetic.ring(0, False)
        *above, below = over_common_denominator((self, other), of)
        return factored(sum(above)) / factored(below)

    __radd__ = __add__
    __rmul__ = __mul__

    def __pos__(self) -> RationalFunction:
        return self

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
        """The numerator as one polynomial."""
        return self.quotient_in()[0]

    @property
    def denominator(self) -> Any:
        """The denominator as one polynomial."""
        return self.quotient_in()[1]

    def quotient_in(self, of: Any = None) -> tuple[Any, Any]:
        """Return numerator and denominator as polynomials, in a ring of as many variables."""
        of = of or self._ring or arithmetic.ring(0, False)
        above, below = map(of.constant, (self.constant.numerator, self.constant.denominator))
        above *= math.prod(P**e for P, e in self._powers(1))
        return above, below * math.prod(P**e for P, e in self._powers(-1))

    @property
    def _ring(self) -> Any:
        return self.factors[0][0].context() if self.factors else None

    def _powers(self, sign: int) -> tuple[tuple[Any, int], ...]:
        return tuple((P, sign * e) for P, e in self.factors if sign * e > 0)

    @property
    def degree(self) -> int:
        """The degree in x of the numerator or of the denominator, whichever is larger."""
        return max(sum(degree_of(P) * e for P, e in self._powers(sign)) for sign in (1, -1))

    def __hash__(self) -> int:
        return hash(str(self))

    def __repr__(self) -> str:
        return self.text()

    def text(self, longest: int | None = None) -> str:
        """Return the formula; polynomials of more characters are described in brackets."""
        alone = self.constant == 1 and [e for _, e in self.factors] == [1]
        parts = []
        for sign, number in ((1, abs(self.constant.numerator)), (-1, self.constant.denominator)):
            powers = self._powers(sign)
            texts = [] if number == 1 and powers else [str(number)]
            parts.append(texts + [_power_text(P, e, alone, longest) for P, e in powers])
        above, below = map("*".join, parts)
        below = f"({below})" if len(parts[1]) > 1 else below
        return f"{'-' if self.constant < 0 else ''}{above}{'' if below == '1' else f'/{below}'}"

    def _repr_latex_(self) -> str:
        text = re.sub(_NAME, lambda found: _latex_of_name(found[0]), str(self))
        if "/" in text:
            above, below = text.removeprefix("-").split("/")
            above = re.sub(r"^\(([^()]*)\)$", r"\1", above)
            below = re.sub(r"^\((.*)\)$", r"\1", below)
            text = f"{'-' * (self.constant < 0)}\\frac{{{above}}}{{{below}}}"
        text = re.sub(r"\^(\d+)", r"^{\1}", text.replace("*", " "))
        return f"$\\displaystyle {text}$"


def _latex_of_name(name: str) -> str:
    if name == "eps":
        return r"\varepsilon"
    if text := latex(name):
        return text
    stem = name.rstrip("0123456789")
    word, index = stem.rstrip("_").replace("_", r"\_"), name[len(stem) :]
    return rf"\mathrm{{{word}}}" + (f"_{{{index}}}" if index else "")


def _power_text(P: Any, e: int, alone: bool, longest: int | None) -> str:
    text = decoded(str(P))
    if longest is not None and len(text) > longest:
        text = f"[degree {degree_of(P)}, {len(P)} terms]"
    elif not alone and not re.fullmatch(rf"{_NAME}|\d+", text):
        text = f"({text})"
    return f"{text}^{e}" if e > 1 else text


def as_function(value: Any) -> RationalFunction:
    """Return a number as a constant function, and a function unchanged."""
    if isinstance(value, RationalFunction):
        return value
    return RationalFunction((), arithmetic.rational("number", value))


def factored(P: Any) -> RationalFunction:
    """Return a polynomial in irreducible factors."""
    if P == 0:
        return RationalFunction((), Fraction(0))
    powers = arithmetic.factors(P)
    leading = math.prod(int(f.leading_coefficient()) ** e for f, e in powers)
    return product_of(powers, arithmetic.fraction(flint.fmpq(P.leading_coefficient())) / leading)


def without_content(P: Any) -> Any:
    """Return a polynomial without factors that do not depend on x."""
    if not arithmetic.has_letter(P):
        return arithmetic.primitive(P)
    powers = arithmetic.factors(P)
    return math.prod((f**e for f, e in powers if degree_of(f)), start=P.context().constant(1))


def without_constant(f: RationalFunction) -> RationalFunction:
    """Return the multiple without a constant: all factors are primitive, with one sign each."""
    return RationalFunction(f.factors, basis=f.basis)


def quotient_of(P: Any, Q: Any, basis: str) -> RationalFunction:
    """Return a quotient of polynomials in irreducible factors, without a constant."""
    return replace(factored(P) / factored(Q), constant=Fraction(1), basis=basis)


def over_common_denominator(functions: Iterable[RationalFunction], of: Any) -> list[Any]:
    """Return numerators over a common denominator, and this one, as polynomials in a ring."""
    pairs = [f.quotient_in(of) for f in functions]
    common = reduce(lambda a, b: a * b // a.gcd(b), (Q for _, Q in pairs), of.constant(1))
    return [*(P * (common // Q) for P, Q in pairs), common]


def product_of(
    powers: Iterable[tuple[Any, int]], constant: Fraction, basis: str = ""
) -> RationalFunction:
    """Return a product of powers of primitive polynomials, in the order of their size."""
    total: dict[str, tuple[Any, int]] = {}
    for P, e in powers:
        total[str(P)] = P, total.get(str(P), (P, 0))[1] + e
    chosen = [(P, e) for P, e in total.values() if e and constant]
    chosen.sort(key=lambda power: arithmetic.size(power[0]))
    return RationalFunction(tuple(chosen), constant, basis)


def independent(candidates: Iterable[RationalFunction]) -> tuple[RationalFunction, ...]:
    """Return independent functions of least degree, on which all others depend.

    Of functions of one degree the first ones are taken.
    """
    chosen: list[RationalFunction] = []
    rows: list[list[Any]] = []
    for f in sorted((f for f in candidates if f.degree), key=lambda f: f.degree):
        row = gradient_of_logarithm(f)
        if flint.nmod_mat([*rows, row], PRIME).rank() > len(rows):
            chosen, rows = [*chosen, f], [*rows, row]
    return tuple(chosen)


def gradient_of_logarithm(f: RationalFunction) -> list[Any]:
    """Return the gradient of log f at the random point of `arithmetic`, modulo its prime."""
    powers = [(modulo(P, PRIME, EPS), e) for P, e in f.factors]
    n = powers[0][0].context().nvars()
    x = arithmetic.random_point(n)
    scales = [(P, e / value_at(P, x)) for P, e in powers]
    return [sum(c * value_at(P.derivative(i), x) for P, c in scales) for i in range(n)]


def rank_of_quotients(polynomials: Polynomials) -> int:
    """Return the number of independent quotients of polynomials."""
    return len(independent(quotient_of(P, polynomials[0], MODULAR) for P in polynomials[1:]))
