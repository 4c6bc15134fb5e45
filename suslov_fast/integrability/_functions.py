"""Rational functions in factors, their quotients, and which of them are independent."""

from __future__ import annotations

import math
import random
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import flint

from ._exact import Polynomials, factors, polynomial_ring, random_prime, value_at

IDENTITY, MODULAR = "identity", "modulo a prime, at random points"


@dataclass(frozen=True, repr=False)
class RationalFunction:
    """A product of powers of polynomials and a constant, exact.

    Called with a point, D rational numbers, it returns a fraction. ``sympy.sympify(str(f))``
    converts one to SymPy. As a result of `report`, its `basis` says what it rests on, and
    `cofactor` is that of a Darboux polynomial.
    """

    factors: tuple[tuple[Any, int], ...]  # polynomials and their exponents
    constant: Fraction = Fraction(1)
    basis: str = ""
    cofactor: RationalFunction | None = None

    def __call__(self, x: Sequence[Any]) -> Fraction:
        """Return the value at a point."""
        return math.prod(
            (Fraction(value_at(P, x)) ** e for P, e in self.factors), start=self.constant
        )

    @property
    def numerator(self) -> Any:
        """The numerator as one polynomial."""
        return self._expanded(1, self.constant.numerator)

    @property
    def denominator(self) -> Any:
        """The denominator as one polynomial."""
        return self._expanded(-1, self.constant.denominator)

    def _expanded(self, sign: int, constant: int) -> Any:
        ring = self.factors[0][0].context() if self.factors else polynomial_ring(0)
        return math.prod((P**e for P, e in self._powers(sign)), start=ring.constant(constant))

    def _powers(self, sign: int) -> tuple[tuple[Any, int], ...]:
        return tuple((P, sign * e) for P, e in self.factors if sign * e > 0)

    @property
    def degree(self) -> int:
        """The degree of the numerator or of the denominator, whichever is larger."""
        return max(sum(int(P.total_degree()) * e for P, e in self._powers(s)) for s in (1, -1))

    @property
    def maps_to_infinity(self) -> bool:
        """True if the map sends the zeros of this Darboux polynomial to infinity."""
        factors = () if self.cofactor is None else self.cofactor.factors
        return any(e < 0 and f == self.numerator for f, e in factors)

    def __repr__(self) -> str:
        if self.constant == 1 and [e for _, e in self.factors] == [1]:
            return str(self.factors[0][0])
        parts = []
        for sign, number in ((1, self.constant.numerator), (-1, self.constant.denominator)):
            powers = self._powers(sign)
            texts = [] if number == 1 and powers else [str(number)]
            for P, e in powers:
                text = f"({P})" if len(P) > 1 else str(P)
                texts.append(f"{text}^{e}" if e > 1 else text)
            parts.append("*".join(texts))
        above, below = parts
        if above.startswith("-1*"):
            above = "-" + above.removeprefix("-1*")
        if below == "1":
            return above
        return f"{above}/({below})" if len(texts) > 1 else f"{above}/{below}"

    def _repr_latex_(self) -> str:
        return f"$\\displaystyle {latex(self)}$"


def latex(f: RationalFunction) -> str:
    """Return a function in LaTeX, quotients as fractions."""
    if any(e < 0 for _, e in f.factors):
        above = latex(RationalFunction(f._powers(1), Fraction(f.constant.numerator)))
        below = latex(RationalFunction(f._powers(-1), Fraction(f.constant.denominator)))
        return f"\\frac{{{above}}}{{{below}}}"
    text = re.sub(r"x(\d+)", r"x_{\1}", str(f).replace("*", " "))
    return re.sub(r"\^(\d+)", r"^{\1}", text)


def quotient_of(P: Any, Q: Any, basis: str) -> RationalFunction:
    """Return a quotient of polynomials in irreducible factors, without a constant."""
    powers: dict[str, tuple[Any, int]] = {}
    for each, sign in ((P, 1), (Q, -1)):
        for f, e in factors(each):
            _, before = powers.get(str(f), (f, 0))
            powers[str(f)] = f, before + sign * e
    return product_of(powers.values(), basis)


def product_of(powers: Iterable[tuple[Any, int]], basis: str) -> RationalFunction:
    chosen = sorted((power for power in powers if power[1]), key=lambda power: size(power[0]))
    return RationalFunction(tuple(chosen), basis=basis)


def size(P: Any) -> tuple[int, int, str]:
    return int(P.total_degree()), len(P), str(P)


def rank(polynomials: Sequence[Any]) -> int:
    """Return the number of linearly independent polynomials."""
    terms = [P.to_dict() for P in polynomials]
    monomials = {e for each in terms for e in each}
    return int(flint.fmpz_mat([[each.get(e, 0) for e in monomials] for each in terms]).rank())


def independent(candidates: Iterable[RationalFunction]) -> tuple[RationalFunction, ...]:
    """Return functions of least degree on which the others depend."""
    rng = random.Random(0)
    p = random_prime(rng)
    x: list[Any] = []
    chosen: list[RationalFunction] = []
    rows: list[list[Any]] = []
    for f in sorted(candidates, key=lambda f: (f.degree, len(str(f)), str(f))):
        D = f.factors[0][0].context().nvars()
        x = x or [flint.nmod(rng.randrange(p), p) for _ in range(D)]
        row = [flint.nmod(0, p)] * D
        for P, e in f.factors:  # the derivative of the logarithm
            scale = e / value_at(P, x)
            row = [a + scale * value_at(P.derivative(i), x) for i, a in enumerate(row)]
        if flint.nmod_mat([*rows, row], p).rank() > len(rows):
            chosen, rows = [*chosen, f], [*rows, row]
    return tuple(chosen)


def rank_of_quotients(polynomials: Polynomials) -> int:
    """Return the number of independent quotients of polynomials."""
    return len(independent(quotient_of(P, polynomials[0], MODULAR) for P in polynomials[1:]))
