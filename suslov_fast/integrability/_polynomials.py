"""Polynomials and monomials."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations_with_replacement
from typing import Any

import flint
import numpy as np

from .._checks import integer, wrong
from ._exact import Matrix, fmpq, shortened

Exponents = tuple[tuple[int, ...], ...]


class Polynomials(tuple[Any, ...]):
    """A tuple of polynomials of python-flint in the variables x1, ..., xD."""

    __slots__ = ()

    def as_sympy(self, symbols: Sequence[Any] | None = None) -> list[Any]:
        """Return the polynomials as SymPy expressions in `symbols`, by default x1, ..., xD."""
        import sympy

        expressions = []
        for polynomial in self:
            names = polynomial.context().names()
            x = sympy.symbols(names) if symbols is None else symbols
            if len(x) != len(names):
                raise wrong("symbols", str(len(names)), len(x))
            terms = {e: sympy.Rational(str(a)) for e, a in polynomial.to_dict().items()}
            expressions.append(sympy.Poly(terms or 0, *x).as_expr())
        return expressions

    def __reduce__(self) -> Any:
        rings = [each.context() for each in self]
        terms = [each.to_dict() for each in self]
        return _restored, ([(type(a), a.names(), b) for a, b in zip(rings, terms, strict=True)],)

    def __repr__(self) -> str:
        return f"({', '.join(shortened(str(each)) for each in self)})"


def _restored(pickled: list[Any]) -> Polynomials:
    return Polynomials(ring.get(names, "deglex").from_dict(terms) for ring, names, terms in pickled)


def polynomial_ring(n: int, context: Any, **modulus: Any) -> Any:
    return context.get([f"x{i}" for i in range(1, n + 1)], ordering="deglex", **modulus)


def polynomials_with(rows: Matrix | None, exponents: Exponents) -> Polynomials:
    """Polynomials with the same span, whose integer coefficients are short and coprime."""
    if not rows:
        return Polynomials()
    integers = []
    for row in rows:
        numerators = flint.fmpq_mat([[fmpq(a) for a in row]]).numer_denom()[0].entries()
        divisor = math.gcd(*(int(a) for a in numerators))
        integers.append([a // divisor for a in numerators])
    ring = polynomial_ring(len(exponents[0]), flint.fmpz_mpoly_ctx)
    polynomials = []
    for short in flint.fmpz_mat(integers).lll().tolist():
        P = ring.from_dict(dict(zip(exponents, short, strict=True))).primitive()[1]
        polynomials.append(-P if P.leading_coefficient() < 0 else P)
    return Polynomials(polynomials)


def exponents_of(monomials: Any, n: int) -> Exponents:
    """The exponents of monomials in n variables, those up to a degree in ascending order."""
    if isinstance(monomials, int | np.integer):
        return tuple(
            tuple(chosen.count(i) for i in range(n))
            for degree in range(integer("monomials", monomials, 0) + 1)
            for chosen in combinations_with_replacement(range(n), degree)
        )
    try:
        exponents = tuple(tuple(integer("monomials", e, 0) for e in each) for each in monomials)
    except TypeError:
        raise wrong("monomials", "a degree or a list of exponents", monomials, TypeError) from None
    for each in exponents:
        if len(each) != n:
            raise wrong("monomials", f"{n} exponents for each monomial", each)
    if not exponents or len({*exponents}) < len(exponents):
        raise wrong("monomials", "at least one monomial, and none twice", monomials)
    return exponents


def monomial_values(exponents: Exponents, x: Sequence[Any]) -> Any:
    """The monomials at a point, whose coordinates may be of any type of numbers."""
    values = np.ones(len(exponents), object)
    for a, e in zip(x, np.array(exponents).T, strict=True):
        values *= np.array([a**k for k in range(int(e.max()) + 1)], object)[e]
    return values
