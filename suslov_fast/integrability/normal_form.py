"""Normal forms of integrals: quotients of Darboux polynomials that do not depend on a basis.

Polynomials of one cofactor span a space, and any two of them have a first integral as quotient. In
normal form they are its members that are reducible, where there are any. Where eps is symbolic, the
limit of numerator and denominator for eps to 0 counts as well; where it is a number, the normal
form is that with a symbolic eps, evaluated, so that the same map has the same formulas.
"""

from __future__ import annotations

import contextlib
import random
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

from . import arithmetic
from .darboux import space_of
from .functions import IDENTITY, MODULAR, RationalFunction, factored, without_constant
from .invariants import Invariants
from .kahan import KahanMap, kahan
from .maps import LONGEST, RationalMap
from .polynomials import (
    degree_of,
    exponents_in_x,
    has_constant_term,
    has_eps,
    limit,
    modulo,
    rank,
    variables_of,
    with_independent_limits,
    without_content,
)
from .reducible import count_factors, reducible_members

_SIGNS = 70  # random points at which a definite polynomial has one sign


class NormalForms:
    """Normal forms of the Darboux polynomials of a search, one cofactor after the other."""

    def __init__(self, invariants: Invariants) -> None:
        self.invariants, self.map = invariants, invariants.map
        self._done: dict[int, str] = {}  # spaces in normal form, by the value of the cofactor
        self._symbolic: Any = None  # the map with a symbolic eps

    def update(self, value: int) -> list[RationalFunction]:
        """Bring the space of a cofactor into normal form; return the generators that are new."""
        known = self.invariants
        elements = known.elements(value, known.highest(value))
        space = [known.polynomial(f) for f in elements]
        if not space or self._done.get(value) == str(space):
            return []
        basis, functions = self._basis_and_quotients(value, space)
        # Products of generators of other cofactors stay; the others are replaced.
        texts = known.texts(value)
        kept = [P for f, P in zip(elements, space, strict=True) if str(f) not in texts]
        generators: list[Any] = []
        for P in basis:
            if rank([*kept, *generators, P]) > len(kept) + len(generators):
                generators.append(P)
        proved = all(f.basis == IDENTITY for f in elements)
        new = known.replace(value, generators, IDENTITY if proved else MODULAR)
        known.forms[value] = functions
        elements = known.elements(value, known.highest(value))
        self._done[value] = str([*map(known.polynomial, elements)])
        return new

    def _basis_and_quotients(
        self, value: int, space: list[Any]
    ) -> tuple[list[Any], list[RationalFunction]]:
        """Return the basis in normal form of a space, and the integrals that are its quotients."""
        map = self.map
        if isinstance(map, KahanMap) and map.eps is not None:
            symbolic = self._symbolic_space(value, max(degree_of(P) for P in space))
            if symbolic and len(symbolic) == len(space):
                basis = normal_basis(symbolic, _modified_energy(self._symbolic))
                at_number = [self._at_number(P) for P in basis]
                if rank(at_number) == rank([*space, *at_number]) == len(space):
                    texts = (str(factored(P)) for P in at_number)
                    self.invariants.symbolic_generators |= dict(zip(texts, basis, strict=True))
                    return at_number, [f.subs(map.eps) for f in quotients(basis)]
        basis = normal_basis(space, _modified_energy(map))
        return basis, quotients(basis)

    def _at_number(self, P: Any) -> Any:
        """Return a polynomial with a symbolic eps at the number eps of the map, primitive."""
        map: Any = self.map
        f = factored(modulo(P, 0, arithmetic.fmpq(map.eps)))
        return replace(f, constant=Fraction(1)).as_quotient(map.ring)[0]

    def _symbolic_space(self, value: int, degree: int) -> Any:
        """Return the space with a symbolic eps; None if it is not found."""
        map: Any = self.map
        if self._symbolic is None:
            self._symbolic = kahan(map.field)
        if self._symbolic.cost_of_factors > LONGEST or self._symbolic.factors is None:
            return None
        cofactor = self._symbolic_cofactor(self.invariants.cofactors[value])
        try:
            return cofactor and space_of(self._symbolic, degree, cofactor)
        except ArithmeticError:  # the coefficients are too long
            return None

    def _symbolic_cofactor(self, cofactor: RationalFunction) -> RationalFunction | None:
        """Return the product of factors of the map with a symbolic eps that is this cofactor."""
        eps = self.map.eps  # type: ignore[attr-defined]
        exponents = {str(f): e for f, e in cofactor.factors}  # that are left to explain
        powers = []
        for P in self._symbolic.factors:
            at_number = factored(modulo(P, 0, arithmetic.fmpq(eps)))
            f, e = next(iter(at_number.factors), (None, 1))
            power, rest = divmod(exponents.get(str(f), 0), e)
            if rest:
                return None
            for g, k in at_number.factors:
                exponents[str(g)] = exponents.get(str(g), 0) - k * power
            powers.append((P, power))
        if any(exponents.values()):
            return None
        symbolic = RationalFunction(tuple((P, power) for P, power in powers if power))
        return (cofactor / symbolic.subs(eps)).constant * symbolic


