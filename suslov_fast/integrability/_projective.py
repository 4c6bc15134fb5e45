"""A Kahan map as a map of projective space, and the factors of its derivative's determinant."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache, reduce
from typing import Any

import flint

from . import _exact
from ._maps import Arithmetic, KahanMap, cramer, evaluate

TERMS = 20_000  # of the largest polynomial that is written out
_SPARSE = 100  # terms of a component; of sparse maps all polynomials are


@dataclass(frozen=True, repr=False)
class RationalFunction:
    """A product of powers of polynomials and a constant, exact.

    Called with a point, D rational numbers, it returns a fraction. ``sympy.sympify(str(f))``
    converts one to SymPy.
    """

    factors: tuple[tuple[Any, int], ...]  # polynomials and their exponents
    constant: Fraction = Fraction(1)

    def __call__(self, x: Sequence[Any]) -> Fraction:
        """Return the value at a point."""
        point = [_exact.fmpq(a) for a in x]
        values = [_exact.fraction(_exact.rational(P)(*point)) ** e for P, e in self.factors]
        return math.prod(values, start=self.constant)

    @property
    def numerator(self) -> Any:
        """The numerator as one polynomial."""
        return self._expanded(1, self.constant.numerator)

    @property
    def denominator(self) -> Any:
        """The denominator as one polynomial."""
        return self._expanded(-1, self.constant.denominator)

    def _expanded(self, sign: int, constant: int) -> Any:
        ring = self.factors[0][0].context() if self.factors else flint.fmpz_mpoly_ctx.get([])
        powers = (P ** (sign * e) for P, e in self.factors if sign * e > 0)
        return math.prod(powers, start=ring.constant(constant))

    @property
    def degree(self) -> int:
        """The degree of the numerator or of the denominator, whichever is larger."""
        signs = [[int(P.total_degree()) * e * s for P, e in self.factors] for s in (1, -1)]
        return max(sum(max(e, 0) for e in each) for each in signs)

    def __repr__(self) -> str:
        above, below = self._text(1, f"{self.constant.numerator}"), self._text(-1, "1")
        if self.constant.denominator > 1:
            below = f"{self.constant.denominator}" + ("" if below == "1" else f"*{below}")
        compound = "*" in below.partition(")")[below.startswith("(") * 2]
        return above if below == "1" else f"{above}/{f'({below})' if compound else below}"

    def _text(self, sign: int, number: str) -> str:
        chosen = [(P, sign * e) for P, e in self.factors if sign * e > 0]
        if number == "1" and self.constant == 1 and [e for _, e in self.factors] == [1] == [sign]:
            return str(chosen[0][0])
        texts = [f"({P})" if len(P.to_dict()) > 1 else f"{P}" for P, _ in chosen]
        powers = [f"{t}^{e}" if e > 1 else t for t, (_, e) in zip(texts, chosen, strict=True)]
        whole = "*".join([number] * (number not in ("1", "-1")) + powers) or number
        return f"-{whole}" if number == "-1" and powers else whole

    def _repr_latex_(self) -> str:
        return f"$\\displaystyle {latex(self)}$"


def latex(f: Any) -> str:
    """Return a polynomial, or a rational function as a fraction, in LaTeX."""
    if isinstance(f, RationalFunction) and any(e < 0 for _, e in f.factors):
        parts = []
        for sign, number in ((1, f.constant.numerator), (-1, f.constant.denominator)):
            powers = tuple((P, sign * e) for P, e in f.factors if sign * e > 0)
            parts.append(latex(RationalFunction(powers, Fraction(number))))
        return f"\\frac{{{parts[0]}}}{{{parts[1]}}}"
    text = re.sub(r"x(\d+)", r"x_{\1}", str(f).replace("*", " "))
    return re.sub(r"\^(\d+)", r"^{\1}", text)


class Projective:
    """The map as D + 1 polynomials without a common factor, F_i / F_0 being its components.

    A hypersurface P = 0 is invariant if the pullback of P, of degree k, is a constant times P and
    powers of `factors`: of the irreducible factors of the Jacobian determinant of (F_0, ..., F_D),
    the first of which is the hyperplane at infinity. Their degrees add up to k (delta - 1).
    """

    def __init__(self, map: KahanMap) -> None:
        self.map, self.D = map, map.dimension
        self.ring = _exact.polynomial_ring(self.D, flint.fmpz_mpoly_ctx)
        arithmetic = Arithmetic(map)
        forward = cramer(self._integral(arithmetic.forward))
        self.backward = self.ring.constant(0)
        with contextlib.suppress(ZeroDivisionError):  # there is no inverse
            self.backward = cramer(self._integral(arithmetic.backward))[0]
        common = reduce(lambda a, b: a.gcd(b), forward)
        self.F = [each // common for each in forward]
        self.delta = max(int(each.total_degree()) for each in self.F)
        self.determinant = forward[0]  # of A, up to a constant
        self.spaces: dict[tuple[int, int], tuple[Any, ...]] = {}  # of Darboux polynomials

    def _integral(self, forms: Any) -> list[list[Any]]:
        """Return the equations, without fractions, as polynomials."""
        rows = []
        for row in forms:
            factor = math.lcm(*(int(a.q) for form in row for _, a in form))
            rows.append([[(k, (a * factor).p) for k, a in form] for form in row])
        return evaluate(rows, [self.ring.constant(1), *self.ring.gens()])

    def terms(self, degree: int) -> int:
        """Return an upper bound of the number of terms of a pullback."""
        return math.comb(self.D + degree * self.delta, self.D)

    def pullback(self, P: Any, degree: int) -> Any:
        """Return ``F_0**degree P(F_1 / F_0, ...)``."""
        terms = {(*e, degree - sum(e)): c for e, c in P.to_dict().items()}
        ring = _exact.polynomial_ring(self.D + 1, flint.fmpz_mpoly_ctx)
        return ring.from_dict(terms).compose(*self.F[1:], self.F[0], ctx=self.ring)

    @cached_property
    def factors(self) -> tuple[Any, ...] | None:
        """Irreducible factors of the denominator and of det DPhi; None if they are too large."""
        if self.backward == 0 or self.delta == 0:
            return None
        sparse = max(len(F.to_dict()) for F in self.F) <= _SPARSE
        found = _exact.factors(self.F[0]) + _exact.factors(self.determinant)
        for P, _ in _exact.factors(self.backward):
            degree = P.total_degree()
            if self.terms(degree) > TERMS and not sparse:
                return None
            found += _exact.factors(self.pullback(P, degree))
        different = {str(f): f for f, _ in found}.values()
        return tuple(sorted(different, key=lambda f: (f.total_degree(), len(f.to_dict()), str(f))))

    def valuation(self, P: Any) -> list[int]:
        """Return the exponents of the factors in a polynomial."""
        exponents = []
        for f in self.factors or ():
            exponents.append(0)
            while P % f == 0:
                P, exponents[-1] = P // f, exponents[-1] + 1
        return exponents

    @cached_property
    def of_denominator(self) -> list[int]:
        """The exponents of the factors in F_0."""
        return self.valuation(self.F[0])

    @cached_property
    def of_determinant(self) -> list[int]:
        """The exponents of the factors in det DPhi."""
        degree = int(self.backward.total_degree())
        v = self.valuation(self.pullback(self.backward, degree))
        under = zip(self.of_denominator, self.valuation(self.determinant), strict=True)
        return [a - degree * b - c for a, (b, c) in zip(v, under, strict=True)]

    @property
    def degrees(self) -> list[int]:
        """The degrees of the hyperplane at infinity and of the factors."""
        return [1, *(int(f.total_degree()) for f in self.factors or ())]

    @cached_property
    def of_jacobian(self) -> list[int]:
        """The exponents of the hyperplane at infinity and of the factors in the Jacobian."""
        pairs = zip(self.of_determinant, self.of_denominator, strict=True)
        powers = [a + (self.D + 1) * b for a, b in pairs]
        known = sum(map(math.prod, zip(powers, self.degrees[1:], strict=True)))
        return [(self.D + 1) * (self.delta - 1) - known, *powers]


@lru_cache(maxsize=8)
def projective(map: KahanMap) -> Projective:
    return Projective(map)
