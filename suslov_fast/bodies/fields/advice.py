"""Errors of functions of users that define no field: what f must be, and what to write instead."""

import inspect
from collections.abc import Mapping, Sequence
from keyword import iskeyword
from typing import Any, NoReturn

from ...checks import page, short, wrong
from .names import TIME, clash, free
from .symbolic import Untraceable

GENERAL = "howto/motion"
_LAMBDIFIED = "_lambdifygenerated"  # the name of functions of SymPy, which users do not see
_STARS = inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD


def _parameters(f: Any) -> list[inspect.Parameter] | None:
    """Return the parameters of a function, None if it does not tell them."""
    try:
        return [*inspect.signature(f).parameters.values()]
    except (TypeError, ValueError):
        return None


def arguments_of(f: Any) -> list[str]:
    """Return the names of the required arguments of a function, and of a time argument."""
    named = [a for a in _parameters(f) or [] if a.kind not in _STARS]
    return [a.name for a in named if a.default is a.empty or a.name in TIME]


def name_of(f: Any, argument: str) -> str:
    """Return the name of a function, or `argument` if it has none, as a lambda."""
    name = getattr(f, "__name__", "")
    is_name = name.isidentifier() and not iskeyword(name) and name != _LAMBDIFIED
    return name if is_name else argument


def check_callable(argument: str, f: Any) -> None:
    """Raise TypeError unless f is a function."""
    if callable(f):
        return
    example = "(x[0]**2 + x[1]**2) / 2" if argument == "H" else "(x[1], -x[0])"
    how = f": for example lambda x: {example}"
    if any(hasattr(each, "free_symbols") for each in (f if isinstance(f, (list, tuple)) else [f])):
        how = ": SymPy's lambdify([names], list(expressions)) makes one"
    raise wrong(
        argument, "a function of x, a tuple of the variables", f"{short(f)}{how}", TypeError
    )


def check_arguments(
    argument: str, f: Any, names: Sequence[str], given: Mapping[str, Any], maker: str = ""
) -> None:
    """Raise TypeError unless f takes the state alone, as one tuple, and the parameters `given`.

    `names` are those of the variables, and `argument` that of the argument that holds f; `maker` is
    the public function that takes f.
    """
    parameters = _parameters(f)
    if parameters is None:
        return
    first, others, D = parameters[:1], parameters[1:], len(names)
    by_position = inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD
    takes_state = bool(first) and first[0].kind in by_position
    missing = [a.name for a in others if a.default is a.empty and a.kind not in _STARS]
    missing = [name for name in missing if name not in given]
    takes_any = any(a.kind is a.VAR_KEYWORD for a in parameters)
    unknown = [name for name in given if name not in {a.name for a in others}]
    unknown = [] if takes_any else unknown
    is_timed = any(a.name in TIME for a in parameters)
    if takes_state and not (missing or unknown or is_timed):
        return
    f_name = name_of(f, argument)
    if is_timed:
        own = [a.name for a in parameters if a.name not in TIME]
        texts = dict.fromkeys(TIME, "None") | dict.fromkeys(own[:1], "x")
        passed = [
            f"{a.name}=" * (a.kind is a.KEYWORD_ONLY) + texts.get(a.name, a.name)
            for a in parameters
        ]
        how = (
            f"pass lambda {', '.join(['x', *own[1:]])}: {f_name}({', '.join(passed)}), if it uses "
        )
        how += f"no time; to make time a variable see {page(GENERAL)}"
    elif not takes_state:
        how = f"pass lambda x: {f_name}(*x)" if first else "write lambda x: ..."
    elif missing:
        how = f"pass {missing[0]}=, a parameter"
        if what := clash(missing[0], names, maker):
            other = free(missing[0], names, maker)
            how = f"rename {missing[0]}, the name of {what}, for example to {other}"
        if len(missing) == D - 1:
            how += f"; or lambda x: {f_name}(*x), if these are the {D} variables"
    else:
        known = ", ".join(a.name for a in others) or "none"
        how = f"it has no parameter {', '.join(unknown)}, choose from: {known}"
    must = "must take the state, as one tuple, and parameters by name"
    received = f"{f_name}({', '.join(map(str, parameters))})"
    raise TypeError(f"{argument} {must}, not {received}: {how}")


def prefixed(argument: str, text: str) -> str:
    """Return a message that begins with the name of an argument, unless the text does."""
    return text if text.startswith(f"{argument} ") else f"{argument}: {text}"


def explained(error: Exception, f_name: str, names: Sequence[str], is_family: bool) -> str:
    """Return the cause, in words, of an error that f raised when it was called with symbols."""
    text = " ".join(str(error).split())
    if hasattr(error, "in_words"):  # NoPolynomial or NoPower
        return f"{f_name} {error.in_words(names)}"
    if isinstance(error, (Untraceable, ArithmeticError)):
        return text
    if is_family:
        return f"{text}: an array is a family, f receives one number of it at a time"
    symbols = f"{len(names)} symbols" + f", {', '.join(names)}" * (len(names) < 9)
    how = "write formulas of x by + - * / ** and functions of NumPy"
    return f"{text}: {f_name} is called with {symbols}: {how}, see {page(GENERAL)}"


def raise_explained(argument: str, error: Exception, cause: str) -> NoReturn:
    """Raise a TypeError or a ValueError with the cause of an error that f raised.

    An error of another class, which has nothing to do with symbols, is raised as it is.
    """
    is_value = isinstance(error, (ValueError, IndexError, ArithmeticError))
    if not (is_value or isinstance(error, (TypeError, AttributeError))):
        raise error
    kind = ValueError if is_value else TypeError
    raise kind(prefixed(argument, cause)) from error
