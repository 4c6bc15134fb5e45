"""Coefficients of fields from functions of the user, which are called with polynomials.

For a family f is called once, with a column for each parameter that varies, and for three members,
which must have the same coefficients. Where a column refuses what f does with it, a comparison for
example, f is called for each member.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import permutations
from typing import Any, NamedTuple

import numpy as np

from ..checks import OTHERS, page, short, within, wrong
from .advice import CUBIC, check_arguments, explained, name_of
from .columns import Column, Letter, Refused, exact_values, rounded
from .polynomials import Polynomial

# A family of fewer members is made by a call of f for each of them.
_FEWEST = 4


class Variables(tuple[Polynomial, ...]):
    """The variables x: a tuple that says which one is asked for in vain."""

    def __getitem__(self, index: Any) -> Any:
        try:
            return super().__getitem__(index)
        except IndexError:
            raise IndexError(f"x[{index}] is used, but the dimension is {len(self)}") from None


class _Call(NamedTuple):
    """A function f(x, **parameters) of D variables, which returns polynomials of a degree."""

    argument: str  # its name in messages
    f: Callable[..., Any]
    names: Sequence[str]
    degree: int
    parameters: Mapping[str, Any]

    @property
    def D(self) -> int:
        return len(self.names)

    @property
    def shape(self) -> tuple[int, ...]:
        return np.broadcast_shapes(*map(np.shape, self.parameters.values()))

    def __call__(self, parameters: Mapping[str, Any]) -> Any:
        x = Variables(Polynomial([((i,), Fraction(1))]) for i in range(self.D))
        return self.f(x, **parameters)


def traced(
    argument: str, f: Any, names: Sequence[str], parameters: Mapping[str, Any], K: Any = None
) -> tuple[Any, Any]:
    """Return the table of a field f; with K the tensor of a Hamiltonian f, and a table or None.

    They are exact, but for tables of families that one call of f made, which are rounded once.
    """
    if not callable(f):
        raise wrong(argument, "a function of x, a tuple of the variables", short(f), TypeError)
    f = getattr(f, "py_func", f)  # of a function that Numba compiled
    maker = f"QuadraticField.{'from_function' if K is None else 'from_hamiltonian'}"
    check_arguments(argument, f, names, parameters, maker)
    call = _Call(argument, f, names, 2 if K is None else 3, parameters)
    shape = call.shape
    columns = [np.broadcast_to(np.asarray(a).astype(object), shape) for a in parameters.values()]

    def member(index: tuple[int, ...]) -> Any:
        values = (column[index] for column in columns)
        return _member(call, dict(zip(parameters, values, strict=True)), bool(shape))

    indices = [*np.ndindex(shape)]
    if len(indices) >= _FEWEST:
        some = indices[0], indices[len(indices) // 2], indices[-1]
        tensors = [member(index) for index in some]
        try:
            found = _by_columns(call, K)
        except Exception:  # whatever a column does not do as a float does
            found = None
        if found and all(_agree(found[0][i], each) for i, each in zip(some, tensors, strict=True)):
            return found
    tensors = [member(index) for index in indices]
    axes = (call.D,) * (K is None) + (call.D + 1,) * call.degree
    return np.array(tensors, dtype=object).reshape(*shape, *axes), None


def _agree(ours: Any, exact: Any) -> bool:
    return bool((ours == exact.astype(ours.dtype)).all())


def _by_columns(call: _Call, K: Any) -> tuple[Any, Any]:
    """Return what `traced` does, from one call with columns; any exception if that fails."""
    letters: list[Letter] = []
    columns = {n: Column(a, letters) if np.ndim(a) else a for n, a in call.parameters.items()}
    found, shape, D = call(columns), call.shape, call.D
    if K is None:
        rows = [Polynomial.of(each) for each in _components(found, D)]
    else:
        H = Polynomial.of(found)
        tensor = np.full((*shape, *(D + 1,) * 3), Fraction(0), object)
        for places, terms in _monomials(H, D, 3):
            rounded(terms, letters)  # refused where they are out of range
            values = exact_values([(c / len(places), own) for c, own in terms], letters)
            for place in places:
                tensor[(..., *place)] = values
        slopes = [H.derivative(j) for j in range(D)]
        rows = [
            sum((K[i, j] * slopes[j] for j in range(D) if K[i, j]), Polynomial([]))
            for i in range(D)
        ]
    table = np.zeros((*shape, D, D + 1, D + 1))
    for i, row in enumerate(rows):
        for places, terms in _monomials(row, D, 2):
            values = rounded(terms, letters)
            for place in places:
                table[(..., i, *place)] = values / len(places)
    return (table, None) if K is None else (tensor, table)


def _monomials(polynomial: Polynomial, D: int, degree: int) -> Iterator[tuple[Any, Any]]:
    """Yield the places in a symmetric tensor of each monomial of the state, and its terms."""
    groups: dict[tuple[int, ...], list[Any]] = {}
    for indices, c in polynomial.terms.items():
        state = tuple(i for i in indices if i >= 0)
        groups.setdefault(state, []).append((c, [i for i in indices if i < 0]))
    for state, terms in groups.items():
        if len(state) > degree:
            raise Refused
        yield {*permutations((*state, *[D] * (degree - len(state))))}, terms


def _components(found: Any, D: int) -> Any:
    if not isinstance(found, (tuple, list, np.ndarray)) or len(found) != D:
        received = f"{short(found)}: return a tuple of {D}"
        if isinstance(found, (tuple, list, np.ndarray)):
            received = f"{len(found)}: {short(found)}"
        raise ValueError(f"must return {D} components, not {received}")
    return found


def _member(call: _Call, parameters: Mapping[str, Any], is_family: bool) -> Any:
    """Return the exact tensors of one member of a family, or of a single field."""
    called = name_of(call.f, call.argument)
    try:
        found = call(parameters)
    except Exception as error:  # only of f
        what = explained(error, called, call.names, is_family)
        kinds = (TypeError, AttributeError, ValueError, IndexError, ArithmeticError)
        if not isinstance(error, kinds) and what == " ".join(str(error).split()):
            raise
        kind = ValueError if isinstance(error, kinds[2:]) else TypeError
        raise kind(f"{call.argument}: {what}") from (error if isinstance(error, kinds) else None)
    try:
        if call.degree == 3:
            return _tensor(found, called, call.D, 3)
        parts = _components(found, call.D)
        return np.stack(
            [_tensor(each, f"component {i} of {called}", call.D, 2) for i, each in enumerate(parts)]
        )
    except (TypeError, ValueError) as error:
        raise type(error)(f"{call.argument}: {error}") from None


def _tensor(value: Any, what: str, D: int, degree: int) -> Any:
    """Return a polynomial as a symmetric tensor of fractions in homogeneous coordinates."""
    try:
        terms, table = Polynomial.of(value).terms, np.full((D + 1,) * degree, Fraction(0))
    except TypeError:
        raise TypeError(f"{what} must be a polynomial, not {short(value)}") from None
    within("coefficients", np.array([*terms.values()], dtype=object), OTHERS)
    for indices, c in terms.items():
        if len(indices) > degree:
            how = f"with more variables it may become quadratic, see {page(CUBIC)}"
            raise ValueError(f"{what} has degree {max(map(len, terms))}: {how}")
        places = {*permutations((*indices, *[D] * (degree - len(indices))))}
        for each in places:
            table[each] = c / len(places)
    return table
