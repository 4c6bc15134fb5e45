"""Constraints of mechanics as functions of the state, with derivatives."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from ..checks import FloatArray, first_index, spell, wrong
from ..core.cached import cached_property
from ..core.expressions.derivative import gradients
from ..core.expressions.numpy_evaluation import results_at
from ..core.expressions.programs import Program, in_order
from ..core.expressions.projection import test_of_start
from .equations import Equations
from .right_hand_sides import by_code_if_often

_SINGULAR = "a singular one{1}: leave out constraints that follow from others"
_OFF = "off by {:.3g}{}: move states there by field.mechanics.projected(x0)"


class Constraints:
    """The constraints of equations: r residuals that are 0 on their manifold, and the derivatives.

    count    the number r; the manifold has D - r dimensions, those of clocks included
    parts    where coordinates, and where velocities are in the state
    """

    def __init__(self, equations: Equations) -> None:
        self.D, sizes = len(equations.names), equations.sizes
        self.parameters = len(equations.parameters)
        first = sizes["corrections"] - sizes["momenta"]
        self.parts = slice(0, first), slice(first, sizes["corrections"])
        values, residuals = in_order(equations.values, equations.quantities["residuals"])
        rows = gradients(values, [*values.operations], residuals, self.D)
        self.count = len(residuals)
        self.places = [(k, j) for k, row in enumerate(rows) for j in row]
        entries = [rows[k][j] for k, j in self.places]
        self.program = Program(values.operations, [*residuals, *entries])

    @cached_property
    def _test(self) -> Any:
        return _Test(self)

    def tested(self, x: FloatArray, parameters: FloatArray) -> FloatArray:
        """Return the results (3, ...) of `test_of_start` at states x (..., D)."""
        shape, found = np.broadcast_shapes(x.shape[:-1], parameters.shape[1:]), None
        rows = np.moveaxis(x, -1, 0)
        if shape:

            def of_all(a: FloatArray) -> FloatArray:
                axes = (1,) * (len(shape) + 1 - a.ndim)
                whole = np.broadcast_to(a.reshape(len(a), *axes, *a.shape[1:]), (len(a), *shape))
                return whole.reshape(len(a), math.prod(shape))

            found = by_code_if_often(self._test, "start", of_all(rows), of_all(parameters))
        else:
            found = by_code_if_often(self._test, "start", x, parameters)
        if found is not None:
            return found.reshape(-1, *shape)
        return results_at(self._test.start, dict(enumerate([*rows, *parameters])), shape)

    def rows(self, moving: Any) -> list[int]:
        """Return the numbers of residuals that depend on the components `moving` (n numbers)."""
        return sorted({k for k, j in self.places if j in {*moving}})

    def of(self, x: FloatArray, parameters: FloatArray, moving: Any) -> tuple[Any, Any]:
        """Return residuals (..., r) and derivatives (..., r, n) of `rows` by n components."""
        residuals, slopes = self.at(x, parameters)
        rows = self.rows(moving)
        return residuals[..., rows], slopes[..., rows, :][..., moving]

    def at(self, x: FloatArray, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return residuals (..., r) and their derivatives (..., r, D) at states x (..., D)."""
        shape = np.broadcast_shapes(x.shape[:-1], parameters.shape[1:])
        given = dict(enumerate([*np.moveaxis(x, -1, 0), *parameters]))
        rows = np.moveaxis(results_at(self.program, given, shape), 0, -1)
        slopes = np.zeros((*shape, self.count, self.D))
        for n, (k, j) in enumerate(self.places, self.count):
            slopes[..., k, j] = rows[..., n]
        return rows[..., : self.count], slopes


class _Test:
    """`start`, the `Program` `test_of_start` of a state and parameters, and what its code needs."""

    is_dense, steady = False, ()

    def __init__(self, of: Constraints) -> None:
        self.D, self.positions = of.D, of.parts[0].stop
        self.clocks, self.table = range(of.parts[1].stop, of.D), range(of.D, of.D + of.parameters)
        self.places = {p: p - of.D for p in self.table}
        self.invariants, self.invariants_places = of.program, of.places
        self.constraints_count = self.invariants_count = of.count
        self.start = test_of_start(self)
        self.cost, self.key = len(self.start.operations), repr((self.D, self.start))


_constraints_of = lru_cache(64)(Constraints)


def constraints_of(field: Any) -> Constraints | None:
    """Return the `Constraints` of a field; None for a field without constraints."""
    return _constraints_of(field._equations) if "residuals" in field._quantities else None


def check_constraints(field: Any, x: FloatArray) -> None:
    """Raise ValueError if states of the engine (..., D) violate constraints of mechanics."""
    constraints = constraints_of(field)
    if constraints is None or not (x.size and math.prod(field.shape)):
        return
    is_on, is_regular, errors = constraints.tested(x, field._inputs)
    if is_on.all() and is_regular.all():
        return
    exists = np.isfinite(errors)
    for is_good, need, how in (
        (is_regular, "a state with independent constraints", _SINGULAR),
        (is_on, "on the constraints", _OFF),
    ):
        if (is_bad := exists & (is_good == 0.0)).any():
            where = first_index(is_bad)
            at = f" at {spell(where)}" if where else ""
            raise wrong("x0", need, how.format(errors[where], at))
