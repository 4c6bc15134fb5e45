"""Advice on functions that are no right-hand side of a field, as those written for `solve_ivp`."""

import inspect
import re
from collections.abc import Mapping
from typing import Any

from ..checks import wrong

# Names that arguments have where a function of the state (of time, of an array of parameters) is
# expected elsewhere; a parameter of a field rarely has one of them.
TIME = {"t", "time"}
_ARRAY = {"p", "par", "pars", "params", "parameters", "args", "theta"}
_STATE = re.compile(r"[xyzuvwqps]\d*|[XYZUVW]|state|states|vec")
PAGE = "docs/howto/cubic.md"


def is_state(name: str) -> bool:
    """Return whether an argument is, by its name, a state, a part of one, or an array."""
    return name in _ARRAY or _STATE.fullmatch(name) is not None


def check_arguments(name: str, f: Any, D: int, given: Mapping[str, Any]) -> None:
    """Raise TypeError unless f takes the state alone, as one tuple, and parameters by name."""
    try:
        arguments = inspect.signature(f).parameters.values()
    except (TypeError, ValueError):  # some functions written in C have none
        return
    by_place = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    needed = [each.name for each in arguments if each.default is each.empty]
    places = [each.name for each in arguments if each.kind in by_place]
    places = [each for each in places if each in needed or each in TIME]
    named = [each.name for each in arguments if each.kind is inspect.Parameter.KEYWORD_ONLY]
    missing = [each for each in [*places[1:], *named] if each in needed and each not in given]
    times = TIME.intersection(places)
    states = [each for each in missing if is_state(each)]
    is_scalar = len(places) == D > 1 and missing and not is_state(places[0])
    if not (times or states or is_scalar):
        if missing:
            expected = f"a function of x and of parameters by name, for {D} variables"
            received = f"none, as {name} needs {missing[0]}: pass {missing[0]}=28, say"
            raise wrong(name, expected, received, TypeError)
        return
    received = f"{name}({', '.join(places)})"
    if len(places) > 1 and places[0] == f"d{places[1]}":
        how = f"return the {D} components, as a tuple"
    elif times:
        state, *others = [each for each in places if each not in TIME] or ["x"]
        inner = ["0" if each in TIME else "x" if each == state else each for each in places]
        outer = ", ".join(["x", *(each for each in others if not is_state(each))])
        time = ", ".join(times)
        how = f"pass lambda {outer}: {name}({', '.join(inner)}) if nothing depends on {time}"
        how += f"; for a forcing see {PAGE}"
    elif {*missing} <= _ARRAY and len(places) != D and places[0] != "q":
        how = "pass each parameter by its own name, as in f(x, sigma, rho)"
    elif len(places) == D:
        how = f"pass lambda x: {name}(*x)"
    elif D % len(places) == 0:
        m = D // len(places)
        parts = ", ".join(f"x[{m * k}:{m * (k + 1)}]" for k in range(len(places)))
        how = f"pass lambda x: {name}({parts})"
    else:
        how = "write a function of x"
    expected = f"a function of the state alone, as one tuple of {D}, and of parameters by name"
    raise wrong(name, expected, f"{received}: {how}", TypeError)


def explained(error: Exception, is_family: bool) -> str:
    """Return the text of an error that a function raised when called with symbolic variables."""
    text = str(error)
    if is_family and re.search("'(float|int)' object is not|non-iterable (float|int)", text):
        how = "an array is a family, of which f gets one number at a time: pass each number by its"
        return f"{text}: {how} own name, as sigma=10, rho=28"
    if "Polynomial" in text or text.startswith("the operation"):
        how = "x holds symbols: no math.sin, if or float, and no arrays of floats to fill"
        return f"{text}: {how}; sin and cos can become variables, see {PAGE}"
    if "'tuple'" in text or "tuple indices" in text:
        return f"{text}: x is a tuple; for arithmetic on all of it, np.array(x)"
    if text.startswith("degree"):
        return f"{text}: with more variables it may become quadratic, see {PAGE}"
    return text
