"""Coefficients of quadratic fields: the list of operations of f, carried out with polynomials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from ...checks import OTHERS, within
from .polynomials import NoPolynomial, Number, Polynomial
from .terms import Terms, collected

_RULES: dict[str, Any] = {
    "fadd": lambda a, b: a + b,
    "fsub": lambda a, b: a - b,
    "fmul": lambda a, b: a * b,
    "fdiv": lambda a, b: a * b.inverse(),
    "sum": lambda *parts: sum(parts[1:], parts[0]),
}


def terms_of(
    argument: str, equations: Any, results: Sequence[Any], parameters: Mapping[str, Any]
) -> Terms:
    """Return the exact terms of f (degree 2, D results), or of H (degree 3, one result).

    For a family the list is carried out for each member. `argument` is "f" or "H".
    """
    D, degree = len(equations.names), 2 if argument == "f" else 3
    shape = np.broadcast_shapes(*map(np.shape, parameters.values()))
    columns = [np.broadcast_to(np.asarray(a).astype(object), shape) for a in parameters.values()]
    members = zip(*(column.ravel() for column in columns), strict=True) if columns else [()]
    rows = [_member(argument, equations, results, values, degree) for values in members]
    places = [*dict.fromkeys(place for terms in rows for place in terms)]
    found: Any = np.empty((len(rows), len(places)), object)
    for row, terms in zip(found, rows, strict=True):
        row[:] = [Fraction(terms.get(place, 0)) for place in places]
    try:
        within("coefficients", found, OTHERS)
    except ValueError as error:
        raise ValueError(f"{argument}: {error}") from None
    indices = np.array(places, np.int64).reshape(-1, 3).T
    return collected(indices, found.reshape(*shape, len(places)), D, degree)


def _member(
    argument: str, equations: Any, results: Sequence[Any], values: Sequence[Any], degree: int
) -> dict[tuple[int, ...], Number]:
    """Return the exact terms of one member by their three indices."""
    D, one = len(equations.names), (len(equations.names),) * degree
    known = {i: Polynomial({(i,): 1}) for i in range(D)}
    known |= {k: Polynomial.of(value) for k, value in enumerate(values, D)}

    def of(a: Any) -> Polynomial:
        return Polynomial.of(a) if isinstance(a, float) else known[a]

    try:
        for name, number, operands in equations.values.operations:
            if name not in _RULES:
                raise NoPolynomial(f"{equations.shown(number)} is no polynomial")
            known[number] = _RULES[name](*map(of, operands))
    except (TypeError, ValueError) as error:
        raise type(error)(f"{argument}: {error}") from None
    found: dict[tuple[int, ...], Number] = {}
    for i, a in enumerate(results):
        terms, row = of(a).terms, (i,) if degree == 2 else ()
        if (highest := max(map(len, terms), default=0)) > degree:
            text = f"a formula has degree {highest}, above {degree}: use Field, and flow"
            raise ValueError(f"{argument}: {text}")
        found |= {(*row, *m, *one[len(m) :]): c for m, c in terms.items()}
    return found
