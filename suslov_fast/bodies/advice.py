"""Advice on functions that are no right-hand side of a field, as those written for `solve_ivp`."""

import inspect
import re
from collections.abc import Mapping, Sequence
from keyword import iskeyword
from typing import Any

from ..checks import page
from .names import TIME, clash, free, labels

# Names that arguments have where a function of the state, or of an array of parameters, is expected
# elsewhere; a parameter of a field rarely has one of them.
_ARRAY = {"p", "par", "pars", "params", "parameters", "args", "theta"}
_STATE = re.compile(r"[xyzuvwqps]\d*|[XYZUVW]|state|states|vec")
_SURELY_STATE = re.compile(r"[xyzXYZ]\d*|state|states")
_VECTOR = {"X", "Y", "Z", "U", "V", "W", "state", "states", "vec"}
# How the components of a state are called, one after the other: x1, x2 too, and q1, q2, p1, p2, and
# coordinates with momenta or velocities, x, y, px, py.
_NUMBERED = re.compile(r"[A-Za-z]+_?\d+")
_WITH_RATES = re.compile(r"([pvd]_?)?[xyz](_?dot)?")
_RUNS = "xyzw", "xyzuvw", "xyuv", "xv", "uvw", "qp", "pq", "XYZW", "UVW"
CUBIC = "howto/cubic"
# What Python and NumPy say of a number that a function takes for an array.
_OF_ARRAYS = re.compile(
    "'(float|int)' object is not|non-iterable (float|int)|'(float|int)' has no len|"
    "not have enough dimensions"
)


def is_state(name: str) -> bool:
    """Return whether an argument is, by its name, a state or a part of one."""
    return _STATE.fullmatch(name) is not None


def _is_run(names: Sequence[str]) -> bool:
    """Return whether arguments are, by their names, the components of a state."""
    patterns = (_NUMBERED, _WITH_RATES)
    is_pattern = any(all(map(each.fullmatch, names)) for each in patterns)
    return is_pattern or any(run.startswith("".join(names)) for run in _RUNS)


def _arguments(f: Any) -> list[inspect.Parameter]:
    """Return the arguments of a function, but *args and **others; none of some written in C."""
    try:
        arguments = inspect.signature(f).parameters.values()
    except (TypeError, ValueError):
        return []
    stars = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    return [each for each in arguments if each.kind not in stars]


def arguments_of(f: Any) -> list[str]:
    """Return the names of the arguments that a function needs, and of a time."""
    return [a.name for a in _arguments(f) if a.default is a.empty or a.name in TIME]


def name_of(f: Any, argument: str) -> str:
    """Return the name of a function; that of the argument for one without a name."""
    name = getattr(f, "__name__", "")
    return name if name.isidentifier() and not iskeyword(name) else argument


def check_arguments(
    argument: str, f: Any, names: Sequence[str], given: Mapping[str, Any], maker: str = ""
) -> None:
    """Raise TypeError unless f takes the state alone, as one tuple, and parameters by name.

    Messages begin with `argument`, and advise a call of `maker`, which takes f.
    """
    places, called, D = arguments_of(f), name_of(f, argument), len(names)
    missing = [each for each in places[1:] if each not in given]
    is_timed = not TIME.isdisjoint(places)
    begin = _first_scalar(places, names, given)
    parts = [each for each in places if each not in TIME]
    in_parts = begin is None and 1 < len(parts) < D and D % len(parts) == 0 and _is_run(parts)
    for_arrays = missing and ({*missing} <= _ARRAY or places[0] == f"d{missing[0]}")
    of_state = any(map(_SURELY_STATE.fullmatch, missing))
    if is_timed or (missing and (begin is not None or in_parts or for_arrays or of_state)):
        if len(places) > 1 and places[0] == f"d{places[1]}":
            advice = f"return the {D} components, as a tuple"
        elif begin is None and not (is_timed and parts) and not in_parts:
            advice = f"write a function of one tuple of {D}"
            if missing and {*missing} <= _ARRAY:
                advice = f"pass each parameter by its own name, as in {called}(x, sigma, rho)"
        else:
            states = (
                parts if in_parts else parts[:1] if begin is None else places[begin : begin + D]
            )
            advice = _adapted(called, f, names, given, states, maker)
        if is_timed:
            advice += f"; for a forcing see {page(CUBIC)}"
        must = "must take the state alone, as one tuple, and parameters by name"
        received = f"{called}({', '.join(places)})"
        raise TypeError(f"{argument} {must}, not {received}: {advice}")
    unknown = _unknown(f, given)
    if missing:
        how = f"pass {missing[0]}=28, for example"
        if what := clash(missing[0], names, maker):
            other = free(missing[0], names, maker)
            how = f"this name is in use, for {what}: rename it, to {other} for example"
        others = f", not {', '.join(unknown)}" if unknown else ""
        raise TypeError(f"{argument}: {called} needs {missing[0]}{others}: {how}")
    if unknown:
        known = ", ".join(a.name for a in _arguments(f)[1:]) or "none"
        text = f"{called} has no parameter {', '.join(unknown)}; choose from: {known}"
        raise TypeError(f"{argument}: {text}")


