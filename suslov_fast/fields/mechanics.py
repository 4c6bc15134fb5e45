"""`Mechanics`, the attribute `mechanics` of fields from a Lagrangian: functions of the state."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..checks import FloatArray, common_shape, first_index, spell, wrong
from ..keywords import Answering, public
from .constraints import constraints_of
from .tolerances import LAST_STEP_TO_CONSTRAINTS, NEWTON_STEPS_TO_CONSTRAINTS

_MADE = "Field.from_lagrangian(L, names, constraints=...) makes one"


class Mechanics(metaclass=Answering):
    """Functions of the state of a mechanical system: the attribute `mechanics` of a `Field`.

    States x broadcast with the batch of the field; t is the time, by default 0, if a function of
    the Lagrangian form takes it.

    Examples
    --------
    >>> from suslov_fast import Field
    >>> pendulum = Field.from_lagrangian(
    ...     lambda q, v: v @ v / 2 - 9.81 * q[1], "x y", constraints=lambda q, v: q @ q - 1
    ... )
    >>> pendulum.mechanics.reactions([0.0, -1.0, 0.0, 0.0]).round(12) + 0.0
    array([0.  , 9.81])
    """

    def __init__(self, field: Any) -> None:
        self._field = field

    @public
    def momenta(self, x: Any, *, t: Any = None) -> FloatArray:
        """Return the momenta L_v (..., n) at states x.

        Parameters
        ----------
        x : array_like(float, shape=(..., D))
            States.
        t : array_like(float, shape=(...)), optional
            The time.

        Returns
        -------
        ndarray(float, shape=(..., n))
        """
        return self._quantity("momenta", x, t)

    @public
    def residuals(self, x: Any, *, t: Any = None) -> FloatArray:
        """Return by how much states violate constraints: phi of all, then g of holonomic ones.

        Parameters
        ----------
        x : array_like(float, shape=(..., D))
            States.
        t : array_like(float, shape=(...)), optional
            The time.

        Returns
        -------
        ndarray(float, shape=(..., k))

        Raises
        ------
        TypeError
            If the system has no constraints.
        """
        return self._quantity("residuals", x, t)

    @public
    def multipliers(self, x: Any, *, t: Any = None) -> FloatArray:
        """Return the multipliers lambda (..., k) of the constraints at states x.

        Parameters
        ----------
        x : array_like(float, shape=(..., D))
            States.
        t : array_like(float, shape=(...)), optional
            The time.

        Returns
        -------
        ndarray(float, shape=(..., k))

        Raises
        ------
        TypeError
            If the system has no constraints.
        """
        return self._quantity("multipliers", x, t)

    @public
    def reactions(self, x: Any, *, t: Any = None) -> FloatArray:
        """Return the forces of reaction A^T lambda (..., n) along all coordinates at states x.

        Parameters
        ----------
        x : array_like(float, shape=(..., D))
            States.
        t : array_like(float, shape=(...)), optional
            The time.

        Returns
        -------
        ndarray(float, shape=(..., n))

        Raises
        ------
        TypeError
            If the system has no constraints.
        """
        return self._quantity("reactions", x, t)

    @public
    def projected(self, x: Any, *, t: Any = None) -> FloatArray:
        """Return states on the constraints, near the states x in the metric of the masses.

        Coordinates move by Newton's method until they satisfy the holonomic constraints; then
        velocities take the nearest values that satisfy all constraints. States with NaN stay NaN.

        Parameters
        ----------
        x : array_like(float, shape=(..., D))
            States.
        t : array_like(float, shape=(...)), optional
            The time.

        Returns
        -------
        ndarray(float, shape=(..., D))

        Raises
        ------
        TypeError
            If the system has no constraints.
        ValueError
            If the method finds no state for some x.
        """
        self._check("residuals")
        layout = self._field._layout
        x = layout.enter("x", x, t, "t")
        batch = common_shape({"system": self._field.shape, "x": x.shape[:-1]})
        moved = self.near(np.broadcast_to(x, (*batch, layout.D)))
        is_off = np.isnan(moved).any(axis=-1) & ~np.isnan(x).any(axis=-1)
        if is_off.any():
            where = first_index(is_off)
            at = f" at {spell(where)}" if where else ""
            found = f"one{at} from which Newton's method finds no state on them"
            raise wrong("x", "a state near the constraints", f"{found}: pass a nearer one")
        states: FloatArray = layout.leave(moved)
        return states

    # ------------------------------------------------------------------------------ of the engine
    @classmethod
    def of(cls, field: Any) -> Mechanics:
        """Return the functions of a field; TypeError if it has none."""
        mechanics = cls(field)
        mechanics._check("momenta")
        return mechanics

    def _check(self, name: str) -> None:
        """Raise TypeError unless the field has this quantity."""
        if name not in self._field._quantities:
            what = "no mechanics" if name == "momenta" else f"no {name}"
            raise TypeError(f"system: this field has {what}: {_MADE}")

    def _quantity(self, name: str, x: Any, t: Any) -> FloatArray:
        self._check(name)
        return self.at(name, self._field._layout.enter("x", x, t, "t"))

    def at(self, name: str, x: FloatArray) -> FloatArray:
        """Return values (..., n) of a quantity at states of the engine."""
        field = self._field
        shape = np.broadcast_shapes(x.shape[:-1], field._inputs.shape[1:])
        operands = field._equations.quantities[name]
        rows = field._equations.at(operands, np.moveaxis(x, -1, 0), field._inputs)
        zero = 0.0 * x.sum(axis=-1)  # NaN for states with NaN
        return np.stack([np.broadcast_to(row, shape) + zero for row in rows], axis=-1)

    def near(self, x: FloatArray) -> FloatArray:
        """Return states of the engine on the constraints near x (..., D); NaN if none is found."""
        x, sizes = np.array(x), self._field._equations.sizes
        first, last = sizes["corrections"] - sizes["momenta"], sizes["corrections"]
        has_positions = sizes["residuals"] > sizes["multipliers"]
        parts = slice(0, first), slice(first, last)
        with np.errstate(all="ignore"):
            for part in parts if has_positions else parts[1:]:
                for _ in range(NEWTON_STEPS_TO_CONSTRAINTS):
                    change = self.at("corrections", x)[..., part]
                    x[..., part] += change
                    if not (
                        abs(change) > LAST_STEP_TO_CONSTRAINTS * abs(x).max(axis=-1, keepdims=True)
                    ).any():
                        break
            constraints: Any = constraints_of(self._field)
            is_on, *_ = constraints.tested(x, self._field._inputs)
        return np.where(is_on[..., np.newaxis] > 0.0, x, np.nan)


def near_constraints(field: Any, x: FloatArray) -> FloatArray:
    """Return states of the engine on the constraints near x (..., D); x where none is found."""
    if constraints_of(field) is None:
        return x
    moved = Mechanics(field).near(x)
    return np.where(np.isnan(moved).any(axis=-1, keepdims=True), x, moved)
