"""Coefficients of a field, from calls of the user's function f with polynomials.

For a family, f is called once with a column for each parameter that varies, and for one member, to
confirm the coefficients. If they differ, or if f does something that a column refuses, such as
a comparison, f is called for each member.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from ...checks import OTHERS, within
from .calls import alone, called, check_same, components
from .columns import ColumnSymbol, Refused, exact_values, rounded
from .exact import Exact
from .polynomials import Polynomial
from .symbolic import Symbol
from .terms import Terms, collected

# The exact terms of a polynomial, or of the components of a field, by their three indices.
_Places = dict[tuple[int, ...], Fraction]
_ZERO = Fraction(0)
# Families with fewer members are not worth a column: f is called for each member.
_FEWEST = 4


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

    def __call__(self, tracer: Exact) -> Any:
        return called(self.argument, self.f, tracer.state, tracer.parameters)


def terms_of_function(
    argument: str, f: Any, names: Sequence[str], parameters: Mapping[str, Any], K: Any = None
) -> tuple[Terms, Terms | None]:
    """Return (terms, None) for a field f, or (terms, terms of f or None) for a Hamiltonian with K.

    Values are fractions, unless one call of f was enough for a family: then those of the field are
    floats, rounded once. Otherwise they are None for a Hamiltonian, and follow from H and K.
    """
    call = _Call(argument, f, names, 2 if K is None else 3, parameters)
    shape = call.shape
    columns = [np.broadcast_to(np.asarray(a).astype(object), shape) for a in parameters.values()]

    def member(index: tuple[int, ...]) -> _Places:
        values = (column[index] for column in columns)
        return _member(call, dict(zip(parameters, values, strict=True)))

    indices = [*np.ndindex(shape)]
    if len(indices) >= _FEWEST:
        sample = indices[len(indices) // 2]
        found = member(sample)  # which explains errors of f
        try:
            at_once = _by_columns(call, K)
        except Exception:  # f may raise anything where a column behaves unlike a float
            at_once = None
        if at_once and _agree(at_once[0], sample, found):
            return at_once
    members = [member(index) for index in indices]
    if members:
        check_same(argument, member(indices[0]), members[0])
    places = [*dict.fromkeys(place for terms in members for place in terms)]
    values = np.empty((len(members), len(places)), object)
    for row, terms in zip(values, members, strict=True):
        row[:] = [terms.get(place, _ZERO) for place in places]
    return _collected(places, values.reshape(*shape, len(places)), call), None


def _collected(places: Sequence[Any], values: Any, call: _Call) -> Terms:
    indices = np.array(places, np.int64).reshape(-1, 3).T
    return collected(indices, values, call.D, call.degree)


def _agree(terms: Terms, index: tuple[int, ...], exact: _Places) -> bool:
    """Return whether the terms of a family have the values of this member."""
    kind = terms.values.dtype
    own = dict(Terms(terms.indices, terms.values[index]).members())
    places = np.array([[own.get(p, 0), exact.get(p, _ZERO)] for p in {*own, *exact}], object)
    first, second = places.reshape(-1, 2).T
    return bool((first == second.astype(kind)).all())


def _by_columns(call: _Call, K: Any) -> tuple[Terms, Terms | None]:
    """Return `terms_of_function` by one call with columns; raise anything if that fails."""
    tracer, D = Exact(call.names, call.parameters), call.D
    result, symbols = call(tracer), tracer.columns
    if K is None:
        rows = [_polynomial(component) for component in components(result, D)]
        return _rounded_rows(rows, call, symbols), None
    H, columns_of_K = _polynomial(result), defaultdict[int, list[Any]](list)
    of_H = _monomials(H, D, 3)
    for terms in of_H.values():
        rounded(terms, symbols)  # raises for coefficients out of range
    values = [np.broadcast_to(exact_values(terms, symbols), call.shape) for terms in of_H.values()]
    for i, j, c in K.T:
        columns_of_K[j].append((i, c))
    slopes: list[list[Any]] = [[] for _ in range(D)]
    for indices, c in H.terms.items():
        for place, m in enumerate(indices):
            for i, factor in columns_of_K.get(m, ()):
                slopes[i].append(((*indices[:place], *indices[place + 1 :]), factor * c))
    energy = _collected([*of_H], _last_axis(values, call.shape, object), call)
    return energy, _rounded_rows([*map(Polynomial, slopes)], call._replace(degree=2), symbols)


def _rounded_rows(
    rows: Sequence[Polynomial], call: _Call, symbols: Sequence[ColumnSymbol]
) -> Terms:
    """Return the terms of components with symbols for columns, rounded once."""
    places, values = [], []
    for i, row in enumerate(rows):
        for place, terms in _monomials(row, call.D, 2).items():
            places.append((i, *place))
            values.append(np.broadcast_to(rounded(terms, symbols), call.shape))
    return _collected(places, _last_axis(values, call.shape, np.float64), call)


def _last_axis(values: Sequence[Any], shape: tuple[int, ...], kind: Any) -> Any:
    """Return arrays of a shape as one array (*shape, T)."""
    return np.stack(values, axis=-1) if values else np.empty((*shape, 0), kind)


def _monomials(polynomial: Polynomial, D: int, degree: int) -> dict[tuple[int, ...], Any]:
    """Return the terms of each monomial of the state, by its indices; D stands for 1."""
    terms_of: dict[tuple[int, ...], list[Any]] = {}
    for indices, c in polynomial.terms.items():
        state = tuple(i for i in indices if i >= 0)
        if len(state) > degree:
            raise Refused
        state += (D,) * (degree - len(state))
        terms_of.setdefault(state, []).append((c, [i for i in indices if i < 0]))
    return terms_of


def _member(call: _Call, parameters: Mapping[str, Any]) -> _Places:
    """Return the exact terms of one member of a family, or of a single field or Hamiltonian."""
    result = call(Exact(call.names, parameters))
    try:
        if call.degree == 3:
            terms = _terms_of(result, call)
        else:
            rows = (_terms_of(part, call, i) for i, part in enumerate(components(result, call.D)))
            terms = {place: c for row in rows for place, c in row.items()}
        within("coefficients", np.array([*terms.values()], dtype=object), OTHERS)
    except (TypeError, ValueError) as error:
        raise type(error)(f"{call.argument}: {error}") from None
    return terms


def _polynomial(value: Any) -> Polynomial:
    value = alone(value)
    return Polynomial.of(value.operand if isinstance(value, Symbol) else value)


def _terms_of(value: Any, call: _Call, *row: int) -> _Places:
    """Return the terms of a polynomial by their three indices: `row`, and those of factors."""
    terms = _polynomial(value).terms
    if (degree := max(map(len, terms), default=0)) > call.degree:
        raise ValueError(f"a formula has degree {degree}, above {call.degree}: use Field")
    one = (call.D,) * call.degree
    return {(*row, *indices, *one[len(indices) :]): c for indices, c in terms.items()}
