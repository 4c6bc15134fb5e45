"""Coefficients of fields of degree 2: from lists of operations, from arrays, and from files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import partial, reduce
from typing import Any

import numpy as np

from .. import checks
from ..checks import OTHERS, within, wrong
from ..core.expressions.numpy_evaluation import FUNCTIONS
from ..core.expressions.programs import needed_for
from .equations import Equations
from .exact_numbers import as_given, exact
from .names import check_order
from .polynomial_dicts import (
    Polynomial,
    constant,
    difference,
    product,
    total,
    without_zeros as without_zero_terms,
)
from .terms import Terms, collected

_fractions = np.vectorize(Fraction, "O")
# The n nonzero entries of an array: their indices, one row for each axis, and values (..., n).
Entries = tuple[Any, Any]


# ------------------------------------------------------------ coefficients of lists of operations
class NotQuadratic(TypeError):
    """Equations are no polynomials of degree 2 or less; the text says why."""


def of_equations(
    equations: Equations,
    results: Sequence[Any],
    degree: int,
    parameters: Sequence[Any],
    exactly: Callable[[float], Fraction] | None = None,
) -> Terms:
    """Return the terms of `results`: the components of f, of degree 2, or [H], of degree 3.

    The values of terms are floats (..., T), where ... is the shape of `parameters`. A function
    `exactly`, from floats to fractions, makes the values of a single field fractions.
    """
    D, shape = len(equations.names), np.broadcast_shapes(*map(np.shape, parameters))
    ratios = equations.ratios

    def number(a: Any) -> Any:
        if exactly is None:
            return a if isinstance(a, float) else np.asarray(a, np.float64)[()]
        a = ratios.get(a, a) if isinstance(a, float) else a
        return exactly(a) if isinstance(a, float) else Fraction(a)

    terms = coefficients_by(number, equations, results, degree, parameters)
    values: Any = np.empty((*shape, len(terms)), np.float64 if exactly is None else object)
    for k, c in enumerate(terms.values()):
        values[..., k] = c
    within("coefficients of f", values, OTHERS)
    return collected(np.array([*terms], np.int64).reshape(-1, 3).T, values, D, degree)


def coefficients_by(
    number: Callable[[Any], Any],
    equations: Equations,
    results: Sequence[Any],
    degree: int,
    parameters: Sequence[Any],
) -> Polynomial:
    """Return the coefficients of f or H by three indices, of the type that `number` returns."""
    D = len(equations.names)
    known: dict[Any, Any] = {i: {(i,): number(1.0)} for i in range(D)}
    known |= {k: constant(number(a)) for k, a in enumerate(parameters, D)}
    with np.errstate(all="ignore"):
        for name, place, operands in needed_for(equations.values.operations, results):
            of = [constant(number(a)) if isinstance(a, float) else known[a] for a in operands]
            rule = _RULES.get(name, partial(_of_constants, name, number))
            known[place] = rule(*of)
            if known[place] is None:
                has_no_value = name == "fdiv" and not of[1]
                why = "has the denominator 0" if has_no_value else "is no polynomial"
                raise NotQuadratic(f"{equations.shown(place)} {why}")
    coefficients: Polynomial = {}
    for i, a in enumerate(results):
        terms = constant(number(a)) if isinstance(a, float) else known[a]
        if (highest := max(map(len, terms), default=0)) > degree:
            raise NotQuadratic(f"a formula has the degree {highest}")
        row = (i,) if degree == 2 else ()
        coefficients |= {(*row, *m, *(D,) * (degree - len(m))): c for m, c in terms.items()}
    return coefficients


def _quotient(a: Polynomial, b: Polynomial) -> Polynomial | None:
    if b.keys() != {()}:  # b depends on variables, or is 0
        return None
    return {m: c / b[()] for m, c in a.items()}


def _power(a: Polynomial, exponent: Polynomial) -> Polynomial | None:
    """Return a power with the exponent 0, 1, 2 or 3, else None."""
    number = exponent.get((), 0)
    if exponent.keys() - {()} or np.ndim(number) or number not in range(4):
        return None
    return reduce(product, [a] * int(number), constant(1 + 0 * number))


_RULES: dict[str, Callable[..., Any]] = {
    "fadd": total, "fsub": difference, "fmul": product, "fdiv": _quotient, "pow": _power
}  # fmt: skip


def _of_constants(name: str, number: Callable[[Any], Any], *operands: Any) -> Any:
    """Return the value of a function if its operands are constants, else None.

    The value is a constant polynomial, or an array of bool. A `select` with a constant condition
    selects between any two polynomials.
    """
    if name == "select" and not isinstance(operands[0], dict):
        condition, *(a, b) = operands
        zero = number(0.0)
        chosen = {m: np.where(condition, a.get(m, zero), b.get(m, zero))[()] for m in {**a, **b}}
        return without_zero_terms(chosen)
    if any(isinstance(a, dict) and a.keys() - {()} for a in operands):
        return None
    values = [np.float64(a.get((), 0.0)) if isinstance(a, dict) else a for a in operands]
    value = FUNCTIONS[name](*values)
    is_truth = np.asarray(value).dtype == bool
    return np.asarray(value) if is_truth else constant(number(np.asarray(value)[()]))


# -------------------------------------------------------------------------------------- of arrays
def entries(name: str, array: Any) -> Entries:
    """Return the exact entries of a single array that are not 0, as floats or fractions."""
    where = np.nonzero(np.asarray(array != 0, bool))
    values = array[where]
    if {*map(type, values.tolist())} <= {float}:
        values = checks.real_array(name, values.astype(np.float64))
    else:
        values = np.array([exact(name, each) for each in values.tolist()], object)
    return np.array(where, np.int64).reshape(array.ndim, -1), within(name, values, OTHERS)


def _of_array(name: str, value: Any, axes: int, D: int) -> Entries:
    """Return the entries of an array with `axes` axes of length D, or of a family of arrays."""
    array = as_given(name, value)
    if D == 0 or array.shape[-axes:] != (D,) * axes:
        size = D if name != "quadratic" else "D"
        raise wrong(name, f"have the shape (..., {', '.join([str(size)] * axes)})", array.shape)
    if array.ndim == axes:
        return entries(name, array)
    array = within(name, checks.real_array(name, array), OTHERS)
    where = np.nonzero((array != 0).any(axis=tuple(range(array.ndim - axes))))
    return np.array(where, np.int64).reshape(axes, -1), array[(..., *where)]


def of_arrays(quadratic: Any, linear: Any, constant: Any) -> tuple[Terms, int]:
    """Return the terms of a field with these arrays, and the number of variables."""
    array = as_given("quadratic", quadratic)
    D = (0, *array.shape)[-1]
    parts = {"quadratic": _of_array("quadratic", array, 3, D)}
    for name, value, axes in (("linear", linear, 2), ("constant", constant, 1)):
        if value is not None:
            parts[name] = _of_array(name, value, axes, D)
    # Linear terms and constants are filled up with factors 1, which have the index D.
    indices = [np.vstack([i, np.full((3 - len(i), i.shape[1]), D)]) for i, _ in parts.values()]
    batch = checks.common_shape({name: v.shape[:-1] for name, (_, v) in parts.items()})
    values = [np.broadcast_to(v, (*batch, v.shape[-1])) for _, v in parts.values()]
    if batch or any(v.dtype == object for v in values):
        values = [v.astype(np.float64) if batch else _fractions(v) for v in values]
    return collected(np.hstack(indices), np.concatenate(values, axis=-1), D, 2), D


def of_file(indices: Any, values: Any, D: int) -> Terms:
    """Return the terms of the entries of a dictionary: i, j, k (3, T) and v (..., T)."""
    places = _indices("indices", indices, (D, D + 1, D + 1))
    array = _values("values", values, places.shape[1])
    if array.ndim == 1:
        (which,), array = entries("values", array)
        places = places[:, which]
    else:
        array = within("values", checks.real_array("values", array), OTHERS)
    terms = collected(places, array, D, 2)
    if terms.indices.shape[1] < places.shape[1]:
        raise wrong("indices", "hold each term once", "one of them again")
    return terms


def _indices(name: str, given: Any, ends: tuple[int, ...]) -> Any:
    """Return checked indices (rows, T); in each row they are from 0 and less than its `ends`."""
    indices = np.asarray(given)
    if indices.size == 0:
        return np.zeros((len(ends), 0), np.int64)
    if indices.dtype.kind not in "iu" or indices.shape != (len(ends), indices.shape[-1]):
        raise wrong(name, f"integers of the shape ({len(ends)}, T)", checks.short(given))
    if ((indices < 0) | (indices >= np.reshape(ends, (-1, 1)))).any():
        raise wrong(name, f"integers from 0, in rows below {ends}", checks.short(given))
    return indices.astype(np.int64)


def _values(name: str, given: Any, count: int) -> Any:
    """Return values (..., count) as they were given."""
    array = as_given(name, given)
    if array.ndim == 0 or array.shape[-1] != count:
        raise wrong(name, f"have the shape (..., {count}), one for each term", array.shape)
    return array


def structure_matrix(K: Any, D: int, names: Sequence[str] = ()) -> Any:
    """Return the antisymmetric matrix of a Hamiltonian field as (3, n): i, j and exact values."""
    if K is None:
        if D % 2:
            raise wrong(
                "names", "even in number where K is left out, the matrix of x' = K grad H", D
            )
        check_order(names)
        q, p, one = np.arange(D // 2), np.arange(D // 2, D), np.full(D // 2, Fraction(1))
        places, values = np.array([[*q, *p], [*p, *q]]), np.concatenate([one, -one])
    elif isinstance(K, Mapping):
        if {*K} != {"indices", "values"}:
            raise wrong("K", "have the entries indices and values", ", ".join(map(str, K)))
        places = _indices("K", K["indices"], (D, D))
        (which,), values = entries("K", _values("K", K["values"], places.shape[1]))
        places = places[:, which]
    else:
        array = as_given("K", K)
        if array.shape != (D, D):
            raise wrong("K", f"an antisymmetric matrix of shape ({D}, {D})", array.shape)
        places, values = _of_array("K", array, 2, D)
    values = _fractions(values)
    by_place = dict(zip(zip(*places.tolist(), strict=True), values, strict=True))
    for (i, j), v in by_place.items():
        if (w := by_place.get((j, i), Fraction(0))) != -v:
            received = f"one with {float(v)} at {i, j} and {float(w)} at {j, i}"
            raise wrong("K", f"an antisymmetric matrix of shape ({D}, {D})", received)
    return np.vstack([places.astype(object), values])
