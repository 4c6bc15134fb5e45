"""Quantities accumulated over time."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Mapping, Sequence
from types import CodeType
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


def checked(body: Any, given: Any) -> tuple[tuple[str, ...], Monitors]:
    """Return names of reductions in alphabetical order, and functions of the user by name."""
    if given is None:
        return (), {}
    known = reductions_of(map_of(body))
    expected = f"names among {', '.join(known)}"
    if isinstance(given, str) or not isinstance(given, Sequence | Mapping):
        kinds = f"a list of {expected}, or a mapping of names to functions"
        raise wrong("reductions", kinds, repr(given), TypeError)
    if isinstance(given, Mapping) and given:
        return (), {name: _checked_monitor(body, name, given[name]) for name in sorted(given)}
    if not given or any(name not in known for name in given):
        raise wrong("reductions", expected, repr(given))
    for name in given:
        state = np.zeros(body.dimension)
        try:
            known[name].reduce(body, np.asarray(1.0), state[np.newaxis], state)
        except (NotIntegrableError, TypeError) as error:
            raise type(error)(f"reductions: {name}: {error}") from error
    return tuple(sorted(set(given))), {}


def _checked_monitor(body: Any, name: Any, function: Any) -> Callable[[FloatArray], Any]:
    """Return a function of the user, after a call with states of other values and shapes."""
    map = map_of(body)
    if name in {*reductions_of(map), *schema_of(map), *HEADER, *TAKEN}:
        raise wrong("reductions", "functions with names of their own", repr(name))
    described(function)  # an error if it has no source
    states = 1.0 + np.arange(6.0 * body.dimension).reshape(3, 2, body.dimension)
    whole, parts = evaluated(name, function, states), evaluated(name, function, states[1:])
    if not np.allclose(whole[1:], parts, rtol=1e-6, equal_nan=True):
        received = f"{name} with values that depend on other states"
        raise wrong("reductions", "functions of one state", received)
    checked: Callable[[FloatArray], Any] = function
    return checked


def evaluated(name: str, function: Callable[[FloatArray], Any], states: FloatArray) -> FloatArray:
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


def described(function: Any) -> dict[str, str]:
    """Return the source of a function, and the values that it carries, as text."""
    try:
        plain = inspect.unwrap(function)
        text = "".join(inspect.findsource(plain)[0])
        nodes = [each for each in ast.walk(ast.parse(text)) if _is_source(each, plain.__code__)]
        bound = inspect.getclosurevars(plain).nonlocals
    except (TypeError, AttributeError, OSError, SyntaxError) as error:
        expected = "functions whose Python source can be read, as those in files and notebooks"
        raise wrong("reductions", expected, f"{function!r}: {error}", TypeError) from error
    if len(nodes) != 1 or inspect.ismethod(plain):
        expected = "functions of their own, and one lambda in a line"
        raise wrong("reductions", expected, f"{function!r}", TypeError)
    with np.printoptions(threshold=2**31, floatmode="unique"):
        carried = repr((plain.__defaults__, plain.__kwdefaults__, bound))
    return {"source": ast.unparse(nodes[0]), "values": carried}


def _is_source(node: ast.AST, code: CodeType) -> bool:
    """Return whether code was compiled from a node, as far as Python knows."""
    if not isinstance(node, ast.FunctionDef | ast.Lambda):
        return False
    first = min([node.lineno, *(each.lineno for each in getattr(node, "decorator_list", ()))])
    if first != code.co_firstlineno or isinstance(node, ast.Lambda) != (code.co_name == "<lambda>"):
        return False
    if not hasattr(code, "co_positions"):  # before Python 3.11
        return True
    begin, end = (node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset)
    known = [place for place in code.co_positions() if None not in place and place[3] != 0]
    return all(begin <= place[::2] and place[1::2] <= end for place in known)