def _unknown(f: Any, given: Mapping[str, Any]) -> list[str]:
    """Return the parameters that were given and that a function does not take."""
    try:
        arguments = inspect.signature(f).parameters.values()
    except (TypeError, ValueError):
        return []
    if any(each.kind == each.VAR_KEYWORD for each in arguments):
        return []
    return [name for name in given if name not in {each.name for each in arguments}]


def _first_scalar(places: list[str], names: Sequence[str], given: Any) -> int | None:
    """Return where D arguments begin that are the components of the state, None if none are."""
    D, first = len(names), int(bool(places) and places[0] in TIME)
    own = places[first : first + D]
    if len(own) != D or D == 1 or not {*own}.isdisjoint([*TIME, *given]):
        return None
    if own == [*names]:
        return first
    if not _ARRAY.isdisjoint(own[1:]) and own[0] != "q":  # f(u, p, t)
        return None
    after = places[first + D :]
    if own[0] in _VECTOR and not is_state(own[1]):  # f(X, a, b, t)
        return None
    if _is_run(own) or (not first and after and after[0] in TIME):
        return first
    return first if (first or not after) and not is_state(own[0]) else None


def _adapted(
    called: str, f: Any, names: Sequence[str], given: Any, states: Sequence[str], maker: str
) -> str:
    """Return a call of `maker` with a function of the state made of f.

    The arguments `states` are the state, its D components, or parts of it.
    """
    D, m = len(names), len(names) // len(states)
    state = next(each for each in ("x", "u", "state") if each not in {*given, called})
    texts = {each: f"{state}[{m * k}:{m * (k + 1)}]" for k, each in enumerate(states)}
    if len(states) == 1:
        texts = {states[0]: state}
    elif [*states] == ["p", "q"] and maker.endswith("from_hamiltonian"):  # q is first
        at = (f"{m}:{2 * m}", f":{m}") if m > 1 else (1, 0)
        texts = {"p": f"{state}[{at[0]}]", "q": f"{state}[{at[1]}]"}
    elif m == 1:
        texts = {states[0]: f"*{state}", **dict.fromkeys(states[1:], "")}
    texts |= dict.fromkeys(TIME, "None")
    inner, own, by_name = [], {}, False
    for each in _arguments(f):
        name = each.name
        text = texts.get(name)
        if text is None:
            if each.default is not each.empty and name not in given:
                by_name = True  # those after it
                continue
            text = name
            if name in given or len(states) > 1 or name not in _ARRAY:
                text = own[name] = free(name, [*names, called, state], maker)
        by_name = by_name or each.kind == each.KEYWORD_ONLY
        if text:
            inner.append(f"{name}={text}" if by_name else text)
    function = f"lambda {', '.join([state, *own.values()])}: {called}({', '.join(inner)})"
    size = D if tuple(names) == labels(D) else repr(" ".join(names))
    values = (f", {new}={name if name in given else '…'}" for name, new in own.items())
    whole = f"{maker}({function}, {size}{''.join(values)})" if maker else function
    return f"pass {whole}" if own else f"pass {function}, as in {whole}"


def explained(error: Exception, called: str, names: Sequence[str], is_family: bool) -> str:
    """Return what is wrong where a function raised an error with polynomials for its variables."""
    text = " ".join(str(error).split())
    if hasattr(error, "in_words"):  # of a polynomial
        return f"{called} {error.in_words(names)}, see {page(CUBIC)}"
    if _is_of_numba(error):
        how = "call the Python function that it was made of, g.py_func(*x) in place of g(*x)"
        return f"{called} calls a function compiled by Numba, which takes no symbols: {how}"
    if "NoneType" in text:
        how = f"make time a variable, whose derivative is 1, see {page(CUBIC)}"
        return f"{text}: if None stands for t, the right-hand side depends on t: {how}"
    if is_family and _OF_ARRAYS.search(text):
        how = "an array is a family, of which f gets one number at a time: pass each number by its"
        return f"{text}: {how} own name, as sigma=10, rho=28"
    if re.search(r"ufunc '(solve|inv|lstsq|det|qr|eig|svd)", text):
        how = "compute the inverse of a constant matrix before, and multiply by it"
        return (
            f"numpy.linalg cannot compute with symbols ({text}): {how}, as in Inverse @ np.array(x)"
        )
    if "Polynomial" in text:
        how = "x holds symbols: no math.sin, if or float of them, and no arrays of floats to fill"
        return f"{text}: {how}; sin and cos can become variables, see {page(CUBIC)}"
    if re.search("'Variables'|tuple indices|can't multiply sequence", text):
        text = text.replace("'Variables'", "'tuple'")
        return f"{text}: x is a tuple; for arithmetic on all of it, np.array(x)"
    if "to unpack" in text:
        return f"{text}: if {called} unpacks x, the dimension is {len(names)}"
    return text


def _is_of_numba(error: Exception) -> bool:
    return type(error).__module__.startswith("numba") or "compute fingerprint" in str(error)
