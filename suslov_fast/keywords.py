"""Answers to unknown keywords and names: what other packages call them, and what is here."""

from __future__ import annotations

import inspect
import opcode
import os
import sys
from collections.abc import Callable, Collection, Mapping
from dataclasses import FrozenInstanceError
from difflib import get_close_matches
from functools import wraps
from types import ModuleType
from typing import Any, NoReturn, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")

# Objects with fewer public names than this list them in their errors.
_FEW = 20
_TENSOR = "from_inertia(I, a) makes a body from an inertia tensor and the constrained axis"
_MATRIX = "from_mass_tensor makes a body from a matrix"

# Words of other packages for arguments of this one: a function is asked for those that it has.
_WORDS = {
    "eps": "dt h epsilon step_size stepsize delta_t first_step",
    "max_step": "maxstep dtmax",
    "steps": "n N n_steps num_steps nsteps iterations max_steps maxiter",
    "time": "t T times t_eval t_span tspan saveat ts t_end t_max tend tf t_final tmax duration",
    "period": "T",
    "n": "N n_steps",
    "rtol": "tol reltol",
    "tol": "rtol reltol",
    "atol": "abstol",
    "method": "order integrator solver alg algorithm scheme",
    "surface": "events event section condition value axis",
    "most": "terminal k",
    "transient": "burn_in transient_time n_transient Ttr discard",
    "save_every": "every stride thin sample save_at",
    "threads": "n_jobs workers num_threads cores n_workers",
    "client": "n_jobs workers n_workers cores",
    "time_limit": "timeout max_time budget",
    "progress": "verbose callback timeout time_limit max_time budget",
    "seed": "rng random_state",
    "store": "filename file",
    "path": "filename file",
    "color": "c colour colors",
    "components": "x y z axis",
    "ax": "figsize xlim ylim xlabel ylabel grid legend",
    **{f"I{k}": f"I{k}{k}" for k in (1, 2, 3)},
    **{f"I{k}3": f"I3{k}" for k in (1, 2)},
}
# What to do with words for which there is no argument, if the function has one of another name:
# "2" stands for the states, its second argument, which has no name.
_INSTEAD = (
    ("x0 y0 u0 z0 X0 omega0 omega x state states ic", "2", "the states are the second argument"),
    ("body field f fun rhs system model", "2", "the first argument has no name"),
    ("args p params parameters", "2", "parameters belong to the field or body"),
    ("t time t_eval t_span t_end t_max tmax T", "steps", "a run ends at the time eps * steps"),
    ("dt h epsilon step_size eps steps method order", "rtol", "steps follow from rtol="),
    ("events event section condition terminal", "eps", "use crossings"),
    ("events event section condition terminal", "rtol", "use crossings"),
    ("tol rtol atol reltol abstol", "steps", "steps of maps have no tolerance, flow has one"),
    ("seed rng random_state", "steps", "pass RandomStarts as states"),
    ("k n_exponents num_exponents", "transient", "all exponents are returned"),
    ("overwrite mode", "store", "delete the folder of the store"),
    ("color", "steps", "plots have it"),
    ("I12 I21", "I13", f"it is 0 in the adapted basis: {_TENSOR}"),
    ("I inertia tensor", "I13", _TENSOR),
    ("inertia tensor", "J", _MATRIX),
    ("n N", "J", "J and I have n - 1 entries each"),
)


# Attributes of bodies in other packages, or of other objects, and what they are here.
_NEW_FIELD = "from_function again, with the new parameters; arrays of parameters make a family"
_IN_BODIES = {
    "to_latex latex equations to_sympy": "str(field), the equations",
    "save to_json to_file dump": "json.dump(body.to_dict(), file)",
    "replace subs with_parameters set_parameters": _NEW_FIELD,
    "lambdify": "field(x), or compiled.system(field, eps) in loops of your own",
    "hamiltonian": "suslov_fast.energy(field, x), for a field of from_hamiltonian",
    "dim ndim D N": "dimension",
    "x omega states": "the states of a run, as iterate returns it",
    "rhs f func fun": "field(x), the right-hand side at states x",
    "quadratic linear constant terms": "QuadraticField.of(body), whose terms they are",
    "jac jacobian Df df Dx eigenvalues eigvals derivative": "QuadraticField.of(body).jacobian(x), "
    "the derivative of the right-hand side; suslov_fast.jacobian is that of a step",
    "dt h t": "eps, an argument of iterate",
}
INSTEAD_IN_BODIES = {name: how for names, how in _IN_BODIES.items() for name in names.split()}


