"""Formulas evaluated over arrays by NumPy."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from .._checks import FloatArray
from .._status import SingularStepWarning
from .layout import first_index, spell


def evaluate(formula: Callable[..., Any], batch: tuple[int, ...], *arguments: Any) -> FloatArray:
    """A formula without branches over a batch: (...), or (..., k) if it returns k numbers.

    What leaves the range of float64 is infinite or NaN, without a warning.
    """
    with np.errstate(all="ignore"):
        result = formula(*arguments)
    values: FloatArray
    if not isinstance(result, tuple):
        values = np.empty(batch)
        values[...] = result
        return values[()]
    values = np.empty((*batch, len(result)))
    for k, component in enumerate(result):
        values[..., k] = component
    return values


def without_poles(values: FloatArray) -> FloatArray:
    """Values (..., k) with NaN for rows that are not finite, and one warning that counts them."""
    failed = np.asarray(~np.isfinite(values).all(axis=-1))
    if failed.any():
        values[failed] = np.nan
        message = (
            f"{np.count_nonzero(failed)} of {failed.size} states: singular or non-finite step, "
            f"first: {spell(first_index(failed))}"
        )
        warnings.warn(message, SingularStepWarning, stacklevel=3)
    return values
