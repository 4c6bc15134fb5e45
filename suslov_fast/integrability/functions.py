"""Rational functions in factors, their text, and which of them are independent."""

from __future__ import annotations

import math
import random
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, reduce
from typing import Any

import flint

from .exact import (
    Polynomials,
    degree_of,
    factors,
    has_letter,
    modulo,
    primitive,
    random_prime,
    rational,
    ring,
    size,
    value_at,
)

IDENTITY, MODULAR = "identity", "modulo a prime, at random points"
_TERMS = 400  # of polynomials whose special values of eps are sought


@dataclass(frozen=True, repr=False)
class RationalFunction:
    """A product of powers of polynomials and a constant, exact.

    Called with a point, D rational numbers, it returns a fraction. ``sympy.sympify(str(f))``
    converts one to SymPy. As a result of `report`, its `basis` says what it rests on, and
    `cofactor` is that of a Darboux polynomial. If eps is a letter, `subs` puts a number in its
    place, and `special` are the rational numbers, as far as they are known, at which the formula
    has no meaning: it has no value, or is a constant.
    """

    factors: tuple[tuple[Any, int], ...]  # polynomials and their exponents
    constant: Fraction = Fraction(1)
    basis: str = ""
    cofactor: RationalFunction | None = None

    def __call__(self, x: Sequence[Any], eps: Any = None) -> Fraction:
        """Return the value at a point; a function with the letter eps needs its value."""
        if self.has_letter and eps is None:
            raise TypeError("eps: expected a number, as in f(x, eps=Fraction(1, 3)), got None")
        x = [rational("x", a) for a in x]
        x = [rational("eps", eps), *x] if self.has_letter else x
        values = (Fraction(value_at(P, x)) ** e for P, e in self.factors)
        return math.prod(values, start=self.constant)

    @property
    def has_letter(self) -> bool:
        """True if eps is a letter."""
        return any(has_letter(P) for P, _ in self.factors)

    def subs(self, eps: Any) -> RationalFunction:
        """Return the function of x alone for a value of eps.

        Examples
        --------
        >>> from suslov_fast import QuadraticField
        >>> from suslov_fast.integrability import report
        >>> top = QuadraticField.from_function(lambda x: (x[1], -x[0]), 2)
        >>> measure = report(top, degree=2).measures[0]
        >>> measure.subs(eps="1/3")
        1
        """
        value = rational("eps", Fraction(eps) if isinstance(eps, str) else eps)
        powers, constant = [], self.constant
        for P, e in self.factors:
            Q, scale = at_eps(P, value) if has_letter(P) else (P, Fraction(1))
            if scale == 0 and e < 0:
                raise ZeroDivisionError(f"{self} has no value at eps = {value}")
            constant *= scale**e
            powers += [(f, k * e) for f, k in factors(Q)] if scale else []
        cofactor = self.cofactor and self.cofactor.subs(value)
        return replace(product_of(powers, self.basis), constant=constant, cofactor=cofactor)

    @cached_property
    def special(self) -> tuple[Fraction, ...]:
        """The rational eps, as far as they are known, at which the formula has no meaning."""
        found: set[Fraction] = set()
        for P, _ in self.factors:
            found |= content_roots(P)
        if self.has_letter and max(len(P) for P, _ in self.factors) <= _TERMS:
            found |= self._where_constant()
        return tuple(sorted(found))

    def _where_constant(self) -> set[Fraction]:
        """Return the rational eps at which numerator and denominator are proportional."""
        above, below = _by_monomial(self.numerator), _by_monomial(self.denominator)
        zero, common = flint.fmpz_poly([0]), flint.fmpz_poly([0])
        pairs = [(above.get(e, zero), below.get(e, zero)) for e in above | below]
        for i, (a, b) in enumerate(pairs):
            for c, d in pairs[i + 1 :]:
                common = common.gcd(a * d - b * c)
                if common.degree() == 0:
                    return set()
        return _roots(common)

    def __mul__(self, other: RationalFunction) -> RationalFunction:
        basis = MODULAR if MODULAR in (self.basis, other.basis) else self.basis
        product = product_of(self.factors + other.factors, basis)
        return replace(product, constant=self.constant * other.constant)

    def __pow__(self, power: int) -> RationalFunction:
        powers = tuple((P, power * e) for P, e in self.factors if power)
        return RationalFunction(powers, self.constant**power, self.basis)

    @property
    def numerator(self) -> Any:
        """The numerator as one polynomial."""
        return self.quotient_in(self._ring)[0]

    @property
    def denominator(self) -> Any:
        """The denominator as one polynomial."""
        return self.quotient_in(self._ring)[1]

    @property
    def _ring(self) -> Any:
        return self.factors[0][0].context() if self.factors else ring(0, False)

    def quotient_in(self, of: Any) -> tuple[Any, Any]:
        """Return numerator and denominator as polynomials in a ring."""
        constants = (self.constant.numerator, self.constant.denominator)
        return tuple(  # type: ignore[return-value]
            math.prod((P**e for P, e in self._powers(sign)), start=of.constant(c))
            for sign, c in zip((1, -1), constants, strict=True)
        )

    def _powers(self, sign: int) -> tuple[tuple[Any, int], ...]:
        return tuple((P, sign * e) for P, e in self.factors if sign * e > 0)

    @property
    def degree(self) -> int:
        """The degree in x of the numerator or of the denominator, whichever is larger."""
        return max(self._degrees)

    @property
    def _degrees(self) -> tuple[int, int]:
        """The degrees of numerator and denominator."""
        above, below = (sum(degree_of(P) * e for P, e in self._powers(s)) for s in (1, -1))
        return above, below

    @property
    def numerator_is_larger(self) -> bool:
        """Whether the degree of the numerator is that of the denominator or more."""
        return self._degrees[0] >= self._degrees[1]

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
        return f"$\\displaystyle {latex(self)}$"

    def __reduce__(self) -> Any:
        plain = [
            (P.context().names(), [(tuple(map(int, k)), int(c)) for k, c in P.to_dict().items()], e)
            for P, e in self.factors
        ]
        return _loaded, (plain, self.constant, self.basis, self.cofactor)