def public_class(kind: type[T]) -> type[T]:
    """Let the constructor of a dataclass, or of a named tuple, answer as a public function."""
    if issubclass(kind, tuple):
        kind.__new__ = staticmethod(public(kind.__new__))  # type: ignore[method-assign]
    else:
        kind.__init__ = public(kind.__init__)  # type: ignore[method-assign]
    return unchanging(kind) if hasattr(kind, "_remade") else kind


def unchanging(kind: type[T]) -> type[T]:
    """Let objects of a frozen dataclass answer an assignment with what to do instead.

    Their `_remade(name, value)` is that advice.
    """

    def answering(thing: Any, name: str, value: object) -> NoReturn:
        text = f"{type(thing).__name__} cannot be changed"
        raise FrozenInstanceError(f"{text}: {thing._remade(name, value)}")

    kind.__setattr__ = answering  # type: ignore[method-assign]
    return kind


def public(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function answer a keyword that it does not have with the one to use.

    It also says what the arguments are that a call lacks.
    """
    parameters = [*inspect.signature(function).parameters.values()]
    kinds = [each.kind for each in parameters]
    takes_any = inspect.Parameter.VAR_KEYWORD in kinds
    most = len(kinds) - kinds.count(inspect.Parameter.KEYWORD_ONLY) - takes_any
    is_method = int(parameters[0].name in ("self", "cls", "_cls")) if kinds else 0
    by_name = inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY
    known = {each.name for each in parameters[is_method:] if each.kind in by_name}
    unnamed = kinds.count(inspect.Parameter.POSITIONAL_ONLY)
    positional = [each.name for each in parameters[unnamed:most]]
    others = [f"{each.name}=" for each in parameters if each.kind is each.KEYWORD_ONLY]
    others += ["parameters, such as a=1"] * takes_any
    stars = inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD
    required = [a.name for a in parameters if a.default is a.empty and a.kind not in stars]
    written = [f"{a.name}=..." if a.kind is a.KEYWORD_ONLY else a.name for a in parameters]
    written = [name for name in written if name.removesuffix("=...") in required]
    whole = f"({', '.join(written[is_method:])})" if len(required) > 1 + is_method else ""
    *_, owner, called = ("", *function.__qualname__.split("."))
    called = owner if called.startswith("__") else called

    def mistake(args: tuple[object, ...], kwargs: dict[str, object]) -> Exception | None:
        """Return the error of a call whose arguments are not those of the function."""
        if len(args) > most and inspect.Parameter.VAR_POSITIONAL not in kinds:
            count, s = most - is_method, "" if most - is_method < 2 else "s"
            first = ", ".join(each.name for each in parameters[is_method:most])
            takes = f"{count or 'no'} argument{s} by position" + f" ({first})" * bool(count)
            received = f"{takes}, not {len(args) - is_method}"
            how = f"; by name: {', '.join(others)}" if others else ""
            return TypeError(f"{called} takes {received}{how}")
        if kwargs and not takes_any and not kwargs.keys() <= known:
            names: dict[str, list[str]] = {}  # by the advice
            for name in kwargs:
                if name not in known:
                    how = advice(name, known, unnamed)
                    names.setdefault(how, []).append(repr(name))
            each = [f"no argument {', '.join(given)}: {how}" for how, given in names.items()]
            return TypeError(f"{called} has {'; '.join(each)}")
        if len(args) > unnamed and not kwargs.keys().isdisjoint(positional[: len(args) - unnamed]):
            twice = [name for name in positional if name in kwargs]
            if takes_any:  # what is passed by name is a parameter of the equations
                how = f"rename it, to {twice[0]}_ for example"
                return ValueError(f"parameters: {twice[0]!r} clashes with an argument: {how}")
            return TypeError(f"{called} got {twice[0]} twice, by position and by name")
        if len(args) < len(required):
            for i, name in enumerate(required[len(args) :], len(args)):
                if name not in kwargs or i < unnamed:  # a parameter of equations may be called so
                    text = f"{called} needs {name}"
                    return TypeError(f"{text}; the call is {called}{whole}" if whole else text)
        return None

    @wraps(function)
    def answering(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except TypeError:  # of Python if the call is wrong: looked at only now, for speed
            if (error := mistake(args, kwargs)) is not None:
                raise error from None
            raise

    return answering


def advice(name: str, known: Collection[str], unnamed: int = 0) -> str:
    """Return what to pass in place of a keyword to a function with the `known` keywords.

    Of its `unnamed` arguments the first is a body or a field, and the second the states.
    """
    has = {*known, *("2" * (unnamed == 2))}
    words = {name, name.lower()}
    found = [ours for ours, theirs in _WORDS.items() if ours in known and words & {*theirs.split()}]
    for theirs, needed, how in () if found else _INSTEAD:
        if needed in has and words & {*theirs.split()}:
            return how
    if found or (found := get_close_matches(name, known, 1, 0.7)):
        return f"pass {found[0]}="
    how = f"it has {', '.join(sorted(known))}" if known else "it takes no argument by name"
    return f"{how}; parameters of equations belong to the field or body" if unnamed else how


def refuse(module: ModuleType, name: str, how: str) -> NoReturn:
    """Raise the error of a module, in whose `__getattr__` this is called, that lacks a name.

    `from module import name` drops the text of an AttributeError, so it gets an ImportError.
    """
    frame = sys._getframe(2)
    text = f": use {how}" if how else ""
    if how and frame.f_code.co_code[frame.f_lasti] == opcode.opmap["IMPORT_FROM"]:
        raise ImportError(f"cannot import name {name!r} from {module.__name__!r}{text}")
    # Python adds suggestions.
    text = f"module {module.__name__!r} has no attribute {name!r}{text}"
    raise AttributeError(text, name=name, obj=module)


def answers(called: str, instead: Mapping[str, str] | None = None) -> Callable[[type[T]], type[T]]:
    """Let objects of a class answer for an attribute that they lack with the one to use.

    `called` is what messages call such an object, and `instead` has names that other packages use,
    with blanks between them, and what there is here. Type checkers would take a method
    `__getattr__` in the class for leave to use any name.
    """
    table = {name: how for names, how in (instead or {}).items() for name in names.split()}

    def unknown(thing: Any, name: str) -> NoReturn:
        text, known = f"{called} has no attribute {name!r}", []
        if not name.startswith("_"):  # `dir` asks for __dict__
            known = [k for k in dir(thing) if not k.startswith("_") and not hasattr(tuple, k)]
        if how := table.get(name) or nearest(name, known):
            raise AttributeError(f"{text}: use {how}")
        text += f": it has {', '.join(known)}" if 0 < len(known) < _FEW else ""
        raise AttributeError(text, name=name, obj=thing)

    def answering(kind: type[T]) -> type[T]:
        kind.__getattr__ = unknown  # type: ignore[attr-defined]
        return kind

    return answering


def missing_file(path: str) -> str:
    """Return in words that there is no such file, and where it was looked for, or a similar one."""
    folder, name = os.path.split(os.path.abspath(path))
    if not os.path.isdir(folder):
        return f"there is no folder {folder}"
    text = f"there is no such file in {folder}"
    if near := nearest(name, os.listdir(folder)):
        return f"{text}: did you mean {near}?"
    return text + ": write it by json.dump(body.to_dict(), file)" * name.endswith(".json")


def nearest(name: str, known: Collection[str]) -> str:
    """Return the known public name that is spelt most like a name, or nothing."""
    near = get_close_matches(name, [each for each in known if not each.startswith("_")], 1, 0.75)
    return near[0] if near else ""
