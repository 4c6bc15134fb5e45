"""Coefficients of a field, from calls of the user's function f with polynomials.

For a family, f is called once with a column for each parameter that varies, and for three members,
to confirm the coefficients. If they differ, or if f does something that a column refuses, such as
a comparison, f is called for each member.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import permutations
from typing import Any, NamedTuple

import numpy as np

from ..checks import OTHERS, page, short, within, wrong
from .advice import CUBIC, check_arguments, explained, name_of, prefixed
from .columns import Column, Refused, Symbol, exact_values, rounded
from .polynomials import Polynomial

# Families with fewer members are not worth a column: f is called for each member.
_FEWEST = 4


class Variables(tuple[Polynomial, ...]):
    """The variables x: a tuple whose IndexError names the dimension."""

    def __getitem__(self, index: Any) -> Any:
        try:
            return super().__getitem__(index)
        except IndexError:
            raise IndexError(f"x[{index}] is used, but the dimension is {len(self)}") from None


class _Call(NamedTuple):
    """A user's function f(x, **parameters), and the degree that its polynomials may have."""

    argument: str  # the public argument that holds f, for messages
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
    """Return (table, None) for a field f, or (tensor, table or None) for a Hamiltonian f with K.

    They hold fractions, unless one call of f was enough for a family: then the table holds floats,
    rounded once. Otherwise the table of a Hamiltonian is None, and follows from the tensor.
    """
    if not callable(f):
        raise wrong(argument, "a function of x, a tuple of the variables", short(f), TypeError)
    f = getattr(f, "py_func", f)  # the Python function, if Numba compiled f
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
        samples = indices[0], indices[len(indices) // 2], indices[-1]
        tensors = [member(index) for index in samples]
        try:
            at_once = _by_columns(call, K)
        except Exception:  # f may raise anything where a column behaves unlike a float
            at_once = None
        if at_once and all(_agree(at_once[0][i], a) for i, a in zip(samples, tensors, strict=True)):
            return at_once
    tensors = [member(index) for index in indices]
    axes = (call.D,) * (K is None) + (call.D + 1,) * call.degree
    return np.array(tensors, dtype=object).reshape(*shape, *axes), None


def _agree(tensor: Any, exact: Any) -> bool:
    return bool((tensor == exact.astype(tensor.dtype)).all())


def _by_columns(call: _Call, K: Any) -> tuple[Any, Any]:
    """Return the result of `traced` from one call with columns; raise anything if that fails."""
    symbols: list[Symbol] = []
    columns = {n: Column(a, symbols) if np.ndim(a) else a for n, a in call.parameters.items()}
    result, shape, D = call(columns), call.shape, call.D
    if K is None:
        rows = [Polynomial.of(component) for component in _components(result, D)]
    else:
        H = Polynomial.of(result)
        tensor = np.full((*shape, *(D + 1,) * 3), Fraction(0), object)
        for places, terms in _monomials(H, D, 3):
            rounded(terms, symbols)  # raises for coefficients out of range
            values = exact_values([(c / len(places), i) for c, i in terms], symbols)
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
            values = rounded(terms, symbols)
            for place in places:
                table[(..., i, *place)] = values / len(places)
    return (table, None) if K is None else (tensor, table)


def _monomials(polynomial: Polynomial, D: int, degree: int) -> Iterator[tuple[Any, Any]]:
    """Yield, for each monomial of the state, its places in a symmetric tensor and its terms."""
    terms_of: dict[tuple[int, ...], list[Any]] = {}
    for indices, c in polynomial.terms.items():
        state = tuple(i for i in indices if i >= 0)
        terms_of.setdefault(state, []).append((c, [i for i in indices if i < 0]))
    for state, terms in terms_of.items():
        if len(state) > degree:
            raise Refused
        yield {*permutations((*state, *[D] * (degree - len(state))))}, terms


def _components(result: Any, D: int) -> Any:
    """Return the result of f, if it has D components."""
    is_sequence = isinstance(result, (tuple, list, np.ndarray))
    if not is_sequence or len(result) != D:
        received = f"{short(result)}: return a tuple of {D}"
        if is_sequence:
            received = f"{len(result)}: {short(result)}"
        raise ValueError(f"must return {D} components, not {received}")
    return result


def _member(call: _Call, parameters: Mapping[str, Any], is_family: bool) -> Any:
    """Return the exact table or tensor of one member of a family, or of a single field."""
    f_name = name_of(call.f, call.argument)
    try:
        result = call(parameters)
    except Exception as error:  # raised by f
        cause = explained(error, f_name, call.names, is_family)
        is_value = isinstance(error, (ValueError, IndexError, ArithmeticError))
        is_usual = is_value or isinstance(error, (TypeError, AttributeError))
        if not is_usual and cause == " ".join(str(error).split()):
            raise
        kind = ValueError if is_value else TypeError
        raise kind(prefixed(call.argument, cause)) from (error if is_usual else None)
    try:
        if call.degree == 3:
            return _tensor(result, f_name, call.D, 3)
        parts = _components(result, call.D)
        names = (f"{name}'" for name in call.names)
        return np.stack([_tensor(*pair, call.D, 2) for pair in zip(parts, names, strict=True)])
    except (TypeError, ValueError) as error:
        raise type(error)(f"{call.argument}: {error}") from None


def _tensor(value: Any, name: str, D: int, degree: int) -> Any:
    """Return a polynomial as a symmetric tensor of fractions in homogeneous coordinates."""
    try:
        terms, table = Polynomial.of(value).terms, np.full((D + 1,) * degree, Fraction(0))
    except TypeError:
        raise TypeError(f"{name} must be a polynomial, not {short(value)}") from None
    within("coefficients", np.array([*terms.values()], dtype=object), OTHERS)
    for indices, c in terms.items():
        if len(indices) > degree:
            how = f"with more variables it may become quadratic, see {page(CUBIC)}"
            raise ValueError(f"{name} has degree {max(map(len, terms))}: {how}")
        places = {*permutations((*indices, *[D] * (degree - len(indices))))}
        for place in places:
            table[place] = c / len(places)
    return table
