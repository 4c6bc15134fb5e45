"""The structure that all members of a family of lifted fields share, and their coefficients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import count, islice
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..checks import FloatArray
from ..core.lift import ONE
from .columns import rounded
from .definitions import Definitions, brief
from .lifting import Lifted, TooMany, gradient, lifted
from .polynomials import Polynomial


class Lift(NamedTuple):
    """The definitions of words by a state, which `core.lift` evaluates. It can be hashed.

    given         components of the state
    coefficients  number of coefficients
    definitions   for each added variable its function, polynomial, and the place of its exponent
    words         the words after the state, as tuples of variables
    signs         components of the state that keep their signs along the motion
    """

    given: int
    coefficients: int
    definitions: tuple[Any, ...]
    words: tuple[tuple[int, ...], ...]
    signs: tuple[int, ...]


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

    _instead = ": pass the field, whose Hamiltonian this is"

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


def _terms_of(found: Lifted, numbers: Numbers) -> tuple[Any, Any]:
    """Return the indices of the terms of the lifted field, and their values (..., T)."""
    indices, coefficients = [], []
    for i, row in enumerate(found.terms):
        for j, k, terms in row:
            if terms:
                indices.append((i, j, k))
                coefficients.append(terms)
    return tuple(indices), numbers.stacked(coefficients, False)


def _free_names(n: int, taken: set[str]) -> list[str]:
    """Return n names u1, u2, ... that are not taken."""
    names = (f"u{k}" for k in count(1))
    return [*islice((name for name in names if name not in taken), n)]


def _added_words(
    definitions: Definitions, found: Lifted, taken: set[str]
) -> tuple[tuple[str, str], ...]:
    """Return names and definitions of the words after the state."""
    D, words = definitions.D, found.words[definitions.D :]
    names = _free_names(len(words), taken)
    named_variables = [""] * len(definitions.list)
    found_words = []
    for name, word in zip(names, words, strict=True):
        if len(word) == 1:
            text = definitions.text_of_definition(word[0], named_variables)
            named_variables[word[0] - D] = name
        else:
            text = definitions.text(Polynomial([(word, Fraction(1))]), named_variables)
        found_words.append((name, brief(text)))
    return tuple(found_words)


def structure_of(
    definitions: Definitions,
    values: Mapping[str, Any],
    rows: Sequence[Polynomial] | None,
    energy: Polynomial | None,
    matrix: Any,
) -> tuple[Structure, Any, Any]:
    """Return the structure of equations, or of an energy and its matrix, and its coefficients.

    The first of these are those of definitions and of H, as floats; the second ones those of the
    terms of the lifted field.
    """
    names, taken = definitions.names, {*definitions.names, *values}
    used = _free_names(len(definitions.list), taken)
    places = range(definitions.D, definitions.D + len(definitions.list))
    texts = [
        (name, definitions.text_of_definition(i, used[: i - definitions.D], exact=True))
        for name, i in zip(used, places, strict=True)
    ]
    if rows is None:
        assert energy is not None
        slopes = gradient(definitions, energy)
        rows = [Polynomial([])] * definitions.D
        for i, j, c in matrix.T:
            rows[i] = rows[i] + slopes[j] * Polynomial([((), Fraction(c))])
    signs = tuple(i for i, row in enumerate(rows) if row.terms and all(i in m for m in row.terms))
    try:
        found = lifted(definitions, rows)
    except TooMany as error:
        raise ValueError(f"f: {error}") from None
    except OverflowError:
        raise ValueError("f: coefficients leave the range of float64") from None
    numbers = Numbers(definitions, values)
    lift = Lift(
        given=len(names),
        definitions=tuple(numbers.definition(each) for each in definitions.list),
        words=found.words[len(names) :],
        signs=signs,
        coefficients=0,
    )
    terms_of_H = None if energy is None else numbers.polynomial(energy)
    lift = lift._replace(coefficients=len(numbers.list))
    indices, coefficients = _terms_of(found, numbers)
    shared = Structure(
        lift=lift,
        indices=indices,
        H=terms_of_H,
        K=None if matrix is None else tuple((int(i), int(j), c) for i, j, c in matrix.T),
        added=_added_words(definitions, found, taken),
        texts=tuple(texts),
        equations=()
        if energy is not None
        else tuple(definitions.text(row, used, exact=True) for row in rows),
        shown=tuple(brief(definitions.text(row)) for row in rows),
        energy="" if energy is None else definitions.text(energy, used, exact=True),
        shown_energy="" if energy is None else brief(definitions.text(energy)),
    )
    return shared, numbers.stacked(numbers.list, True), coefficients
