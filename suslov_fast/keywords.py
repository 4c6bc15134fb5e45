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
_STATES = "the states are the second argument, without a name"
_SPAN = "pass eps= and steps=; a run ends at the time eps * steps"
_DIGITS = (
    'pass method="extrapolated", or a smaller eps=; flow integrates fields to a tolerance rtol='
)
_CHOSEN = "flow chooses its steps from the tolerance rtol=; iterate has eps= and method="
_TENSOR = "from_inertia(I, a) makes a body from an inertia tensor and the constrained axis"
_MATRIX = "from_mass_tensor makes a body from a matrix"
_AT_TIMES = "flow(body, x, time) returns the motion at times; exact, the map after n steps"
_FEWER = (
    "for fewer or more points draw the states yourself, as in ax.plot(x[..., 0], x[..., 1], '.')"
)
_AXES = "set it on the axes that plots return, such as ax.set_xlim(0, 1)"
_ON_AXES = "xlim ylim xlabel ylabel grid legend"
_DOTS = 'set it on what is drawn, as in ax.collections[0].set(cmap="magma", alpha=0.5, sizes=[1])'
_ON_LINES = (
    "for other styles draw the states with Matplotlib, as in ax.plot(run.x[..., 0], run.x[..., 1])"
)
_ALL = "it returns all exponents: take the first k, [..., :k]"
_IN_TIME = "pass progress=, a function that returns False when time is over"
_RELATIVE = "flow has one tolerance, rtol=, relative to the largest value of each component so far"

# Names that SciPy, MATLAB, Julia and pynamicalsys have for an argument; the names that it may have
# here; and a sentence if the function has none of them, but has another argument.
_ADVICE: dict[str, tuple[tuple[str, ...], str, str]] = {
    name: (arguments, sentence, other)
    for names, arguments, sentence, other in (
        (
            "dt h epsilon step_size stepsize delta_t first_step max_step maxstep initialstep dtmax",
            ("eps",),
            _CHOSEN,
            "rtol",
        ),
        ("eps steps", (), _CHOSEN, "rtol"),
        ("t time times t_eval tspan saveat ts", ("time",), _SPAN, "steps"),
        ("T", ("time", "period"), _SPAN, "steps"),
        ("t_span t_end t_max tend tf t_final t_stop tmax t0", ("time",), _SPAN, "steps"),
        ("total_time duration", ("time",), _SPAN, "steps"),
        ("dense_output", (), "pass an array of times as time=", "time"),
        ("exact.t exact.time exact.times exact.t_eval", (), _AT_TIMES, ""),
        ("SuslovND.inertia SuslovND.tensor", (), _MATRIX, ""),
        ("max_points max_lines downsample thin", (), _FEWER, "ax"),
        ("atol abstol", (), _RELATIVE, ""),
        ("tol rtol reltol", ("rtol", "tol"), _DIGITS, "method"),
        ("method order integrator solver alg algorithm scheme", ("method",), _CHOSEN, "rtol"),
        ("n N", ("steps", "n"), "J and I have n - 1 entries each", "J"),
        ("n_steps num_steps nsteps iterations max_steps maxiter", ("steps", "n"), "", ""),
        ("x0 y0 u0 z0 X0 omega0 omega x state states initial_state ic", (), _STATES, ""),
        (
            "body field f fun rhs system model",
            (),
            "pass it first, without a name",
            "",
        ),
        ("args p params parameters", (), "parameters belong to the field or body", ""),
        ("events event section condition", ("surface",), "use crossings", "threads"),
        ("terminal", ("most",), "use crossings", "steps"),
        ("burn_in transient_time n_transient Ttr discard", ("transient",), "", ""),
        ("every stride thin sample save_at", ("save_every",), "", ""),
        (
            "n_jobs workers num_threads cores n_workers",
            ("threads",),
            "pass client=, a distributed.Client",
            "client",
        ),
        ("overwrite mode", (), "pass a new name, or delete the folder of the store", "store"),
        (
            "dtype",
            (),
            "states are stored as float64; save_every= and functions= store less",
            "store",
        ),
        ("k n_exponents num_exponents", ("k", "most"), _ALL, "transient"),
        ("timeout time_limit max_time budget", ("time_limit",), _IN_TIME, "progress"),
        (
            "seed rng random_state",
            ("seed",),
            "pass RandomStarts(size, seed=...) as states",
            "steps",
        ),
        ("jac jacobian", (), "derivatives are exact, leave it out", "time"),
        ("value", (), "subtract it: surface=lambda x: x[..., 0] - value", "surface"),
        ("verbose callback", ("progress",), "", ""),
        ("filename file", ("store", "path"), "", ""),
        ("c colour colors", ("color",), _AXES, "ax"),
        ("color", ("color",), "plots have it, as in run.plot(color=...)", "steps"),
        (_ON_AXES, (), _AXES, "ax"),
        ("cmap alpha s size sizes markersize ms", (), _DOTS, "ax"),
        ("lw linewidth ls linestyle label marker", (), _ON_LINES, "ax"),
        ("figsize", (), "pass ax= of plt.subplots(figsize=(6, 4))", "ax"),
        ("axis", ("surface", "components"), "components are always on the last axis of states", ""),
        ("I11", ("I1",), "", ""),
        ("I22", ("I2",), "", ""),
        ("I33", ("I3",), "", ""),
        ("I31", ("I13",), "", ""),
        ("I32", ("I23",), "", ""),
        ("I12 I21", (), f"it is 0 in the adapted basis: {_TENSOR}", "I13"),
        ("I inertia tensor", (), _TENSOR, "I13"),
    )
    for name in names.split()
}


