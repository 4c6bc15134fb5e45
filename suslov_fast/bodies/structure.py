"""The structure that all members of a family of lifted fields share, and their coefficients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..checks import FloatArray
from ..core.lift import ONE
from .columns import rounded
from .definitions import Definitions
from .lift import Lift
from .lifting import Lifted
from .polynomials import Polynomial


class Structure(NamedTuple):
    """The parts that all members of a family share."""

    lift: Lift
    indices: tuple[tuple[int, int, int], ...]  # of the terms of the lifted field
    H: tuple[Any, ...] | None  # terms of H as (place of the coefficient, variables)
    K: tuple[tuple[int, int, Fraction], ...] | None
    added: tuple[tuple[str, str], ...]  # names and definitions of the words after the state
    texts: tuple[tuple[str, str], ...]  # definitions that f uses, for `to_dict`
    equations: tuple[str, ...]  # in their names
    shown: tuple[str, ...]  # the equations in the variables of the state
    energy: str  # H in the names of `texts`
    shown_energy: str

    @property
    def key(self) -> tuple[Any, ...]:
        """The parts that == compares: the texts do not matter."""
        return self.lift, self.indices, self.H, self.K

    def without_value(self, added: FloatArray, numbers: FloatArray) -> Any:
        """Return the first definition with no finite value in `added` (n,), and a remark, or "".

        `numbers` are the coefficients of a single field, or of each member of a family.
        """
        missing = np.flatnonzero(~np.isfinite(added))
        powers = [place for f, _, place in self.lift.definitions if f == "power"]
        exponents, remark = numbers[..., powers], ""
        if (exponents != exponents[(0,) * (numbers.ndim - 1)]).any():
            remark = "; x**n with a parameter n is a real power, which is undefined at x = 0: "
            remark += "make one field for each n"
        return (self.added[missing[0]][1], remark) if missing.size else ""


class SmoothHamiltonian:
    """The Hamiltonian of a lifted field, or of a family; H(x) is its value (...) at a state x."""

    def __init__(self, field: Any) -> None:
        self._of = field

    def __call__(self, x: Any) -> Any:
        return self._of._energy(checks.states("x", x, self._of.names))

    def __repr__(self) -> str:
        text: str = self._of._structure.shown_energy
        return text


class Numbers:
    """The coefficients of definitions and of H, with places, as sums of products of symbols."""

    def __init__(self, definitions: Definitions, parameters: Mapping[str, Any]) -> None:
        self._symbols = definitions.symbols
        self._shape = np.broadcast_shapes(*map(np.shape, parameters.values()))
        self.list: list[dict[tuple[int, ...], Fraction]] = []

    def polynomial(self, p: Polynomial) -> tuple[Any, ...]:
        """Return the terms of a polynomial as (place of the coefficient, variables)."""
        of_variables: dict[tuple[int, ...], dict[tuple[int, ...], Fraction]] = {}
        for m, c in p.terms.items():
            own = of_variables.setdefault(tuple(i for i in m if i >= 0), {})
            own[tuple(i for i in m if i < 0)] = c
        return tuple((self._place(c), m) for m, c in sorted(of_variables.items()))

    def _place(self, coefficient: dict[tuple[int, ...], Fraction]) -> int:
        if coefficient == {(): 1}:
            return ONE
        if coefficient not in self.list:
            self.list.append(coefficient)
        return self.list.index(coefficient)

    def definition(self, definition: Any) -> tuple[Any, ...]:
        function, p, exponent = definition
        place = ONE
        if function == "power":
            self.list.append(dict(exponent.terms))
            place = len(self.list) - 1
        return function, self.polynomial(p), place

    def stacked(self, coefficients: Sequence[Any], as_floats: bool) -> Any:
        """Return coefficients (..., n): floats for a family, else fractions or floats."""
        shape, has_symbols = self._shape, bool(self._symbols)
        if not shape and not has_symbols:
            values = [c.get((), Fraction(0)) for c in coefficients]
            array = np.array(values, np.float64 if as_floats else object)
            checks.within("coefficients", array, checks.OTHERS)
            return array
        values = [
            np.broadcast_to(rounded([(v, [*m]) for m, v in c.items()], self._symbols), shape)
            for c in coefficients
        ]
        return np.stack(values, axis=-1) if values else np.empty((*shape, 0))


def terms_of(found: Lifted, numbers: Numbers) -> tuple[Any, Any]:
    """Return the indices of the terms of the lifted field, and their values (..., T)."""
    indices, coefficients = [], []
    for i, row in enumerate(found.terms):
        for j, k, terms in row:
            if terms:
                indices.append((i, j, k))
                coefficients.append(terms)
    return tuple(indices), numbers.stacked(coefficients, False)


def free_names(count: int, taken: set[str]) -> list[str]:
    """Return names u1, u2, ... that are not taken."""
    names: list[str] = []
    k = 1
    while len(names) < count:
        if f"u{k}" not in taken:
            names.append(f"u{k}")
        k += 1
    return names


def added_words(
    definitions: Definitions, found: Lifted, taken: set[str]
) -> tuple[tuple[str, str], ...]:
    """Return names and definitions of the words after the state."""
    D, words = definitions.D, found.words[definitions.D :]
    names = free_names(len(words), taken)
    named_variables = [""] * len(definitions.list)
    found_words = []
    for name, word in zip(names, words, strict=True):
        if len(word) == 1:
            text = definitions.text_of_definition(word[0], named_variables)
            named_variables[word[0] - D] = name
        else:
            text = definitions.text(Polynomial([(word, Fraction(1))]), named_variables)
        found_words.append((name, checks.brief(text)))
    return tuple(found_words)
