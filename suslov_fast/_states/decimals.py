"""Quantities of fields in decimals of many digits, for states where those of float64 cancel."""

from __future__ import annotations

from decimal import MAX_EMAX, MIN_EMIN, Context, Decimal, localcontext
from typing import Any

import numpy as np

from .._bodies.field import QuadraticField
from .._checks import FloatArray

_CONTEXT = Context(prec=250, Emin=MIN_EMIN, Emax=MAX_EMAX)


def _decimals(array: Any) -> Any:
    """Return the decimals of an array of floats or fractions."""
    ratios = [number.as_integer_ratio() for number in np.ravel(array)]
    return np.reshape([Decimal(a) / b for a, b in ratios], np.shape(array))


def modified_energy_and_density(
    body: QuadraticField, state: FloatArray, step_size: float
) -> tuple[float, float]:
    """Return H(x) + (eps/3) grad H(x).A(x)**-1 f(x) and 1 / det A(x) at one state."""
    with localcontext(_CONTEXT):
        x, eps = _decimals(state), _decimals(step_size)[()]
        (q, l, c), (of_q, of_l, of_c) = (
            [_decimals(each) for each in (field.quadratic, field.linear, field.constant)]
            for field in (body, body.gradient)
        )
        at_0 = _decimals(body.hamiltonian.terms.get((), 0.0))[()]
        energy = at_0 + ((of_q @ x / 3 + of_l / 2) @ x + of_c) @ x
        identity = np.eye(len(x), dtype=int)
        rows = np.column_stack([identity - eps / 2 * (2 * q @ x + l), eps * ((q @ x + l) @ x + c)])
        det = Decimal(1)
        for k in range(len(x)):
            pivot = k + int(np.argmax(abs(rows[k:, k])))
            if pivot != k:
                rows[[k, pivot]], det = rows[[pivot, k]], -det
            if not rows[k, k]:
                return np.nan, np.inf
            det *= rows[k, k]
            rows[k] /= rows[k, k]
            others = np.arange(len(x)) != k
            rows[others] -= np.outer(rows[others, k], rows[k])
        work = ((of_q @ x + of_l) @ x + of_c) @ rows[:, -1]
        return float(energy + work / 3), float(1 / det)
