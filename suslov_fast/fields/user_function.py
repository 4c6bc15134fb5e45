"""A user's function with a role: how it is called with symbols, and what it must return."""

from __future__ import annotations

import dis
import inspect
from collections.abc import Collection, Mapping, Sequence
from difflib import get_close_matches
from numbers import Real
from typing import Any

import numpy as np

from ..checks import OF_SYMBOLS, either, short, signature_of, wrong
from ..words import STEPS, answer
from .branching import Raised, along_all_paths
from .complex_symbols import parts_of_number
from .names import OF_TIME, TIME
from .namespaces import Names, is_copied
from .symbols import MADE, TABLES, Symbols, Untraceable
from .tracer import Tracer, components

_FAILURES = (
    TypeError, ValueError, AttributeError, LookupError, ArithmeticError, AssertionError,
    StopIteration,
)  # fmt: skip
_OF_TEXT = "Field.from_equations(\"x' = v; v' = -k*x\", k=1.0) reads equations as text"
_OF_SYMPY = "write sympy.lambdify([names], expressions), a function of all names in one list"
# Roles of functions that return one number, or any number of them; `mass` returns a matrix, and
# f and `to` a number for each variable.
_ONE = "H", "L", "surface"
_ANY = "constraints", "forces", "frame", "integrals", "values"