def _loaded(plain: Any, *rest: Any) -> RationalFunction:
    """Return the function that was pickled; python-flint does not pickle polynomials."""
    of = flint.fmpz_mpoly_ctx.get
    powers = [(of(names, ordering="deglex").from_dict(dict(terms)), e) for names, terms, e in plain]
    return RationalFunction(tuple(powers), *rest)


def _power_text(P: Any, e: int, alone: bool, longest: int | None) -> str:
    text = str(P)
    if longest is not None and len(text) > longest:
        text = f"[degree {degree_of(P)}, {len(P)} terms]"
    elif not alone and not re.fullmatch(r"x\d+|eps|\d+", text):
        text = f"({text})"
    return f"{text}^{e}" if e > 1 else text


def latex(f: RationalFunction) -> str:
    """Return a function in LaTeX, quotients as fractions."""
    if f.constant.denominator > 1 or any(e < 0 for _, e in f.factors):
        above = latex(RationalFunction(f._powers(1), Fraction(abs(f.constant.numerator))))
        below = latex(RationalFunction(f._powers(-1), Fraction(f.constant.denominator)))
        return f"{'-' if f.constant < 0 else ''}\\frac{{{above}}}{{{below}}}"
    text = re.sub(r"x(\d+)", r"x_{\1}", str(f).replace("*", " "))
    return re.sub(r"\^(\d+)", r"^{\1}", text).replace("eps", "\\varepsilon")


def quotient_of(P: Any, Q: Any, basis: str) -> RationalFunction:
    """Return a quotient of polynomials in irreducible factors, without a constant."""
    return product_of(factors(P) + [(f, -e) for f, e in factors(Q)], basis)


