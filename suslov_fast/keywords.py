"""Errors of public functions and objects that lack an argument or an attribute: what to use."""

from __future__ import annotations

import dis
import inspect
import re
from collections.abc import Callable
from dataclasses import FrozenInstanceError
from functools import wraps
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np

import suslov_fast

from .words import answer

P = ParamSpec("P")
R = TypeVar("R")

_OWN = {"self", "cls", "_cls"}  # which a caller does not pass


def lacking(thing: Any, name: str, here: str = "") -> AttributeError | ImportError:
    """Return the error of an object, or of a module, without an attribute, for its `__getattr__`.

    `here` is what to use, if it is known; else it is looked for. For ``from module import name``
    it is an ImportError, because Python would replace another by one without the answer.
    """
    kinds = [k.__name__ for k in (thing if isinstance(thing, type) else type(thing)).__mro__]
    called = f"type object {kinds[0]!r}" if isinstance(thing, type) else f"{kinds[0]!r} object"
    if inspect.ismodule(thing):
        called = f"module {thing.__name__!r}"
    if not here and not name.startswith("_"):
        functions = dir(suslov_fast)
        own = [each for each in dir(thing) if not each.startswith("_")]
        own *= thing is not suslov_fast
        here = answer(name, own + functions, *kinds, "words")
        if here in functions and here not in own:
            here = f"suslov_fast.{here}{_call_of(getattr(suslov_fast, here))}"
    text = f"{called} has no attribute {name!r}"
    if here and inspect.ismodule(thing) and _in_import(inspect.currentframe()):
        return ImportError(f"cannot import name {name!r} from {thing.__name__!r}: use {here}")
    if here:
        return AttributeError(f"{text}: use {here}")
    return AttributeError(text, name=name, obj=thing)


def _in_import(frame: Any) -> bool:
    """Return whether the `__getattr__` that called a frame is called by ``from module import``."""
    caller = frame.f_back.f_back
    operation: str = dis.opname[caller.f_code.co_code[caller.f_lasti]]
    return operation == "IMPORT_FROM"


def _call_of(function: Any) -> str:
    """Return how a function is called at least, as (system, x, eps); nothing for a class."""
    if not inspect.isfunction(function):
        return ""
    needed = []
    for name, each in inspect.signature(function).parameters.items():
        if name == "time":
            needed.append("time=T")
        elif each.default is each.empty:
            needed.append(f"{name}=" if each.kind is each.KEYWORD_ONLY else name)
    return f"({', '.join(needed)})"


class Answering(type):
    """The class of classes that answer an attribute that they lack, as their objects do."""

    if not TYPE_CHECKING:  # type checkers would accept any name

        def __getattr__(cls, name: str) -> Any:
            raise lacking(cls, name)


def with_answers(kind: type[R]) -> type[R]:
    """Let the objects of a class answer an attribute that they lack.

    Two named tuples of arrays are equal if these are, where NaN equals NaN.
    """

    def answer(self: Any, name: str) -> Any:
        raise lacking(self, name)

    def equals(self: Any, other: Any) -> bool:
        return type(other) is type(self) and all(
            np.array_equal(a, b, equal_nan=True) for a, b in zip(self, other, strict=True)
        )

    kind.__getattr__ = answer  # type: ignore[attr-defined]
    if issubclass(kind, tuple):
        kind.__eq__ = equals  # type: ignore[method-assign]
        kind.__ne__ = lambda self, other: not equals(self, other)  # type: ignore[method-assign]
    return kind


