"""The words of a lifted field at states: their values, and their derivatives by the state."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..checks import FloatArray

# Values of a program that are no variables: polynomials are sums of (place of a coefficient,
# variables), where the place is -1 for a coefficient 1.
ONE = -1


class Lift(NamedTuple):
    """The definitions of words by a state; see `bodies.lifting`. It can be hashed.

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


def values_of(lift: Lift, coefficients: FloatArray, x: FloatArray) -> list[Any]:
    """Return the values of all variables at states (..., given), by NumPy: (variables, ...).

    `coefficients` (..., n) has those of a single field, or of each member of a family.
    """
    with np.errstate(all="ignore"):
        variables = [x[..., i] for i in range(lift.given)]
        for function, terms, exponent in lift.definitions:
            p = polynomial_at(terms, coefficients, variables)
            if function == "inverse":
                u = 1.0 / p
            elif function == "root":
                u = 1.0 / np.sqrt(p)
            elif function == "power":
                u = np.power(p, coefficients[..., exponent])
            else:
                u = getattr(np, function)(p)
            variables.append(u)
    return variables


def polynomial_at(terms: Any, coefficients: FloatArray, variables: list[Any]) -> Any:
    """Return the value (...) of a polynomial at variables (..., each)."""
    total: Any = 0.0
    for place, factors in terms:
        product: Any = 1.0 if place == ONE else coefficients[..., place]
        for i in factors:
            product = product * variables[i]
        total = total + product
    return total


def slopes_of(lift: Lift, coefficients: FloatArray, x: FloatArray) -> FloatArray:
    """Return the derivatives of all words by the state (..., M, given), by NumPy."""
    variables = values_of(lift, coefficients, x)
    slopes: list[dict[int, Any]] = [{i: 1.0} for i in range(lift.given)]

    def of_product(factors: tuple[int, ...], c: Any) -> dict[int, Any]:
        slope: dict[int, Any] = {}
        for k, i in enumerate(factors):
            rest = c
            for j in (*factors[:k], *factors[k + 1 :]):
                rest = rest * variables[j]
            for j, value in slopes[i].items():
                slope[j] = slope.get(j, 0.0) + rest * value
        return slope

    with np.errstate(all="ignore"):
        for n, (function, terms, exponent) in enumerate(lift.definitions, lift.given):
            p, u = polynomial_at(terms, coefficients, variables), variables[n]
            r = coefficients[..., exponent] if function == "power" else 0.0
            factor = _slope(function, p, u, r)
            slope: dict[int, Any] = {}
            for place, factors in terms:
                c = 1.0 if place == ONE else coefficients[..., place]
                for j, value in of_product(factors, c).items():
                    slope[j] = slope.get(j, 0.0) + value
            slopes.append({j: factor * value for j, value in slope.items()})
        words = [(i,) for i in range(lift.given)] + [*lift.words]
        rows = [of_product(word, 1.0) for word in words]
    batch = np.broadcast_shapes(x.shape[:-1], coefficients.shape[:-1])
    out = np.zeros((*batch, len(words), lift.given))
    for k, row in enumerate(rows):
        for j, value in row.items():
            out[..., k, j] = value
    return out


def _slope(function: str, p: Any, u: Any, r: Any) -> Any:
    """Return g'(p) for u = g(p), and the exponent r of a power."""
    slopes: dict[str, Callable[[], Any]] = {
        "inverse": lambda: -u * u,
        "root": lambda: -0.5 * u / p,
        "power": lambda: r * u / p,
        "cbrt": lambda: u / (3.0 * p),
        "exp": lambda: u,
        "log": lambda: 1.0 / p,
        "arctan": lambda: 1.0 / (1.0 + p * p),
        "tan": lambda: 1.0 + u * u,
        "tanh": lambda: 1.0 - u * u,
        "sin": lambda: np.cos(p),
        "cos": lambda: -np.sin(p),
        "sinh": lambda: np.cosh(p),
        "cosh": lambda: np.sinh(p),
    }
    return slopes[function]()