def exact_quotient(P: Any, Q: Any) -> RationalFunction:
    """Return a quotient of polynomials in irreducible factors."""
    found = quotient_of(P, Q, "")
    scale = Fraction(int(P.leading_coefficient()), int(Q.leading_coefficient()))
    for f, e in found.factors:
        scale /= Fraction(int(f.leading_coefficient())) ** e
    return replace(found, constant=scale)


def product_of(powers: Iterable[tuple[Any, int]], basis: str) -> RationalFunction:
    """Return a product of powers of primitive polynomials, in the order of their size."""
    total: dict[str, tuple[Any, int]] = {}
    for P, e in powers:
        total[str(P)] = P, total.get(str(P), (P, 0))[1] + e
    chosen = sorted(
        (power for power in total.values() if power[1]), key=lambda power: size(power[0])
    )
    return RationalFunction(tuple(chosen), basis=basis)


def at_eps(P: Any, eps: Fraction) -> tuple[Any, Fraction]:
    """Return a primitive polynomial in x, and the number by which it is multiplied at this eps."""
    terms: dict[Any, Fraction] = {}
    for (k, *e), c in P.to_dict().items():
        terms[tuple(e)] = terms.get(tuple(e), Fraction(0)) + int(c) * eps ** int(k)
    of = ring(P.context().nvars() - 1, False)
    scale = math.lcm(*(c.denominator for c in terms.values()))
    whole = of.from_dict({e: int(c * scale) for e, c in terms.items() if c})
    if whole == 0:
        return whole, Fraction(0)
    found = primitive(whole)
    return found, Fraction(
        int(whole.leading_coefficient()), int(found.leading_coefficient())
    ) / scale


def content_roots(P: Any) -> set[Fraction]:
    """Return the rational eps at which a polynomial vanishes for all x."""
    return _roots(reduce(lambda a, b: a.gcd(b), _by_monomial(P).values()))


def _by_monomial(P: Any) -> dict[tuple[int, ...], Any]:
    """Return the coefficients of monomials in x: polynomials in eps."""
    found: dict[tuple[int, ...], Any] = {}
    for (k, *e), c in (P.to_dict() if has_letter(P) else {(0,): P.leading_coefficient()}).items():
        term = flint.fmpz_poly([0] * int(k) + [int(c)])
        found[tuple(e)] = found.get(tuple(e), 0) + term
    return found


def _roots(f: Any) -> set[Fraction]:
    """Return the rational roots of a polynomial in eps."""
    linear = (g.coeffs() for g, _ in f.factor()[1] if g.degree() == 1)
    return {Fraction(-int(a), int(b)) for a, b in linear}


def independent(candidates: Iterable[RationalFunction]) -> tuple[RationalFunction, ...]:
    """Return functions of least degree on which the others depend."""
    rng = random.Random(0)
    p = random_prime(rng)
    eps = rng.randrange(p)
    x: list[Any] = []
    chosen: list[RationalFunction] = []
    rows: list[list[Any]] = []
    for f in sorted(candidates, key=lambda f: (f.degree, len(str(f)), str(f))):
        powers = [(modulo(P, p, eps), e) for P, e in f.factors]
        D = powers[0][0].context().nvars()
        x = x or [flint.nmod(rng.randrange(p), p) for _ in range(D)]
        row = [flint.nmod(0, p)] * D
        for P, e in powers:  # the derivative of the logarithm
            scale = e / value_at(P, x)
            row = [a + scale * value_at(P.derivative(i), x) for i, a in enumerate(row)]
        if flint.nmod_mat([*rows, row], p).rank() > len(rows):
            chosen, rows = [*chosen, f], [*rows, row]
        if len(rows) == D:
            break
    return tuple(chosen)


def rank_of_quotients(polynomials: Polynomials) -> int:
    """Return the number of independent quotients of polynomials."""
    return len(independent(quotient_of(P, polynomials[0], MODULAR) for P in polynomials[1:]))
