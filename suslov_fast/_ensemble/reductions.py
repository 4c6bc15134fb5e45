"""Quantities accumulated over time."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .._bodies.body_nd import NotIntegrableError
from .._checks import FloatArray, wrong
from .._engine.problem import Map
from .._maps import map_of
from .._runs.labelled import TAKEN
from .._runs.schema import HEADER, schema_of
from .._states.conserved import energy, first_integral, modified_energy

# Functions of states (..., D), whose values (...) at the saved states are stored, by name.
Monitors = dict[str, Callable[[FloatArray], Any]]


class Reduction(NamedTuple):
    """The extreme over time of a number, or of one for each component, of each trajectory."""

    meaning: str
    # Of the body, eps, states (rows, ..., D) and the states at step 0 (..., D).
    values: Callable[[Any, FloatArray, FloatArray, FloatArray], FloatArray]
    extreme: np.ufunc
    of_components: bool = False

    def reduce(self, *arguments: Any) -> Any:
        return self.extreme.reduce(self.values(*arguments), axis=0)


def _drift(meaning: str, observable: Callable[[Any, FloatArray, FloatArray], Any]) -> Reduction:
    def change(body: Any, eps: FloatArray, states: FloatArray, first: FloatArray) -> Any:
        with np.errstate(all="ignore"):
            return abs(observable(body, states, eps) / observable(body, first, eps) - 1.0)

    return Reduction(f"largest relative change of {meaning} since the start", change, np.fmax)


REDUCTIONS = {
    "first_integral_drift": _drift("F", first_integral),
    "modified_energy_drift": _drift("the modified energy", modified_energy),
    "energy_drift": _drift("the energy", lambda body, omega, eps: energy(body, omega)),
}


def reductions_of(map: Map) -> dict[str, Reduction]:
    """Return the reductions for runs of a map, by name."""
    extremes = {
        f"{map.variable}_{short}": Reduction(
            f"{meaning} value of each component",
            lambda body, eps, states, first: states,
            extreme,
            of_components=True,
        )
        for short, meaning, extreme in (("min", "least", np.fmin), ("max", "largest", np.fmax))
    }
    return {**REDUCTIONS, **extremes}


def checked_reductions(body: Any, given: Any) -> tuple[tuple[str, ...], Monitors]:
    """Return names of reductions in alphabetical order, and functions of the user by name."""
    if given is None:
        return (), {}
    known = reductions_of(map_of(body))
    expected = f"names among {', '.join(known)}"
    if isinstance(given, str) or not isinstance(given, Sequence | Mapping):
        kinds = f"a list of {expected}, or a mapping of names to functions"
        raise wrong("reductions", kinds, repr(given), TypeError)
    if isinstance(given, Mapping) and given:
        for name, function in given.items():
            _check_function(body, name, function)
        return (), {name: given[name] for name in sorted(given)}
    if not given or any(name not in known for name in given):
        raise wrong("reductions", expected, repr(given))
    for name in given:
        state = np.zeros(body.dimension)
        try:
            known[name].reduce(body, np.asarray(1.0), state[np.newaxis], state)
        except (NotIntegrableError, TypeError) as error:
            raise type(error)(f"reductions: {name}: {error}") from error
    return tuple(sorted(set(given))), {}


def _check_function(body: Any, name: Any, function: Any) -> None:
    """Check a function of the user, by calls with states of other values and shapes."""
    map = map_of(body)
    if name in {*reductions_of(map), *schema_of(map), *HEADER, *TAKEN}:
        raise wrong("reductions", "functions with names of their own", repr(name))
    identity_of_function(name, function, body.dimension)  # an error if it has no source
    states = _samples(body.dimension)
    whole, parts = monitored(name, function, states), monitored(name, function, states[1:])
    if not np.allclose(whole[1:], parts, rtol=1e-6, equal_nan=True):
        received = f"{name} with values that depend on other states"
        raise wrong("reductions", "functions of one state", received)


def _samples(dimension: int) -> FloatArray:
    return 1.0 + np.arange(6.0 * dimension).reshape(3, 2, dimension)


def monitored(name: str, function: Callable[[FloatArray], Any], states: FloatArray) -> FloatArray:
    """Return the values (...) of a function of the user at states (..., D)."""
    try:
        with np.errstate(all="ignore"):
            values = np.asarray(function(states.copy()))
    except Exception as error:
        received = f"{name}, which raises {type(error).__name__}: {error}"
        raise wrong("reductions", "functions of states (..., D)", received, TypeError) from error
    if values.dtype.kind not in "biuf":
        received = f"{name} with values of dtype {values.dtype}"
        raise wrong("reductions", "functions with real values", received, TypeError)
    if values.shape != states.shape[:-1]:
        expected = f"functions of states (..., D) with values (...), here {states.shape[:-1]}"
        raise wrong("reductions", expected, f"{name} with values of shape {values.shape}")
    return values.astype(np.float64)


def identity_of_function(name: str, function: Any, dimension: int) -> dict[str, str]:
    """Return the source of a function, the values that it carries, and some of its results."""
    try:
        plain = inspect.unwrap(function)
        if not inspect.isfunction(plain):
            raise TypeError("no function written in Python")
        source = textwrap.dedent(inspect.getsource(plain))
        bound = inspect.getclosurevars(plain).nonlocals
    except (TypeError, OSError) as error:
        expected = "functions whose Python source can be read, as those in files and notebooks"
        raise wrong("reductions", expected, f"{function!r}: {error}", TypeError) from error
    with np.printoptions(threshold=2**31, floatmode="unique"):
        carried = repr((plain.__defaults__, plain.__kwdefaults__, bound))
    # The source of a lambda is its whole line, which may hold another one.
    results = monitored(name, function, _samples(dimension)).ravel() + 0.0
    return {"source": source, "values": carried, "results": " ".join(f"{v:.6g}" for v in results)}
