"""Named parameters of fields: their values, and how coefficients depend on them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np

from .._checks import FloatArray, common_shape, real_array, refuse_units, without_labels, wrong
from .algebra import Polynomial, coefficients_in, dense, fill, plain, rational

Values = dict[str, Any]
# For each component its terms [c, 0, "a", ...], each for c x[0] a ..., for JSON; then those of the
# Hamiltonian, if there is one.
Affine = list[list[list[Any]]]
# The components of the field of a function of x, or of x and a number of symbols after it; then the
# Hamiltonian, if there is one.
PolynomialsOf = Callable[[Callable[[Any], Any], int], tuple[Polynomial, ...]]

# Names that functions, datasets, stores and files use.
_RESERVED = frozenset(
    "x f H K dimension eps n time flat component component_j component_k term space body "
    "trajectory status failed_at final quadratic linear constant format steps save_every version "
    "map method progress record x_min x_max first_integral_drift modified_energy_drift "
    "energy_drift".split()
)


def check_parameters(parameters: Mapping[str, Any]) -> Values:
    """Return parameters by name: numbers as they are, and read-only arrays of floats."""
    found: Values = {}
    for name, value in parameters.items():
        if name in _RESERVED or not name.isidentifier():
            taken = "a name that is not in use, as a or rho"
            raise wrong("parameters", taken, repr(name))
        refuse_units(name, value)
        without_labels({name: value})
        if isinstance(value, list | tuple) or np.ndim(value):
            found[name] = np.array(real_array(name, value))
            found[name].flags.writeable = False
        else:
            found[name] = value.item() if isinstance(value, np.ndarray | np.generic) else value
            rational(name, found[name])
    common_shape({name: np.shape(value) for name, value in found.items()})
    return found


def plain_parameters(values: Values, affine: Affine) -> dict[str, Any]:
    """Return parameters for JSON, exact numbers without loss."""
    if not values:
        return {}
    found = {
        name: value.tolist() if np.ndim(value) else plain(rational(name, value))
        for name, value in values.items()
    }
    return {"parameters": found} | ({"affine": affine} if affine else {})


def coefficients_for(
    f: Callable[..., Any], components: PolynomialsOf, values: Values, D: int
) -> dict[str, FloatArray]:
    """Return the coefficients of the fields for all values of the parameters."""
    arrays = np.broadcast_arrays(*values.values())
    columns = (array.ravel().tolist() for array in arrays)
    shape = arrays[0].shape
    tables, energies = np.zeros((math.prod(shape), D, D + 1, D + 1)), []
    for table, numbers in zip(tables, zip(*columns, strict=True), strict=True):
        given = dict(zip(values, numbers, strict=True))
        terms = [each.terms for each in components(partial(f, **given), 0)]
        fill(table, terms[:D])
        energies += [dense(each, D) for each in terms[D:]]
    found = coefficients_in(tables.reshape(*shape, D, D + 1, D + 1))
    return found | ({"H": np.reshape(energies, (*shape, -1))} if energies else {})


def affine_terms(
    f: Callable[..., Any], components: PolynomialsOf, values: Values, D: int
) -> Affine:
    """Return the terms of the components, with the parameters in which they are affine as factors.

    Symbols for these parameters are variables after those of the state. Without such parameters, or
    if an array is not one of them, there are no terms.
    """
    columns = ((name, np.ravel(value)[:1].tolist()) for name, value in values.items())
    first = {name: number for name, numbers in columns for number in numbers}

    def attempt(*names: str) -> Affine:
        factors = [*range(D), *names]
        try:
            found = components(
                lambda x: f(x[:D], **first | dict(zip(names, x[D:], strict=True))), len(names)
            )
        except Exception:  # of functions that compare parameters, take roots of them, and so on
            return []
        for i, powers in ((i, powers) for i, each in enumerate(found) for powers in each.terms):
            symbols = [k for k in powers if k >= D]
            degree = len(powers) - len(symbols)
            if len({*symbols}) < len(symbols) or degree > 2 + (i == D):
                return []
        return [
            [[plain(c), *(factors[k] for k in powers)] for powers, c in each.terms.items()]
            for each in found
        ]

    names = [name for name in values if attempt(name)]
    if not names or any(np.ndim(values[name]) for name in values if name not in names):
        return []
    return attempt(*names)


def coefficients_at(affine: Affine, values: Values, D: int) -> dict[str, FloatArray]:
    """Return the coefficients at values of the parameters."""
    shape = np.broadcast_shapes(*map(np.shape, values.values()))
    components: list[dict[tuple[int, ...], Any]] = [{} for _ in affine]
    for terms, component in zip(affine, components, strict=True):
        for c, *factors in terms:
            powers = tuple(k for k in factors if isinstance(k, int))
            names = (name for name in factors if isinstance(name, str))
            term = math.prod((values[name] for name in names), start=1.0) * float(Fraction(c))
            component[powers] = component.get(powers, 0.0) + term
    table = np.zeros((*shape, D, D + 1, D + 1))
    fill(table, components[:D])
    energy = {"H": dense(components[D], D, shape)} if len(components) > D else {}
    return coefficients_in(table) | energy
