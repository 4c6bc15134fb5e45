"""Advice on functions that are no right-hand side of a field, as those written for `solve_ivp`."""

import inspect
import re
from collections.abc import Mapping
from typing import Any

from ..checks import page, wrong
from .names import TIME, clash

# Names that arguments have where a function of the state (of time, of an array of parameters) is
# expected elsewhere; a parameter of a field rarely has one of them.
_ARRAY = {"p", "par", "pars", "params", "parameters", "args", "theta"}
_STATE = re.compile(r"[xyzuvwqps]\d*|[XYZUVW]|state|states|vec")
CUBIC = "howto/cubic"


def is_state(name: str) -> bool:
    """Return whether an argument is, by its name, a state, a part of one, or an array."""
    return name in _ARRAY or _STATE.fullmatch(name) is not None


def arguments_of(f: Any) -> list[str]:
    """Return the names of the arguments that a function needs, and of a time."""
    try:
        arguments = inspect.signature(f).parameters.values()
    except (TypeError, ValueError):  # some functions written in C have none
        return []
    stars = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    named = [each for each in arguments if each.kind not in stars]
    return [each.name for each in named if each.default is each.empty or each.name in TIME]


def check_arguments(name: str, f: Any, D: int, given: Mapping[str, Any]) -> None:
    """Raise TypeError unless f takes the state alone, as one tuple, and parameters by name."""
    places = arguments_of(f)
    missing = [each for each in places[1:] if each not in given]
    is_timed = not TIME.isdisjoint(places)
    is_scalar = len(places) == D > 1 and missing and not is_state(places[0])
    if is_timed or is_scalar or any(map(is_state, missing)):
        expected = f"a function of the state alone, as one tuple of {D}, and of parameters by name"
        received = f"{name}({', '.join(places)}): {_adapted(name, D, places, missing)}"
        raise wrong(name, expected, received, TypeError)
    if missing:
        how = f"pass {missing[0]}=28, say"
        if clash(missing[0]):
            how = "a name that is in use: choose another"
        expected = f"a function of x and of parameters by name, for {D} variables"
        raise wrong(name, expected, f"none, as {name} needs {missing[0]}: {how}", TypeError)


def _adapted(name: str, D: int, places: list[str], missing: list[str]) -> str:
    """Return how to make a function of the state from one written for another package."""
    if len(places) > 1 and places[0] == f"d{places[1]}":
        return f"return the {D} components, as a tuple"
    if times := TIME.intersection(places):
        state, *others = [each for each in places if each not in TIME] or ["x"]
        inner = ["0" if each in TIME else "x" if each == state else each for each in places]
        outer = ", ".join(["x", *(each for each in others if not is_state(each))])
        call = f"pass lambda {outer}: {name}({', '.join(inner)})"
        return f"{call} if nothing depends on {', '.join(times)}; for a forcing see {page(CUBIC)}"
    if {*missing} <= _ARRAY and len(places) != D and places[0] != "q":
        return "pass each parameter by its own name, as in f(x, sigma, rho)"
    if len(places) == D:
        return f"pass lambda x: {name}(*x)"
    if D % len(places) == 0:
        m = D // len(places)
        parts = ", ".join(f"x[{m * k}:{m * (k + 1)}]" for k in range(len(places)))
        return f"pass lambda x: {name}({parts})"
    return "write a function of x"


def explained(error: Exception, is_family: bool) -> str:
    """Return the text of an error that a function raised when called with symbolic variables."""
    text = str(error)
    if is_family and re.search("'(float|int)' object is not|non-iterable (float|int)", text):
        how = "an array is a family, of which f gets one number at a time: pass each number by its"
        return f"{text}: {how} own name, as sigma=10, rho=28"
    if "Polynomial" in text or text.startswith("the operation"):
        how = "x holds symbols: no math.sin, if or float, and no arrays of floats to fill"
        return f"{text}: {how}; sin and cos can become variables, see {page(CUBIC)}"
    if "'tuple'" in text or "tuple indices" in text:
        return f"{text}: x is a tuple; for arithmetic on all of it, np.array(x)"
    if text.startswith("degree"):
        return f"{text}: with more variables it may become quadratic, see {page(CUBIC)}"
    return text
