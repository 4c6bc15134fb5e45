"""Errors of public functions and objects that lack an argument or an attribute: what to use."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import suslov_fast

from .words import answer

P = ParamSpec("P")
R = TypeVar("R")


def lacking(thing: Any, name: str, here: str = "") -> AttributeError:
    """Return the error of an object, or of a module, without an attribute, for its `__getattr__`.

    `here` is what to use, if it is known; else it is looked for.
    """
    if inspect.ismodule(thing):
        called = f"module {thing.__name__!r}"
    else:
        called = f"{type(thing).__name__!r} object"
    if not here and not name.startswith("_"):
        here = answer(name, [each for each in dir(thing) if not each.startswith("_")])
        here = f"suslov_fast.{name}(...)" if name in suslov_fast.__all__ else here
    text = f"{called} has no attribute {name!r}"
    return AttributeError(f"{text}: use {here}" if here else text)


def public(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function answer a keyword that it does not have with the one to use."""

    @wraps(function)
    def answering(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except TypeError as error:  # of Python if the call is wrong: looked at only now, for speed
            *_, owner, called = ("", *function.__qualname__.split("."))
            called = owner if called == "__init__" else called
            names = inspect.signature(function).parameters
            unknown = [name for name in kwargs if name not in names]
            if not (unknown and "unexpected keyword argument" in str(error)):
                raise
            known = [name for name in names if name not in ("self", "cls")]
            own = getattr(args[0], "parameters", {}) if args else {}
            how = "; ".join(
                f"{each!r}: use "
                + ("with_parameters" if each in own else answer(each, known) or ", ".join(known))
                for each in unknown
            )
            raise TypeError(f"{called} has no argument {how}") from None

    return answering


def public_class(kind: type[R]) -> type[R]:
    """Let the constructor of a dataclass answer as a public function."""
    kind.__init__ = public(kind.__init__)  # type: ignore[method-assign]
    return kind
