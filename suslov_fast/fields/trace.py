"""Calls of users' functions with symbolic numbers, and the errors of functions that fail."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from difflib import get_close_matches
from typing import Any

import numpy as np

from ..checks import OF_SYMBOLS, arguments_of, either, short, signature_of, wrong
from ..core.expressions.function_records import FUNCTIONS, OTHER_NAMES
from ..words import STEPS, answer
from . import symbols
from .branching import along_all_paths
from .names import OF_TIME, TIME
from .script_functions import as_in_scripts
from .symbols import TABLES, Symbol, Symbols, Untraceable
from .tracer import Tracer, components

_FAILURES = TypeError, ValueError, AttributeError, IndexError, ArithmeticError, AssertionError
_OF_TEXT = "Field.from_equations(\"x' = v; v' = -k*x\", k=1.0) reads equations as text"
_NONE = inspect.Parameter.empty
_OF_SYMPY = "write sympy.lambdify([names], expressions), a function of all names in one list"


class Timed:
    """A function f(t, y) or f(y, t) of SciPy's form, as a function of the state y alone."""

    def __init__(self, f: Any, signature: inspect.Signature, place: int, time: Any = None) -> None:
        self.function, self.place, self.time = getattr(f, "py_func", f), place, time
        self.given = signature
        others = [a for k, a in enumerate(signature.parameters.values()) if k != place]
        self.__signature__ = signature.replace(parameters=others)

    def __call__(self, y: Any, **parameters: Any) -> Any:
        pair = (y, self.time) if self.place else (self.time, y)
        return self.function(*pair, **{k: parameters[k] for k in taken(self, parameters)})

    def at(self, time: Symbol) -> Timed:
        """Return the function of the state at this time."""
        return Timed(self.function, self.given, self.place, time)


def timed(f: Any, parameters: Iterable[str] = ()) -> Any:
    """Return f as a `Timed` function if its first or second argument is the time, t or time."""
    signature = signature_of(f)
    if signature is None or len(signature.parameters) < 2:
        return f
    pair = [*signature.parameters.values()][:2]
    places = [k for k, each in enumerate(pair) if each.name in TIME]
    ordinary = pair[0].POSITIONAL_ONLY, pair[0].POSITIONAL_OR_KEYWORD
    if len(places) != 1 or any(a.kind not in ordinary or a.name in parameters for a in pair):
        return f
    return f if pair[places[0]].default is not _NONE else Timed(f, signature, places[0])


def check_callable(argument: str, f: Any) -> None:
    """Raise TypeError unless f is a function."""
    if not callable(f):
        items = f if isinstance(f, list | tuple | dict) else [f]
        how = _OF_TEXT if any(isinstance(each, str) for each in items) else _OF_SYMPY
        raise wrong(argument, "a function of x", f"{short(f)}: {how}", TypeError)


def check_function(argument: str, f: Any, names: Any, parameters: Mapping[str, Any]) -> None:
    """Raise TypeError unless a user's function takes the state and these parameters."""
    check_callable(argument, f)
    for name, value in parameters.items():
        if isinstance(value, Mapping):
            how = f"Field(f, names, **{name}), with f(x, {', '.join(map(str, value))})"
            raise wrong(name, "a number", f"a dictionary: pass {how}", TypeError)
    signature = signature_of(f)
    if signature is None:
        return
    others = [*signature.parameters.values()][1:]
    known = [each.name for each in others]
    missing = [name for name in arguments_of(f)[1:] if name not in parameters]
    unknown = [name for name in parameters if name not in known]
    if TIME & {*signature.parameters}:
        how = "pass lambda x: ..." if argument == "H" else OF_TIME
    elif _fits(signature, parameters):
        return
    elif any(each.kind is each.VAR_POSITIONAL for each in others):
        how = "parameters have names, as lambda x, a, b: ..., with a=1.0, b=2.0"
    elif unknown:
        near = get_close_matches(unknown[0], known, 1, 0.6)
        how = f"it has no parameter {unknown[0]!r}"
        if near or known:
            how += f", but {either(near or known)}"
        elif len(unknown[0]) > 1 and (meant := answer(unknown[0])):  # a word, not a letter
            how += f": use {meant}"
    elif missing:
        how = f"pass values of its parameters, as {', '.join(f'{name}=1.0' for name in missing)}"
        if argument == "f":
            how += f"; if {missing[0]} is the time, name it t"
        if len(missing) == len(names) - 1:
            how += f", or lambda x: {argument}(*x) if these are the variables"
    else:
        how = "pass lambda x: ..."
    expected = "a function of the state, one array, and of its parameters by name"
    raise wrong(argument, expected, f"one of {signature}: {how}", TypeError)


def _fits(signature: inspect.Signature, parameters: Mapping[str, Any]) -> bool:
    """Return True if a function takes the state by position, and these parameters by name."""
    try:
        bound = signature.bind(None, **parameters)
    except TypeError:
        return False
    return len(bound.args) > 0


def taken(f: Any, names: Iterable[str]) -> list[str]:
    """Return the parameters that a function of the state takes; none if it has no signature."""
    signature = signature_of(f)
    others = [*signature.parameters.values()][1:] if signature else []
    takes_all = any(each.kind is each.VAR_KEYWORD for each in others)
    known = {each.name for each in others}
    return [name for name in names if takes_all or name in known]


def taking(f: Any, names: Sequence[str]) -> Any:
    """Return f as a function of the state and all parameters; it uses only `names`."""
    if isinstance(f, Timed):
        return f
    plain = getattr(f, "py_func", f)  # if Numba compiled f
    return lambda x, **parameters: plain(x, **{name: parameters[name] for name in names})