def _modified_energy(map: RationalMap) -> list[Any]:
    """Return the numerator of the modified energy of a field with a Hamiltonian, in a list."""
    modified = map.modified_energy
    return [modified.as_quotient(map.ring)[0]] if modified else []


def quotients(basis: Sequence[Any]) -> list[RationalFunction]:
    """Return the quotients of a basis by its first polynomial."""
    denominator, *others = basis
    return [without_constant(factored(P) / factored(denominator)) for P in others]


def normal_basis(space: Sequence[Any], preferred: Sequence[Any] = ()) -> list[Any]:
    """Return a basis of a space in normal form: first the denominator of its integrals.

    The denominator is of least degree in the limit, the others make the limit of their quotients
    independent; those that are preferred, and then polynomials with many factors, come first.
    """
    echelon = in_echelon_form(space)
    basis = with_independent_limits(echelon)
    candidates = {str(P): P for P in (*basis, *echelon)}
    with contextlib.suppress(ArithmeticError):  # a number is special, or all are reducible
        candidates |= {str(P): P for P in reducible_members(echelon)}
    first = {str(P): P for P in map(without_content, preferred) if rank([*space, P]) == len(space)}
    candidates |= first
    highest = max(degree_of(P) for P in basis)

    def order(P: Any) -> tuple[Any, ...]:
        complex_factors = count_factors(P) + (degree_of(P) < highest)  # that at infinity
        factors = sum(e for _, e in factored(P).factors)
        return degree_of(P), str(P) not in first, -complex_factors, -factors, len(P), str(P)

    ordered = sorted(candidates.values(), key=order)
    denominator = min(ordered, key=_order_of_denominator)
    result = [denominator]
    for P in ordered:
        if rank([*map(limit, result), limit(P)]) > len(result):
            result.append(P)
    return result


def _order_of_denominator(P: Any) -> tuple[Any, ...]:
    """Return the key of denominators; of equal ones the first is taken."""
    in_limit = limit(P)
    return degree_of(in_limit), degree_of(P), not has_constant_term(in_limit), not is_definite(P)


def is_definite(P: Any) -> bool:
    """Return True if a polynomial has one sign at random points, near 0 and far away."""
    rng, signs = random.Random(0), set()
    symbolic, n = has_eps(P), variables_of(P)
    for k in range(_SIGNS):
        size = 10 ** (k % 7)
        x = [rng.randrange(-size, size + 1) for _ in range(n)]
        value = P(*[rng.randrange(1, 9)] * symbolic, *x)
        signs |= {value > 0} if value else set()
    return len(signs) == 1


def in_echelon_form(space: Sequence[Any]) -> list[Any]:
    """Return the basis with different first monomials, of high degree before low.

    No polynomial has the last monomial of one after it: constants are in the last.
    """
    monomials = {e for P in space for e in exponents_in_x(P)}
    descending = sorted(monomials, key=lambda e: (sum(e), e), reverse=True)
    rows, left = [], list(space)
    for monomial in descending:
        pivot = next((P for P in left if _coefficient(P, monomial) != 0), None)
        if pivot is not None:
            left.remove(pivot)
            left = [_without(P, pivot, monomial) for P in left]
            rows.append(pivot)
    for k in reversed(range(len(rows))):
        last = next(e for e in reversed(descending) if _coefficient(rows[k], e) != 0)
        rows[:k] = [_without(P, rows[k], last) for P in rows[:k]]
    return [*map(without_content, rows)]


def _coefficient(P: Any, monomial: tuple[int, ...]) -> Any:
    """Return the coefficient of a monomial in x, a polynomial in eps if it is symbolic."""
    symbolic = has_eps(P)
    zeros = [0] * len(monomial)
    terms = {(*e[:symbolic], *zeros): c for e, c in P.to_dict().items() if e[symbolic:] == monomial}
    return P.context().from_dict(terms)


def _without(P: Any, pivot: Any, monomial: tuple[int, ...]) -> Any:
    """Return a combination of two polynomials that lacks a monomial of the second."""
    if (c := _coefficient(P, monomial)) == 0:
        return P
    return without_content(_coefficient(pivot, monomial) * P - c * pivot)