class UserFunction:
    """A function of the user: of the state x, or of (q, v), of the time, and of parameters.

    role        "f", "H", "L", "mass", "surface", "to", "constraints", "forces", "frame",
                "integrals" or "values": the name of the argument in messages
    has_time    True if it takes the time, an argument t or time without a default: before or
                after the state x; anywhere beside (q, v)
    takes       the names of those `parameters` that it takes
    sizes       the lengths of the arrays that it takes in place of x: (n, m) of (q, v)
    """

    def __init__(
        self, role: str, f: Any, parameters: Collection[str] = (), sizes: Sequence[int] = ()
    ) -> None:
        check_callable(role, f)
        self.role, self.f, self.sizes = role, f, sizes
        self.signature = signature_of(f)
        every = [*self.signature.parameters.values()] if self.signature else []
        needed = [a for a in every if a.default is a.empty and a.kind not in _STARS]
        states = 2 if sizes else 1
        first = [a.name for a in needed[: states + 1] if a.kind is not a.KEYWORD_ONLY]
        times = [a for a in (needed if sizes else needed[:2]) if a.name in TIME]
        has_states = len(first) > states and not {*first} & {*parameters}
        self.has_time = len(times) == 1 and (has_states or bool(sizes))
        time = times[0] if self.has_time else None
        self._others = [a for a in every if a is not time]
        # The time is passed by its place among the first arguments, else by its name.
        self._place = first.index(time.name) if time and time.name in first else -1
        self._time = time.name if time else ""
        self.takes_all = any(a.kind is a.VAR_KEYWORD for a in every)
        self.takes = self.taken(parameters)

    def taken(self, parameters: Collection[str]) -> list[str]:
        """Return those of the parameters that the function takes."""
        if not parameters:  # for speed
            return []
        known = {each.name for each in self._others[2 if self.sizes else 1 :]}
        return [name for name in parameters if self.takes_all or name in known]

    @property
    def needed(self) -> list[str]:
        """The names of arguments without a default, except the time: first those of the state."""
        return [a.name for a in self._others if a.default is a.empty and a.kind not in _STARS]

    # ------------------------------------------------------------------------------ checks
    def check(self, names: Sequence[str], parameters: Mapping[str, Any]) -> None:
        """Raise TypeError unless the function takes the state and these parameters."""
        for name, value in parameters.items():
            if isinstance(value, Mapping):
                how = f"Field(f, names, **{name}), with f(x, {', '.join(map(str, value))})"
                raise wrong(name, "a number", f"a dictionary: pass {how}", TypeError)
        if self.signature is None:
            return
        others = self._others[1:]
        known = [each.name for each in others if each.kind not in _STARS]
        if "args" in parameters and "args" not in known:
            how = self._of_args(parameters["args"], known)
            raise wrong("args", "left out", f"{short(parameters['args'])}: pass {how}", TypeError)
        missing = [name for name in self.needed[1:] if name not in parameters]
        unknown = [name for name in parameters if not (self.takes_all or name in known)]
        takes_time = not TIME.isdisjoint(each.name for each in self._others)
        if not (takes_time or missing or unknown) and _takes_state(self._others):
            return  # for speed
        signature = self.signature.replace(parameters=self._others)
        if not takes_time and _fits(signature, parameters):
            return
        if takes_time:
            how = "pass lambda x: ..." if self.role == "H" else OF_TIME
        elif any(each.kind is each.VAR_POSITIONAL for each in others):
            how = "parameters have names, as lambda x, a, b: ..., with a=1.0, b=2.0"
        elif unknown:
            how = _of_unknown(unknown[0], known)
        elif missing:
            how = self._of_missing(missing, len(names))
        else:
            how = "pass lambda x: ..."
        expected = "a function of the state, one array, and of its parameters by name"
        raise wrong(self.role, expected, f"one of {signature}: {how}", TypeError)

    def _of_args(self, values: Any, known: Sequence[str]) -> str:
        """Return what to type in place of SciPy's `args`."""
        values = values if isinstance(values, tuple) else (values,)
        if not all(isinstance(a, Real) for a in values) and self.signature is not None:
            states = ", ".join(list(self.signature.parameters)[: 1 + self.has_time])
            return f"Field(lambda {states}: f({states}, *args), names)"
        pairs = zip(known, map(short, values), strict=False)
        return f"Field(f, names, {', '.join(map('='.join, pairs))})"

    def _of_missing(self, missing: Sequence[str], count: int) -> str:
        """Return what to type in place of a call without values of parameters."""
        values = ", ".join(f"{name}=1.0" for name in missing)
        how = f"pass values of its parameters, as {values}"
        if self.role == "f":
            how = f"pass values of its parameters, Field(f, names, {values})"
        if self.role == "f" and not self.has_time:
            how += f"; if {missing[0]} is the time, name it t"
        if len(missing) == count - 1 and not self.has_time:
            how += f", or lambda x: {self.role}(*x) if these are the variables"
        return how

    # ------------------------------------------------------------------------------ formulas
    def formulas(self, tracer: Tracer) -> list[Any]:
        """Return the operands of its results in the list of the tracer; of a matrix, by rows.

        It is called twice, and once more for each further path through its `if`s.
        """
        before = MADE.count
        try:
            rows = self._traced(tracer, Names())
        except (TypeError, ValueError) as error:
            if MADE.count == before:
                raise
            try:  # it may write symbols into an array of its own numbers
                rows = self._traced(tracer, Names(fills_all=True))
            except (TypeError, ValueError):
                raise error from error.__cause__
        MADE.count = before  # so that a function that makes this field is no suspect
        return rows

    def _traced(self, tracer: Tracer, names: Names) -> list[Any]:
        f = names.copy_of(self.f)
        try:
            return along_all_paths(tracer, lambda: self._operands(tracer, self._value(f, tracer)))
        except (TypeError, ValueError) as error:
            kind = TypeError if isinstance(error, TypeError) else ValueError
            raise kind(f"{self.role}: {error}") from (error.__cause__ or error)
        finally:
            names.close()

    def _value(self, f: Any, tracer: Tracer) -> Any:
        """Return what f returns at symbols; TypeError or ValueError if it does not accept them."""
        x, n = tracer.state, self.sizes[0] if self.sizes else 0
        given = [x[:n], x[n : sum(self.sizes)]] if self.sizes else [x]
        options = {name: tracer.parameters[name] for name in self.taken(tracer.parameters)}
        if self._place >= 0:
            given.insert(self._place, tracer.time)
        elif self.has_time:
            options[self._time] = tracer.time
        before = MADE.count
        try:
            value = f(*given, **options)
        except Exception as error:
            failure: Exception = error
            if isinstance(error, _FAILURES):
                kind = TypeError if isinstance(error, (TypeError, AttributeError)) else ValueError
                failure = kind(_text_of(error, x))
                failure.__cause__ = error
            if MADE.count == before and _is_raised(error):
                raise Raised(failure) from error
            raise failure from failure.__cause__
        if MADE.count > before:
            raise Untraceable(
                "f catches an error of its call with symbols, which `except` hides: leave it out"
            )
        return value

    def _operands(self, tracer: Tracer, result: Any) -> list[Any]:
        parts = self._parts(result, tracer.layout.n)
        alone = [a.item() if isinstance(a, np.ndarray) and a.size == 1 else a for a in parts]
        if self.role == "mass":
            alone = tracer.layout.blocks(alone, parts_of_number)
        if self.role == "integrals":  # both parts of a complex integral are integrals
            pairs = map(parts_of_number, alone)
            alone = [a for pair in pairs for a in pair[: 1 + (type(pair[1]) is not float)]]
        if self.role not in ("f", "to"):
            return [*map(tracer.result, alone)]
        of_time = 1.0 if self.role == "f" else tracer.time
        return components(tracer, tracer.layout, alone, of_time)

    def _parts(self, result: Any, D: int) -> Any:
        """Return the parts of the result: D components, one number, or the entries of M."""
        if self.role in _ONE:
            return [result]
        if self.role in _ANY:
            if parts := np.ravel(np.array(result, object)).tolist():
                return parts
            raise ValueError(f"must return one or more numbers, not {short(result)}")
        if self.role != "mass":
            return _components(result, D)
        array = np.array([[result]] if D == 1 and np.ndim(result) == 0 else result, object)
        if array.shape != (D, D):
            received = f"{short(result)} of shape {array.shape}"
            raise ValueError(f"must return a matrix of the shape ({D}, {D}), not {received}")
        return array.ravel().tolist()


