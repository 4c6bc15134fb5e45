"""Derivatives of motions with respect to initial states and parameters: columns after the state.

State and columns share an error estimate, so columns are multiplied by powers of 2 to have the size
of the state: a derivative with respect to x0 by the size of x0, and a derivative with respect to a
parameter by the size of its value.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..calls import flat_arrays
from ..checks import FloatArray
from ..core.expressions.variational import variational
from ..core.flow.batch_solver import SolverRequest
from ..core.flow.held import HALF
from ..core.hybrid.event_formulas import EventAction
from ..fields.right_hand_sides import OfMembers, with_events
from .extension import Extension, atol_of_columns, extended
from .integration import Records, SolverResult


def with_derivatives(
    field: Any,
    x: FloatArray,
    batch: tuple[int, ...],
    names: tuple[str, ...],
    request: SolverRequest,
    actions: tuple[EventAction, ...],
) -> SolverResult:
    """Return the motion from states x (B, D) with derivatives with respect to `names`."""
    (B, D), parameters = x.shape, tuple(name for name in names if name != "x0")
    by_starts = field._layout.size * ("x0" in names)  # not by a hidden time
    C = by_starts + len(parameters)
    values = [np.broadcast_to(field._arrays[name], field.shape) for name in parameters]
    sizes = [_power_of_2(value) for value in values]
    scales, columns = np.empty((B, C)), np.zeros((B, C, D))
    if by_starts:
        of_starts = _power_of_2(abs(x).max(axis=1))[:, np.newaxis]
        scales[:, :by_starts] = of_starts
        columns[:, :by_starts] = of_starts[..., np.newaxis] * np.eye(by_starts, D)
    for k, size in enumerate(sizes, by_starts):
        scales[:, k] = flat_arrays(size[..., np.newaxis], batch)[:, 0]
    groups = []
    for members, f, table in with_events(field, actions, parameters):
        of_members = [np.ravel(size)[members] for size in sizes]
        given = np.column_stack([table, *of_members])
        groups.append(OfMembers(members, variational(f, C), given))
    atol = atol_of_columns(request.settings, C)
    extension = Extension(groups, field.shape, extended(x, columns), D, atol)
    result, columns = extension.run(batch, request)
    if actions:
        records = result.records.in_order()
        result = result._replace(records=_of_records(records, scales[records.trajectory]))
    columns = columns.reshape(len(columns), B, C, D).swapaxes(2, 3)
    return result._replace(derivatives=columns / scales[:, np.newaxis])


def _power_of_2(values: FloatArray) -> FloatArray:
    """Return the powers of 2 nearest to values; 1 for 0 and NaN."""
    moduli = abs(np.asarray(values, np.float64))
    fractions, exponents = np.frexp(moduli)
    return np.where(moduli > 0.0, np.ldexp(1.0, exponents - (fractions < HALF)), 1.0)


def _of_records(records: Records, scales: FloatArray) -> Records:
    """Return records with the derivatives of times and states in place of `of_columns`.

    If x0 or a parameter changes along a column v, the event comes tau earlier, and the state at the
    event changes by v - f tau. `records.of_columns` has tau of all C columns, then f before the
    event, then f after it.
    """
    K, C = scales.shape
    D = records.states.shape[1] // (1 + C)
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
