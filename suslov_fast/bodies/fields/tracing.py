"""Coefficients of a field, from calls of the user's function f with polynomials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from ...checks import OTHERS, within
from .calls import alone, called, check_same, components
from .exact import Exact
from .polynomials import Number, Polynomial
from .symbolic import Symbol
from .terms import Terms, collected

# The exact terms of a Hamiltonian, or of the components of a field, by their three indices.
_Places = dict[tuple[int, ...], Number]


def terms_of_function(
    argument: str, f: Any, names: Sequence[str], parameters: Mapping[str, Any], degree: int
) -> Terms:
    """Return the exact terms of a field f (degree 2) or of a Hamiltonian (degree 3).

    For a family f is called for each member. `argument` is the public argument that holds f.
    """
    shape = np.broadcast_shapes(*map(np.shape, parameters.values()))
    tracer, rows = Exact(names), []
    columns = [np.broadcast_to(np.asarray(a).astype(object), shape) for a in parameters.values()]
    for values in zip(*(column.ravel() for column in columns), strict=True) if columns else [()]:
        of_member = dict(zip(parameters, values, strict=True))
        rows.append(_member(argument, f, tracer, of_member, degree))
        if len(rows) == 1:
            check_same(argument, _member(argument, f, tracer, of_member, degree), rows[0])
    places = [*dict.fromkeys(place for terms in rows for place in terms)]
    found: Any = np.empty((len(rows), len(places)), object)
    for row, terms in zip(found, rows, strict=True):
        row[:] = [Fraction(terms.get(place, 0)) for place in places]
    try:
        within("coefficients", found, OTHERS)
    except ValueError as error:
        raise ValueError(f"{argument}: {error}") from None
    indices = np.array(places, np.int64).reshape(-1, 3).T
    return collected(indices, found.reshape(*shape, len(places)), len(names), degree)


def _member(
    argument: str, f: Any, tracer: Exact, parameters: Mapping[str, Any], degree: int
) -> _Places:
    """Return the exact terms of one member of a family, or of a single field or Hamiltonian."""
    result, D = called(argument, f, tracer.state, parameters), len(tracer.names)
    try:
        if degree == 3:
            return _terms_of(result, D, degree)
        rows = (_terms_of(part, D, degree, i) for i, part in enumerate(components(result, D)))
        return {place: c for row in rows for place, c in row.items()}
    except (TypeError, ValueError) as error:
        raise type(error)(f"{argument}: {error}") from None


def _terms_of(value: Any, D: int, most: int, *row: int) -> _Places:
    """Return the terms of a polynomial by their three indices: `row`, and those of factors."""
    value = alone(value)
    terms = Polynomial.of(value.operand if isinstance(value, Symbol) else value).terms
    if (degree := max(map(len, terms), default=0)) > most:
        raise ValueError(f"a formula has degree {degree}, above {most}: use Field")
    one = (D,) * most
    return {(*row, *indices, *one[len(indices) :]): c for indices, c in terms.items()}
