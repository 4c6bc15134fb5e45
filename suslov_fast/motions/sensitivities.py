"""Derivatives of motions by initial states and parameters, as columns beside the states.

Columns are scaled by powers of 2 to the size of the states, because they share an error estimate.
Columns by the initial state get its size, and a column by a parameter gets the size of its value.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..checks import FloatArray
from ..core.expressions.event_formulas import EventAction
from ..core.expressions.variational import variational
from ..core.flow.batch_solver import Settings, SolverRequest
from ..core.flow.held import HALF
from ..fields.right_hand_sides import OfMembers, with_events
from ..maps.kernel_arguments import flat_arrays
from .integration import SolverResult, to_tolerance


@dataclass
class WithColumns:
    """A stand-in for a field in `integration.solve`, with derivatives (columns) or events."""

    shape: tuple[int, ...]
    _right_hand_sides: list[OfMembers]


class Columns:
    """The derivatives of trajectories x (B, D) of a field, as C columns of D more variables.

    field, settings  for the motion with columns, in place of the field and its settings
    starts           (B, D + D C); columns are by x0 if `by_starts`, then by `parameters`

    `groups`, if given, replace the right-hand sides of the members of the field, as with events.
    """

    def __init__(
        self,
        field: Any,
        x: FloatArray,
        batch: tuple[int, ...],
        by_starts: bool,
        parameters: tuple[str, ...],
        settings: Settings,
        groups: list[OfMembers] | None = None,
    ) -> None:
        B, self.D = x.shape
        if groups is None:
            groups = field._listed_right_hand_sides
            if parameters:
                groups = field._motion_lists(parameters, twice=True)
        self.count = self.D * by_starts + len(parameters)
        values = [field._arrays[name] for name in parameters]
        sizes = [_power_of_2(np.broadcast_to(value, field.shape)) for value in values]
        tables = []
        for members, f, table in groups:
            own = variational(f, self.count)
            scales = [np.ravel(size)[members] for size in sizes]
            tables.append(OfMembers(members, own, np.column_stack([table, *scales])))
        self.field = WithColumns(field.shape, tables)
        of_starts = _power_of_2(abs(x).max(axis=1))
        self.scales = np.empty((B, self.count))
        self.starts = np.zeros((B, self.D * (1 + self.count)))
        self.starts[:, : self.D] = x
        columns = self.starts[:, self.D :].reshape(B, self.count, self.D)
        if by_starts:
            self.scales[:, : self.D] = of_starts[:, np.newaxis]
            columns[:, : self.D] = of_starts[:, np.newaxis, np.newaxis] * np.eye(self.D)
        for k, size in enumerate(sizes, self.D * by_starts):
            self.scales[:, k] = flat_arrays(size[..., np.newaxis], batch)[:, 0]
        self.settings = settings
        if isinstance(settings.atol, tuple):
            self.settings = settings._replace(atol=settings.atol * (1 + self.count))

    def parted(self, states: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return states (n, B, D), and derivatives (n, B, D, C), from states with columns."""
        n, B, _ = states.shape
        columns = states[..., self.D :].reshape(n, B, self.count, self.D)
        columns = columns.swapaxes(2, 3) / self.scales[:, np.newaxis]
        return np.ascontiguousarray(states[..., : self.D]), columns

    def of_records(self, records: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return derivatives of the times of events (K, C), and of states before and after.

        If a solution starts dx away, its event comes tau earlier, dt = -tau, and the state there
        moves by v - f tau for the column v. States have the shape (K, D, C).
        """
        D, C, K = self.D, self.count, len(records.time)
        scales = self.scales[records.trajectory]
        others = records.of_columns if K else np.empty((0, C + 2 * D))
        tau, *rates = np.split(others, (C, C + D), axis=1)
        states = []
        for x, f in zip((records.before, records.states), rates, strict=True):
            columns = x[:, D:].reshape(K, C, D) - tau[..., np.newaxis] * f[:, np.newaxis]
            states.append((columns / scales[..., np.newaxis]).swapaxes(1, 2))
        return (0.0 - tau) / scales, states[0], states[1]


def _power_of_2(values: FloatArray) -> FloatArray:
    """Return the powers of 2 nearest to values; 1 for 0 and NaN."""
    moduli = abs(np.asarray(values, np.float64))
    fractions, exponents = np.frexp(moduli)
    return np.where(moduli > 0.0, np.ldexp(1.0, exponents - (fractions < HALF)), 1.0)


def with_derivatives(
    field: Any,
    x: FloatArray,
    batch: tuple[int, ...],
    names: tuple[str, ...],
    request: SolverRequest,
    actions: tuple[EventAction, ...],
) -> tuple[SolverResult, FloatArray]:
    """Return the motion and its derivatives by `names` (n, ..., D, C), columns by x0 first."""
    parameters = tuple(name for name in names if name != "x0")
    groups = with_events(field, actions, parameters, True) if actions else None
    columns = Columns(field, x, batch, "x0" in names, parameters, request.settings, groups)
    request = request._replace(settings=columns.settings)
    found = to_tolerance(columns.field, columns.starts, batch, request)
    if actions:
        records = found.records.in_order()
        of_records = columns.of_records(records)
        found = found._replace(records=records._replace(derivatives=of_records))
    states, derivatives = columns.parted(found.states)
    shape = len(request.times), *batch, *derivatives.shape[2:]
    return found._replace(states=states), derivatives.reshape(shape)
