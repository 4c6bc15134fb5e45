"""Normal forms of the Darboux polynomials of a search, one cofactor after the other.

If eps is a number, the polynomials are first sought with a symbolic eps, so that the same map has
the same formulas in both cases.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from . import arithmetic
from .arithmetic import degree_of, modulo, rank
from .darboux import space_of
from .functions import IDENTITY, MODULAR, RationalFunction, factored
from .kahan import KahanMap, kahan
from .maps import LONGEST
from .normal_form import chosen, quotients

if TYPE_CHECKING:
    from .invariants import Invariants


class Forms:
    """Normal forms of spaces of polynomials.

    Those of a field with a number eps are those with a symbolic eps, at this number.
    """

    def __init__(self, invariants: Invariants) -> None:
        self.invariants, self.map = invariants, invariants.map
        self._done: dict[int, str] = {}
        self._letter: Any = None

    def find(self, value: int) -> list[RationalFunction]:
        """Bring the space of a cofactor into normal form; return the generators that are new."""
        known = self.invariants
        elements = known.elements(value, known.highest(value))
        space = [known.polynomial(f) for f in elements]
        if not space or self._done.get(value) == str(space):
            return []
        self._done[value] = str(space)
        basis, functions = self._choice(value, space)
        products = [
            P for f, P in zip(elements, space, strict=True) if str(f) not in known.texts(value)
        ]
        polynomials: list[Any] = []
        for P in basis:
            if rank([*products, *polynomials, P]) > len(products) + len(polynomials):
                polynomials.append(P)
        proved = all(f.basis == IDENTITY for f in elements)
        new = known.replace(value, polynomials, IDENTITY if proved else MODULAR)
        known.forms[value] = functions
        self._done[value] = str(
            [*map(known.polynomial, known.elements(value, known.highest(value)))]
        )
        return new

    def _choice(self, value: int, space: list[Any]) -> tuple[list[Any], list[RationalFunction]]:
        map = self.map
        if isinstance(map, KahanMap) and map.eps is not None:
            lifted = self._lifted(value, max(degree_of(P) for P in space))
            if lifted and len(lifted) == len(space):
                basis = chosen(lifted, _known(self._letter))
                polynomials = [self._here(P) for P in basis]
                if rank(polynomials) == rank([*space, *polynomials]) == len(space):
                    names = (str(factored(P)) for P in polynomials)
                    self.invariants.lifts |= dict(zip(names, basis, strict=True))
                    return polynomials, [f.subs(map.eps) for f in quotients(basis)]
        basis = chosen(space, _known(map))
        return basis, quotients(basis)

    def _here(self, P: Any) -> Any:
        """Return a polynomial with a symbolic eps at its number, primitive."""
        map: Any = self.map
        f = factored(modulo(P, 0, arithmetic.fmpq(map.eps)))
        return replace(f, constant=Fraction(1)).quotient_in(map.ring)[0]

    def _lifted(self, value: int, degree: int) -> Any:
        """Return the space with a symbolic eps; None if it is not found."""
        map: Any = self.map
        if self._letter is None:
            self._letter = kahan(map.field)
        if self._letter.cost_of_factors > LONGEST or self._letter.factors is None:
            return None
        cofactor = self._lifted_cofactor(self.invariants.cofactors[value])
        try:
            return cofactor and space_of(self._letter, degree, cofactor)
        except ArithmeticError:  # the coefficients are too long
            return None

    def _lifted_cofactor(self, cofactor: RationalFunction) -> RationalFunction | None:
        """Return the product of factors of the map with a symbolic eps that is this cofactor."""
        eps = self.map.eps  # type: ignore[attr-defined]
        left = {str(f): e for f, e in cofactor.factors}
        powers = []
        for P in self._letter.factors:
            here = factored(modulo(P, 0, arithmetic.fmpq(eps)))
            f, e = next(iter(here.factors), (None, 1))
            power, rest = divmod(left.get(str(f), 0), e)
            if rest:
                return None
            for g, k in here.factors:
                left[str(g)] = left.get(str(g), 0) - k * power
            powers.append((P, power))
        found = RationalFunction(tuple(power for power in powers if power[1]))
        constant = (cofactor / found.subs(eps)).constant
        return None if any(left.values()) else constant * found


def _known(map: Any) -> list[Any]:
    """Return the numerator of the modified energy of a field with a Hamiltonian."""
    modified = map.modified_energy if isinstance(map, KahanMap) else None
    return [modified.quotient_in(map.ring)[0]] if modified else []