_RAISE = dis.opmap["RAISE_VARARGS"]
_STARS = inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD


def _is_raised(error: Exception) -> bool:
    """Return True if a `raise` or `assert` of the user raised the error."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is None or not is_copied(trace.tb_frame):
        return False
    return trace.tb_frame.f_code.co_code[trace.tb_lasti] == _RAISE


def check_callable(argument: str, f: Any) -> None:
    """Raise TypeError unless f is a function."""
    if not callable(f):
        items = f if isinstance(f, list | tuple | dict) else [f]
        how = _OF_TEXT if any(isinstance(each, str) for each in items) else _OF_SYMPY
        raise wrong(argument, "a function of x", f"{short(f)}: {how}", TypeError)


def _of_unknown(name: str, known: Sequence[str]) -> str:
    """Return what to type in place of a parameter that a function does not have."""
    near = get_close_matches(name, known, 1, 0.6)
    how = f"it has no parameter {name!r}"
    if near or known:
        return f"{how}, but {either(near or known)}"
    meant = answer(name) if len(name) > 1 else ""  # a word, not a letter
    return f"{how}: use {meant}" if meant else how


def _takes_state(arguments: Sequence[inspect.Parameter]) -> bool:
    return len(arguments) > 0 and arguments[0].kind is inspect.Parameter.POSITIONAL_OR_KEYWORD


def _fits(signature: inspect.Signature, parameters: Mapping[str, Any]) -> bool:
    """Return True if a function takes the state by position, and these parameters by name."""
    try:
        bound = signature.bind(None, **parameters)
    except TypeError:
        return False
    return len(bound.args) > 0


def _text_of(error: Exception, state: Symbols) -> str:
    """Return the text of an error of f, with advice unless the text has it."""
    text = " ".join((str(error) or repr(error)).split())
    text = text.replace("'Symbols' object", "the state of symbols")
    text = text.replace("'Symbol' object", "a symbol")
    if "Cannot cast" in text:  # a part of a message of NumPy
        text = "a function that is no formula needs numbers"
    if isinstance(error, (Untraceable, ArithmeticError)) or OF_SYMBOLS in text:
        return text
    of_state = ", ".join(str(state[i]) for i in range(min(len(state), 8)))
    how = f"write formulas by + - * / ** and functions of NumPy, and {TABLES}"
    if "enough dimensions" in text or "not subscriptable" in text:
        text = "a number is used as an array"
        how = "a parameter k is one number in f: pass k1, k2, or leave a matrix out of the "
        how += "parameters"
    elif "valid indices" in text:
        how = f"write {STEPS} for values[k] from knots[k] on"
    elif "not callable" in text:
        how = "parameters are numbers: a function that f calls is no parameter, f finds it by name"
    elif "the state of symbols has no" in text:
        how = f"write x[0] for a component, and {TABLES}"
    return f"{text}: it is called with {len(state)} symbols, {of_state}: {how}"


def _components(result: Any, D: int) -> Any:
    """Return the result of f, if it has D components."""
    if hasattr(result, "free_symbols"):
        raise TypeError(f"must return formulas of x, not expressions of SymPy: {_OF_SYMPY}")
    is_sequence = isinstance(result, (tuple, list, np.ndarray))
    if D == 1 and not is_sequence:
        return [result]
    if isinstance(result, np.ndarray):
        if result.size == D:  # as a column, from products of matrices
            return result.ravel()
        how = ": for a matrix B of one column write B[:, 0]" * (len(result.shape) > 1)
        raise ValueError(f"must return {D} components, not an array of shape {result.shape}{how}")
    if not is_sequence or len(result) != D:
        raise ValueError(f"must return {D} components, not {result}")
    return result
