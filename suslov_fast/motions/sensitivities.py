"""Derivatives of motions with respect to initial states and parameters: columns after the state.

State and columns share an error estimate, so columns are multiplied by powers of 2 to have the size
of the state: a derivative with respect to x0 by the size of x0, and a derivative with respect to a
parameter by the size of its value.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..checks import FloatArray
from ..core.expressions.event_formulas import EventAction
from ..core.expressions.variational import variational
from ..core.flow.batch_solver import Settings, SolverRequest
from ..core.flow.held import HALF
from ..fields.right_hand_sides import OfMembers, with_events
from ..maps.kernel_arguments import flat_arrays
from .integration import Records, SolverResult, to_tolerance


class Columns:
    """The derivatives of trajectories x (B, D) of a field, as C columns of D further variables.

    groups, settings  right-hand sides of the members with columns, and settings for these
    starts            (B, D + D C): the states, then columns: derivatives with respect to x0, if it
                      is among `names`, then with respect to parameters
    """

    def __init__(
        self,
        field: Any,
        x: FloatArray,
        batch: tuple[int, ...],
        names: tuple[str, ...],
        settings: Settings,
        actions: tuple[EventAction, ...],
    ) -> None:
        B, self.D = x.shape
        by_starts, parameters = "x0" in names, tuple(name for name in names if name != "x0")
        self.count = self.D * by_starts + len(parameters)
        values = [field._arrays[name] for name in parameters]
        sizes = [_power_of_2(np.broadcast_to(value, field.shape)) for value in values]
        self.groups = []
        for members, f, table in with_events(field, actions, parameters):
            own = variational(f, self.count)
            scales = [np.ravel(size)[members] for size in sizes]
            self.groups.append(OfMembers(members, own, np.column_stack([table, *scales])))
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
        """Return states (n, B, D) and derivatives (n, B, D, C) from states with columns."""
        n, B, _ = states.shape
        columns = states[..., self.D :].reshape(n, B, self.count, self.D)
        columns = columns.swapaxes(2, 3) / self.scales[:, np.newaxis]
        return np.ascontiguousarray(states[..., : self.D]), columns

    def of_records(self, records: Records) -> Records:
        """Return records with derivatives, and with states without columns.

        If the start changes along a column v, the event comes tau earlier, and the state at the
        event changes by v - f tau. `of_columns` are tau of C columns, and f before and after.
        """
        D, C, K = self.D, self.count, len(records.time)
        scales = self.scales[records.trajectory]
        tau, *rates = np.split(records.of_columns.reshape(K, C + 2 * D), (C, C + D), axis=1)
        states = []
        for x, f in zip((records.before, records.states), rates, strict=True):
            columns = x[:, D:].reshape(K, C, D) - tau[..., np.newaxis] * f[:, np.newaxis]
            states.append((columns / scales[..., np.newaxis]).swapaxes(1, 2))
        return records._replace(
            before=records.before[:, :D],
            states=records.states[:, :D],
            of_columns=None,
            time_by=(0.0 - tau) / scales,
            before_by=states[0],
            states_by=states[1],
        )


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
    """Return the motion, and its derivatives with respect to `names` (n, ..., D, C), x0 first."""
    columns = Columns(field, x, batch, names, request.settings, actions)
    request = request._replace(settings=columns.settings)
    result = to_tolerance(columns.groups, field.shape, columns.starts, batch, request)
    if actions:
        result = result._replace(records=columns.of_records(result.records.in_order()))
    states, derivatives = columns.parted(result.states)
    shape = len(request.times), *batch, *derivatives.shape[2:]
    return result._replace(states=states), derivatives.reshape(shape)
