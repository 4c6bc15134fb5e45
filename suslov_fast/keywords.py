"""Errors of unknown arguments and attributes, which say which name to use."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterable
from dataclasses import FrozenInstanceError
from functools import wraps
from importlib.util import find_spec
from types import ModuleType
from typing import Any, NoReturn, ParamSpec, TypeVar

import suslov_fast

from .words import answer

P = ParamSpec("P")
R = TypeVar("R")
_ORDINALS = "first", "second", "third", "fourth", "fifth"


def lacking(thing: Any, name: str, here: str = "") -> AttributeError:
    """Return the AttributeError of an object, class or module that lacks the attribute `name`.

    The message says what to use: `here` or, if `here` is "", what the table of `words` advises for
    this name, or where the package has it.
    """
    if isinstance(thing, ModuleType | type):
        kind = "module" if inspect.ismodule(thing) else "type object"
        called = f"{kind} {thing.__name__!r}"
    else:
        called = f"{type(thing).__name__!r} object"
    if not here and not name.startswith("_"):
        here = answer(name, [each for each in dir(thing) if not each.startswith("_")])
        here = _place_of(thing, name) or here
        here = f"suslov_fast.{name}(...)" if name in dir(suslov_fast) else here
    text = f"{called} has no attribute {name!r}"
    return AttributeError(f"{text}: use {here}" if here else text)


def missing_in(module: str, name: str) -> Exception:
    """Return the error of a package that lacks a name, for the `__getattr__` of the package.

    For ``from package import name`` it is an ImportError, because Python would hide the text of an
    AttributeError.
    """
    if find_spec(f"{module}.{name}"):  # a submodule: `from ... import` loads it after this error
        return AttributeError(name)
    error = lacking(sys.modules[module], name)
    if sys._getframe(2).f_code.co_name == "_handle_fromlist":  # for `from ... import`
        return ImportError(f"cannot import name {name!r}: {error}")
    return error


def _place_of(thing: Any, name: str) -> str:
    """Return where `kahan` or a public class has a name that the package lacks; "" if nowhere."""
    if thing is not suslov_fast:
        return ""
    if name in suslov_fast.kahan.__all__:
        return f"suslov_fast.kahan.{name}(system, x, eps)"
    things = (getattr(suslov_fast, each) for each in ("Field", *suslov_fast.__all__))
    kinds = (each for each in things if isinstance(each, Answering) and hasattr(each, name))
    return next((f"{kind.__name__}.{name}" for kind in kinds), "")


class Answering(type):
    """The metaclass of classes whose errors of unknown attributes say which name to use."""

    def __getattr__(cls, name: str) -> Any:
        raise lacking(cls, name)


def public(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function whose errors of unknown arguments say which argument to use."""

    @wraps(function)
    def answering(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except TypeError as error:  # arguments are checked only after an error, for speed
            if error.__traceback__ is None or error.__traceback__.tb_next is not None:
                raise  # the error is from inside the function, not from the call
            raise _wrong_call(function, args, kwargs, error) from None
        except MemoryError as error:
            if function.__name__ in ("flow", "iterate"):
                how = "ensemble(system, x0, 'run.zarr', ...) writes a run to a file in parts"
                raise MemoryError(f"{error}: {how}") from None
            raise

    return answering


def refuse_unknown(called: str, options: Iterable[str], *functions: Any) -> None:
    """Raise TypeError if an option of the call is an argument of none of the functions."""
    known = {name: 0 for each in functions for name in inspect.signature(each).parameters}
    known.pop("self", 0)
    for word in options:
        if word not in known:
            how = answer(word, known) or ", ".join(known)
            raise TypeError(f"{called} has no argument {word!r}: use {how}")


def _wrong_call(function: Any, args: Any, kwargs: Any, error: TypeError) -> TypeError:
    """Return the error of a call with wrong arguments."""
    names = function.__qualname__.split(".")
    called = names[-2] if names[-1] == "__init__" else names[-1]
    parameters = inspect.signature(function).parameters
    known = [name for name in parameters if name not in ("self", "cls")]
    kinds = {name: parameters[name].kind for name in known}
    first = [name for name in known if kinds[name] is inspect.Parameter.POSITIONAL_ONLY]
    takes_all = inspect.Parameter.VAR_KEYWORD in kinds.values()
    unknown = [name for name in kwargs if name in first or not (takes_all or name in kinds)]
    if unknown:
        is_method = args and not isinstance(args[0], type)
        parameters_of_system = getattr(args[0], "parameters", {}) if is_method else {}

        def how(word: str) -> str:
            values = _by_name(args[0], word, kwargs[word]) if args else ""
            if values:
                return f"Field(f, names, {values}), whose parameters have names"
            here = word if word in first else answer(word, known)
            if here in first:
                return f"the {_ORDINALS[known.index(here)]} argument, {here}, without a name"
            if word in parameters_of_system:
                return "with_parameters"
            return here or ", ".join(known)

        each = "; ".join(f"{word!r}: use {how(word)}" for word in unknown)
        return TypeError(f"{called} has no argument {each}")
    matrix = names[-1] == "__init__" and getattr((*args, 0, 0)[1], "ndim", 0) == 2
    if matrix and (here := answer("frommatrix", dir(args[0]))) in dir(args[0]):
        return TypeError(f"{called} takes numbers: {called}.{here} takes a matrix")
    named = [name for name in known if kinds[name] is inspect.Parameter.KEYWORD_ONLY]
    if named and str(error).endswith("given") and len(args) > len(parameters) - len(named):
        others = ", ".join(name for name in known if name not in named)
        if called == "flow" and len(args) == 3:
            return TypeError(f"flow has two arguments without a name: pass {_call_of_flow(*args)}")
        which = f"{others}; pass others" if others else "pass them"
        return TypeError(f"{error}: {which} by name, as {named[0]}=")
    return error


def _by_name(f: Any, word: str, value: Any) -> str:
    """Return parameters of a function with their values, "a=1, b=2"; "" if it has no such ones.

    The word is the name of one, or "args", whose values are those of the last arguments.
    """
    names = [*inspect.signature(f).parameters] if inspect.isfunction(f) else []
    if word in names:
        return f"{word}={value}"
    values = value if isinstance(value, tuple) else (value,)
    if word != "args" or len(names) < len(values):
        return ""
    pairs = zip(names[-len(values) :], values, strict=True)
    return ", ".join(f"{a}={b}" for a, b in pairs)


def _call_of_flow(_: Any, second: Any, third: Any) -> str:
    """Return the call of `flow` for arguments in the order of solve_ivp, or of odeint."""
    span = second if isinstance(second, tuple) else ()
    if [isinstance(a, (int, float)) for a in span] != [True, True]:
        return "flow(f, y0, time=t)"
    start, end = span
    t0 = f", t0={start}" if start != 0 else ""
    return f"flow(f, y0, time=np.linspace(0, {end - start}, 201){t0})"


def public_class(kind: type[R]) -> type[R]:
    """Make the constructor of a frozen dataclass a public function; explain its errors."""
    kind.__init__ = public(kind.__init__)  # type: ignore[method-assign]
    kind.__setattr__ = _unchanged  # type: ignore[method-assign]
    return kind


def _unchanged(self: Any, name: str, _: Any) -> NoReturn:
    """Raise the error of an object that keeps the values with which it was made."""
    how = f"make another {type(self).__name__}"
    how = f"use with_parameters({name}=...)" if hasattr(self, "with_parameters") else how
    raise FrozenInstanceError(f"{name} of a {type(self).__name__} cannot be set: {how}")
