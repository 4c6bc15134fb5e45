"""Named parameters of fields: their values, and how coefficients depend on them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import partial
from itertools import repeat
from typing import Any

import numpy as np

from .._checks import FloatArray, common_shape, real_array, refuse_units, without_labels, wrong
from .algebra import (
    Polynomial,
    coefficients_of,
    exact_array,
    from_plain,
    plain,
    plain_lists,
    rational,
)

Values = dict[str, Any]
# The names of parameters, and the coefficients of their products "", "a", "a*b" ..., for JSON.
Affine = dict[str, Any]

_NAMES = "quadratic", "linear", "constant"
# Names that functions, datasets, stores and files use.
_RESERVED = frozenset(
    "x f H K dimension eps n time flat component component_j component_k space body trajectory "
    "status failed_at final quadratic linear constant format steps save_every version map method "
    "progress record x_min x_max first_integral_drift modified_energy_drift energy_drift".split()
)


def checked(parameters: Mapping[str, Any]) -> Values:
    """Return parameters by name: numbers as they are, and read-only arrays of floats."""
    found: Values = {}
    for name, value in parameters.items():
        if name in _RESERVED or not name.isidentifier():
            taken = "a name that is not in use, as a or rho"
            raise wrong("parameters", taken, repr(name))
        refuse_units(name, value)
        without_labels({name: value})
        if isinstance(value, list | tuple) or np.ndim(value):
            array = np.array(real_array(name, value))
            array.flags.writeable = False
            found[name] = array
            continue
        number = value.item() if isinstance(value, np.ndarray | np.generic) else value
        if isinstance(number, bool):
            raise wrong(name, "a number", number, TypeError)
        rational(name, number)
        found[name] = number
    common_shape({name: np.shape(value) for name, value in found.items()})
    return found


def arrays_of(values: Values) -> dict[str, FloatArray]:
    """Return parameters as floats, by name."""
    return {name: np.asarray(value, np.float64) for name, value in values.items()}


def batch_of(
    f: Callable[..., Any],
    polynomials: Callable[..., tuple[Polynomial, ...]],
    values: Values,
    D: int,
) -> dict[str, FloatArray]:
    """Return the coefficients of the fields for all values of the parameters."""
    arrays = np.broadcast_arrays(*arrays_of(values).values())
    shape = arrays[0].shape
    table = np.zeros((math.prod(shape), D, D + 1, D + 1))
    columns = (
        each.ravel().tolist() if np.ndim(values[name]) else repeat(values[name])
        for name, each in zip(values, arrays, strict=True)
    )
    for row, numbers in zip(table, zip(*columns, strict=False), strict=True):
        given = partial(f, **dict(zip(values, numbers, strict=True)))
        for i, each in enumerate(polynomials(given)):
            for powers, c in each.terms.items():
                j, k = (*powers, D, D)[:2]
                row[i, j, k] = row[i, k, j] = float(c / 2 if j != k and k < D else c)
    table = table.reshape(*shape, D, D + 1, D + 1)
    parts = table[..., :D, :D], table[..., :D, D], table[..., D, D]
    return dict(zip(_NAMES, parts, strict=True))


def affine_in(
    f: Callable[..., Any],
    polynomials: Callable[..., tuple[Polynomial, ...]],
    values: Values,
    D: int,
) -> Affine:
    """Return how coefficients depend on the parameters in which they are affine; {} for none.

    Symbols for these parameters are variables after those of the state.
    """
    known = [(name, value) for name, value in values.items() if np.size(value)]
    first = {name: np.ravel(value)[0] if np.ndim(value) else value for name, value in known}

    def attempt(*names: str) -> Affine:
        others = {name: value for name, value in first.items() if name not in names}
        try:
            found = polynomials(
                lambda x: f(x[:D], **others, **dict(zip(names, x[D:], strict=True))), len(names)
            )
        except Exception:  # of functions that compare parameters, take roots of them, and so on
            return {}
        parts: dict[str, list[dict[Any, Any]]] = {"": [{} for _ in found]}
        for i, each in enumerate(found):
            for powers, c in each.terms.items():
                factors = [names[k - D] for k in powers if k >= D]
                if len({*factors}) < len(factors):
                    return {}
                part = parts.setdefault("*".join(factors), [{} for _ in found])
                part[i][tuple(k for k in powers if k < D)] = c
        products = {
            product: {
                name: plain_lists(array)
                for name, array in zip(
                    reversed(_NAMES), coefficients_of(tuple(map(Polynomial, part))), strict=True
                )
            }
            for product, part in parts.items()
        }
        return {"parameters": list(names), "products": products}

    if whole := attempt(*values) if values else {}:
        return whole
    names = [name for name in values if attempt(name)]
    if any(np.ndim(values[name]) for name in values if name not in names):
        return {}
    return attempt(*names) if names else {}


def evaluated(affine: Affine, values: Values) -> dict[str, Any]:
    """Return coefficients at values of the parameters: exact for single numbers, else floats."""
    is_single = not any(map(np.ndim, values.values()))
    total: dict[str, Any] = {}
    for product, arrays in affine["products"].items():
        numbers = [values[name] for name in product.split("*") if name]
        for name, nested in arrays.items():
            exact = exact_array(name, from_plain(name, nested), np.shape(nested))
            if is_single:
                factor = math.prod(map(partial(rational, name), numbers), start=Fraction(1))
                total[name] = total.get(name, 0) + exact * factor
            else:
                several = math.prod(numbers, start=np.float64(1.0))
                whole = np.multiply.outer(several, exact.astype(np.float64))
                total[name] = total.get(name, 0.0) + whole
    shape = np.broadcast_shapes(*map(np.shape, values.values()))
    if not is_single:
        axes = np.ndim(affine["products"][""]["constant"])
        total["constant"] = np.broadcast_to(
            total["constant"], (*shape, *total["constant"].shape[-axes:])
        )
    return total


def described(values: Values, affine: Affine) -> dict[str, Any]:
    """Return parameters for JSON, exact numbers without loss."""
    if not values:
        return {}
    found = {
        name: value.tolist() if np.ndim(value) else plain(rational(name, value))
        for name, value in values.items()
    }
    return {"parameters": found} | ({"affine": affine} if affine else {})
