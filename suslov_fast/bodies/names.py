"""Names of the variables and of the parameters of fields."""

import re
from collections.abc import Collection
from keyword import iskeyword
from typing import Any

import numpy as np

from ..checks import integer, page, short, wrong

TIME = {"t", "time"}
# Names of parameters that would stand for two things, and for what else.
_TAKEN = {
    **dict.fromkeys(TIME, "time, which fields do not have"),
    "dimension": "an argument of from_function and from_hamiltonian",
    "method": "an argument of sel",
    "eps": "the step size",
    "x": "the name of the states",
    **dict.fromkeys(("quadratic", "linear", "constant"), "the coefficients of a field"),
    **dict.fromkeys(
        (
            *("n", "final", "status", "failed_at", "attitude", "trajectory", "space"),
            *("component", "component_j", "component_k"),
            *("crossing", "before", "after", "fraction"),
        ),
        "a name in datasets of runs and crossings",
    ),
}
_NUMBERED = re.compile(r"x[1-9]\d*")
# A letter of any alphabet or the name of a Greek one, and its index, of which n is a part.
_SYMBOL = re.compile(
    r"(?P<greek>alpha|beta|gamma|delta|epsilon|zeta|eta|theta|iota|kappa|lambda|mu|nu|xi|pi|rho|"
    r"sigma|tau|upsilon|phi|chi|psi|omega|Gamma|Delta|Theta|Lambda|Xi|Pi|Sigma|Upsilon|Phi|Psi|"
    r"Omega)?(?(greek)|(?P<letter>[^\W\d_]))_?(?P<index>\d*n?)"
)
_AXIS = re.compile(r"batch_\d+|linear_\d+|quadratic_\d+_\d+")


def labels(D: int) -> tuple[str, ...]:
    """Return the names of variables to which nobody gave others."""
    return tuple(f"x{i}" for i in range(1, D + 1))


def latex(name: str) -> str:
    r"""Return `\Omega_{1}` for "Omega1"; "" for a name that is no letter with an index."""
    if not (found := _SYMBOL.fullmatch(name)):
        return ""
    letter = rf"\{found['greek']}" if found["greek"] else found["letter"]
    return f"{letter}_{{{found['index']}}}" if found["index"] else letter


def variables(argument: str, given: Any, D: int | None = None) -> tuple[str, ...]:
    """Return the names of variables: those given, or x1, ..., xD for a number or None.

    Names are a text, separated by spaces or commas, or a sequence; D of them, if D is known.
    """
    if given is None and D:
        return labels(D)
    if isinstance(given, str):
        names = re.split(r"[\s,]+", given.strip(" ,\t\n"))
    elif isinstance(given, (list, tuple)) or np.ndim(given) == 1:
        names = [*given]
    elif D is None:
        return labels(integer(argument, given, 1, 'an integer from 1, or names: "u v w"', 2**62))
    else:
        raise wrong(argument, 'names, such as "u v w"', short(given), TypeError)
    if not all(isinstance(name, str) for name in names):
        kind = "an integer, or names of variables" if D is None else "names of variables"
        raise wrong(argument, f"{kind}, such as 'u v w'", short(given), TypeError)
    names = [str(name) for name in names if name]
    if not names:
        raise wrong(argument, "the name of at least one variable", short(given))
    if D is not None and len(names) != D:
        raise wrong(
            argument, f"one name for each of {D} variables", f"{len(names)}: {short(given)}"
        )
    for i, name in enumerate(names):
        if reason := _refused(name, i, names):
            raise ValueError(f"{argument}: the variable {name!r} {reason}")
    return tuple(names)


def _refused(name: str, i: int, names: list[str]) -> str:
    """Return why a name cannot be that of variable i; nothing if it can."""
    if iskeyword(name):
        return f"has a name that is a keyword of Python: call it {name}_, for example"
    if not name.isidentifier():
        return "has no name that Python can use: letters, digits and _, first a letter"
    if name in names[:i]:
        return "stands twice: give each variable its own name"
    if name == "eps":
        return "has the name of the step size: call it eps_, for example"
    if _NUMBERED.fullmatch(name) and name != f"x{i + 1}":
        return f"stands at place {i + 1}: {name} is the name of variable {name[1:]}"
    return ""


def clash(name: str, names: Collection[str] = (), maker: str = "") -> str:
    """Return with what a parameter of a field with these variables clashes, "" with nothing."""
    if name == "K" and maker.endswith("from_hamiltonian"):
        return "the matrix of from_hamiltonian"
    if name in names:
        return "the variable of that name"
    if _AXIS.fullmatch(name):
        return "a name in datasets of runs and crossings"
    return _TAKEN.get(name, "")


def free(name: str, names: Collection[str] = (), maker: str = "") -> str:
    """Return a name for a parameter that nothing else has: its own, or one with an underscore."""
    while iskeyword(name) or clash(name, names, maker):
        name += "_"
    return name


def check_parameter(name: str, names: Collection[str]) -> None:
    """Raise ValueError if a parameter of a field with these variables cannot have a name."""
    if not name.isidentifier() or iskeyword(name):
        raise ValueError(
            f"parameters: {name!r} is no name in Python: rename it, to rho for example"
        )
    if name in TIME:
        how = f"fields have no time; to make it a variable see {page('howto/cubic')}"
        raise ValueError(f"parameters: {name!r}: {how}")
    if what := clash(name, names):
        how = f"rename it, to {free(name, names)} for example"
        raise ValueError(f"parameters: {name!r} clashes with {what}: {how}")