# What a required argument is, for calls without it.
_REQUIRED = {
    "steps": "the number of steps; a run ends at the time eps * steps",
    "eps": "the step size",
    "f": "a function of the state, without a name",
    "H": "a function of the state, without a name",
    "time": "the times of the solution",
    "surface": "a function of states, such as lambda x: x[..., 0] - 1",
    "dimension": 'the number of variables or their names, such as "x v"',
    "period": "an approximate period",
    "periodic_orbit.steps": "the number of steps in a period",
    "store": "the name of a folder, such as 'runs.zarr'",
    "parameters": "the dictionary that to_dict returned",
    "count": "the number of states",
    "a": "the constrained axis, such as [0, 0, 1]",
    "k": "the angular momentum of the rotor",
    "I2": _TENSOR,
    "SuslovND.I": f"the products of inertia; {_MATRIX}",
    "quadratic": "an array (D, D, D); from_function makes a field from its right-hand side",
}

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
    "quadratic linear constant terms": "QuadraticField.of(body), or field.lifted, which has it",
    "lifted": "the field itself, because it is quadratic",
    "jac jacobian Df df Dx eigenvalues eigvals derivative": "(vector_field(body, x + h) - "
    "vector_field(body, x - h)).T / 2e-6 with h = 1e-6 * np.eye(len(x)), the derivative of the "
    "right-hand side, and np.linalg.eigvals of it; suslov_fast.jacobian is that of a step",
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
    whole = f"({', '.join(required[is_method:])})" if len(required) > 1 + is_method else ""
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
                    how = advice(name, known, unnamed, called)
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
                    what = _REQUIRED.get(f"{called}.{name}") or _REQUIRED.get(name)
                    text = f"{called} needs {name}{f', {what}' if what else ''}"
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


def advice(name: str, known: Collection[str], unnamed: int = 0, called: str = "") -> str:
    """Return what to pass in place of a keyword to a function with the `known` keywords.

    Of its `unnamed` arguments the first is a body or a field, and the second the states.
    """
    if name in ("x", "y", "z") and "components" in known:
        return 'pass components, as in plot("x1", "x2")'
    nothing: tuple[tuple[str, ...], str, str] = ((), "", "")
    keys = f"{called}.{name}", f"{called}.", name, name.lower()
    arguments, sentence, other = next((_ADVICE[key] for key in keys if key in _ADVICE), nothing)
    if sentence == _STATES and unnamed != 2:
        sentence = ""
    found = [argument for argument in arguments if argument in known]
    if not found and sentence and (not other or other in known):
        return sentence
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