def public(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function answer a keyword that it does not have with the one to use.

    Other calls that do not fit are answered with the arguments that it takes.
    """
    *_, owner, called = ("", *function.__qualname__.split("."))
    called = owner if called.startswith("__") else called

    @wraps(function)
    def answering(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except TypeError:  # of Python if the call is wrong: looked at only now, for speed
            if mistake := _mistake(called, inspect.signature(function), args, kwargs):
                raise TypeError(mistake) from None
            raise

    return answering


def public_class(kind: type[R]) -> type[R]:
    """Let the constructor of a dataclass, or of a named tuple, answer as a public function.

    A frozen dataclass answers an assignment with what makes another object.
    """
    if issubclass(kind, tuple):
        kind.__new__ = staticmethod(public(kind.__new__))  # type: ignore[method-assign]
        return kind
    kind.__init__ = public(kind.__init__)  # type: ignore[method-assign]
    if "__setattr__" in vars(kind):
        kind.__setattr__ = _unchanged  # type: ignore[method-assign]
    return kind


def _unchanged(self: Any, name: str, value: Any) -> None:
    how = f"make it again with {name}=..."
    raise FrozenInstanceError(f"{type(self).__name__} cannot be changed: {how}")


def _of_system(name: str, system: Any = None) -> str:
    """Return what to use for a parameter of a system; nothing for another word."""
    parameters = getattr(system, "parameters", None)
    if not isinstance(parameters, dict) or parameters.keys().isdisjoint([name, *name.split("_")]):
        return ""
    name = name if name in parameters else next(p for p in name.split("_") if p in parameters)
    how = f"system.with_parameters({name}=...)"
    if "with_parameters" not in dir(system):
        how = f"a system that is made with {name}=..."
    return f"{how}, where an array makes a family"


def _mistake(called: str, signature: inspect.Signature, args: Any, kwargs: Any) -> str:
    """Return what is wrong with the arguments of a call, or nothing if they fit."""
    parameters = [*signature.parameters.values()]
    by_name = {each.name for each in parameters if each.kind is not each.POSITIONAL_ONLY}
    takes_any = any(each.kind is each.VAR_KEYWORD for each in parameters)
    if unknown := [] if takes_any else [name for name in kwargs if name not in by_name]:
        names = sorted(by_name - _OWN)
        known = f"use one of {', '.join(names)}" if names else "it takes none by name"
        here = {
            name: _of_system(name, *args[:1]) or answer(name, names, called, "argument", "words")
            for name in unknown
        }
        told = [f"{name!r}: use {here[name]}" for name in unknown if here[name]]
        rest = [repr(name) for name in unknown if not here[name]]
        told += [f"{', '.join(rest)}: {known}"] * bool(rest)
        return f"{called} has no argument {', and no '.join(told)}"
    try:
        signature.bind(*args, **kwargs)
    except TypeError as error:
        shown = [p.replace(annotation=p.empty) for p in parameters if p.name not in _OWN]
        how = ""
        unnamed = sum(p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD) for p in parameters)
        after_star = [p for p in shown if p.kind is p.KEYWORD_ONLY]
        missing = [p for p in after_star if p.default is p.empty and p.name not in kwargs]
        named = ", ".join(f"{p.name}=" for p in missing or after_star[:3])
        if missing or (len(args) > unnamed and (named or takes_any)):
            how = f", pass {'parameters, as a=1,' if takes_any else named} by name"
        takes = signature.replace(parameters=shown, return_annotation=inspect.Signature.empty)
        if called in ("flow", "iterate") and args and inspect.isroutine(args[0]):
            maker = "Field" if called == "flow" else "QuadraticField"
            how += f", and for the function pass {maker}.from_function(f, names)"
        if args and getattr(args[0], "called", "") == "a run":
            first = "[0]" * ("0'" in str(error))  # of x0 or omega0
            eps = ", run.eps" * ("eps" in signature.parameters and hasattr(args[0], "eps"))
            how += f", for a run pass run.body, run.states{first}{eps}"
        if "'store'" in str(error):
            how += ", a folder to write: flow and iterate keep their results in memory"
        if "'eps'" in str(error):
            how += ", the step size of Kahan's map of an ODE x' = f(x)"
            own = ", where a map x -> f(x) of your own is a loop in NumPy"
            how += own * (called in ("iterate", "step"))
        if "'monomials'" in str(error):
            how += ", a degree, such as 2, or a list of exponents"
        if "'dimension'" in str(error):
            how += ", the number of variables, or their names, as 'x y'"
        kind = type(args[0]) if args else None
        if kind and kind.__name__ == called:  # of a constructor
            makers = [f"{called}.{each}" for each in dir(kind) if re.match("from_(?!dict)", each)]
            makers = [
                f"body, rotation = {each}(I, ...)" if each.endswith(("inertia", "tensor")) else each
                for each in makers
            ]
            how += f", or use {' or '.join(makers)}" * bool(makers)
        more = ""
        function = getattr(suslov_fast, called, None)
        if inspect.isfunction(function) and "self" in signature.parameters:
            more = f", and for a step of the map suslov_fast.{called}{_call_of(function)}"
        return f"{called}: {error}{how}: the call is {called}{takes}{more}"
    return ""
