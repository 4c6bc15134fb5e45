"""Values of users' functions of states: surfaces of crossings, functions of stores."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..checks import FloatArray, wrong

_LAST = "components on the last axis, as x[..., 0]"


def returned_at(name: str, function: Any, states: FloatArray) -> Any:
    """Return what a function returns for states (..., D), which it cannot change."""
    states = states.view()
    states.flags.writeable = False
    try:
        # No warnings, because states after the end of a trajectory are NaN or may overflow here.
        with np.errstate(over="ignore", invalid="ignore"):
            return function(states)
    except (TypeError, AttributeError, IndexError, ValueError) as error:
        if type(error).__module__ != "builtins":
            raise
        raise type(error)(f"{name} must take {_LAST}: {error}") from error


def values_at(
    name: str, states: FloatArray, returned: Any, *, truths: bool = False, all_exist: bool = False
) -> FloatArray:
    """Return what a function of states (..., D) returned as real numbers (...), after checks.

    They are NaN at states that are NaN, because a function with integer values returns numbers
    there; with `all_exist` the caller knows that there are none. Errors call the function `name`;
    truth values are numbers only with `truths`.
    """
    if isinstance(returned, np.ma.MaskedArray):
        how = "return NaN where there is no value, for example by values.filled(np.nan)"
        raise wrong(name, "have real numbers as values", f"a masked array: {how}", TypeError)
    values = np.asarray(returned)
    if values.dtype.kind == "b" and not truths:
        how = "pass the difference, not the comparison"
        raise wrong(name, "have real numbers as values", f"bool: {how}", TypeError)
    if values.dtype.kind not in "biuf":
        received = "None: return a value" if returned is None else values.dtype
        raise wrong(name, "have real numbers as values", received, TypeError)
    if values.shape != states.shape[:-1]:
        received = f"values {values.shape} for states {states.shape}"
        expected = f"have a value for each state, (...) for states (..., D), with {_LAST}"
        raise wrong(name, expected, received)
    # Writeable, because Numba would compile for read-only arrays anew.
    values = np.require(values, np.float64, ["C", "A", "W"])
    return values if all_exist else np.where(np.isnan(states[..., 0]), np.nan, values)