def called(
    argument: str, f: Any, state: Symbols, parameters: Mapping[str, Any], as_script: bool = False
) -> Any:
    """Return the value of f at symbols; raise TypeError or ValueError if f does not accept them."""
    try:
        plain = getattr(f, "py_func", f)  # if Numba compiled f
        within = as_in_scripts(plain) if as_script else nullcontext()
        return symbols.called_with_symbols(plain, state.copy(), within, **parameters)
    except _FAILURES as error:
        text = " ".join((str(error) or repr(error)).split()).replace(
            "'Symbols' object", "the state of symbols"
        )
        text = text.replace("'Symbol' object", "a symbol")
        if "Cannot cast" in text:  # a part of a message of NumPy
            text = "a function that is no formula needs numbers"
        if not isinstance(error, (Untraceable, ArithmeticError)) and OF_SYMBOLS not in text:
            of_state = ", ".join(str(state[i]) for i in range(min(len(state), 8)))
            how = f"write formulas by + - * / ** and functions of NumPy, and {TABLES}"
            if "enough dimensions" in text or "not subscriptable" in text:
                text = "a number is used as an array"
                how = "a parameter k is one number in f: pass k1, k2, or leave a matrix out of the "
                how += "parameters"
            elif "valid indices" in text:
                how = f"write {STEPS} for values[k] from knots[k] on"
            elif "the state of symbols has no" in text:
                how = f"write x[0] for a component, and {TABLES}"
            text += f": it is called with {len(state)} symbols, {of_state}: {how}"
        kind = TypeError if isinstance(error, (TypeError, AttributeError)) else ValueError
        raise kind(f"{argument}: {text}") from error


def _components(result: Any, D: int) -> Any:
    """Return the result of f, if it has D components."""
    if hasattr(result, "free_symbols"):
        raise TypeError(f"must return formulas of x, not expressions of SymPy: {_OF_SYMPY}")
    is_sequence = isinstance(result, (tuple, list, np.ndarray))
    if D == 1 and not is_sequence:
        return [result]
    shape = np.shape(result) if isinstance(result, np.ndarray) else ()
    if not is_sequence or len(result) != D or shape == (D, 1):
        received = f"an array of shape {shape}: pass lambda x: f(x).ravel()" if shape else result
        raise ValueError(f"must return {D} components, not {received}")
    if len(shape) > 1:
        how = "for a matrix B of one column write B[:, 0]"
        raise ValueError(f"must return {D} components, not an array of shape {shape}: {how}")
    return result


def _parts(argument: str, result: Any, D: int) -> Any:
    """Return the parts of the result of a function: D components, [H], or the entries of M."""
    if argument in ("H", "surface"):
        return [result]
    if argument == "constraints":
        return np.ravel(np.array(result, object)).tolist()
    if argument != "mass":
        return _components(result, D)
    array = np.array([[result]] if D == 1 and np.ndim(result) == 0 else result, object)
    if array.shape != (D, D):
        received = f"{short(result)} of shape {array.shape}"
        raise ValueError(f"must return a matrix of the shape ({D}, {D}), not {received}")
    return array.ravel().tolist()


def operands_of_function(argument: str, f: Any, tracer: Tracer) -> list[Any]:
    """Return the operands of f, of [H], or of M by rows, in the list of the tracer."""
    before = symbols.MADE.count
    try:
        return _by_two_calls(argument, f, tracer, False)
    except (TypeError, ValueError):
        pass
    rows = _by_two_calls(argument, f, tracer, True)
    symbols.MADE.count = before  # so that a function that makes this field is no suspect
    return rows


def _by_two_calls(argument: str, f: Any, tracer: Tracer, as_script: bool) -> list[Any]:
    """Return the operands of f after two calls, along all paths if f is called as a script."""
    calls = []
    for _ in range(2):

        def once() -> list[Any]:
            return _by_one_call(argument, f, tracer, as_script)

        try:
            calls.append(along_all_paths(tracer, once) if as_script else once())
        except Untraceable as error:
            raise TypeError(f"{argument}: {error}") from error
    first, second = ([*map(repr, each)] for each in calls)  # numbers: equal operations share one
    if first != second:
        how = "f must compute from x and its parameters alone, without random numbers or memory"
        raise ValueError(f"{argument}: two calls of f differ: {how}")
    return calls[0]


def _by_one_call(argument: str, f: Any, tracer: Tracer, as_script: bool) -> list[Any]:
    f = f.at(tracer.time) if isinstance(f, Timed) else f
    result = called(argument, f, tracer.state, tracer.parameters, as_script)
    try:
        parts = _parts(argument, result, tracer.layout.n)
        alone = [a.item() if isinstance(a, np.ndarray) and a.size == 1 else a for a in parts]
        if argument in ("H", "surface", "mass", "constraints"):
            return [*map(tracer.result, alone)]
        of_time = 1.0 if argument == "f" else tracer.time
        return components(tracer, tracer.layout, alone, of_time)
    except (TypeError, ValueError) as error:
        of = ValueError if isinstance(error, ValueError) else TypeError
        raise of(f"{argument}: {error}") from None


def called_by_name(name: str, arguments: Sequence[Any]) -> Any:
    """Return the value of a function in the text of an equation."""
    if name == "interp":
        return symbols.interpolated(*arguments)
    function = OTHER_NAMES.get(name, name)
    record = FUNCTIONS.get(function)
    if record is None or record.sign or len(arguments) != record.operands:
        raise ValueError(f"equations: there is no function {name} of {len(arguments)}")
    if any(isinstance(a, tuple) for a in arguments):
        raise ValueError(f"equations: {name} takes numbers")
    with np.errstate(all="ignore"):
        value = symbols.applied(function, *arguments)
    return value if isinstance(value, (Symbol, np.ndarray)) else float(value)
