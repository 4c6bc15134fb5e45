"""Names of the variables and parameters of fields and maps: checks, and their LaTeX."""

import re
import unicodedata
from collections.abc import Collection, Sequence
from keyword import iskeyword
from typing import Any

import numpy as np

from ..checks import arguments_of, integer, short, wrong
from .layout import TIME as TIME, Layout, layout_of, unpaired, with_complex, without_suffix
from .tolerances import LONGEST_NAME, MOST_VARIABLES

OF_TIME = "f(t, y) or f(y, t) takes the time, first or second, and t has no value or default"
# Names that a parameter cannot have, and what they stand for.
_TAKEN = {
    **dict.fromkeys(TIME, "time, which is a variable"),
    "method": "an argument of sel",
    **dict.fromkeys(("x", "states"), "the name of the states"),
    **dict.fromkeys(
        (
            *("before", "component", "count", "end", "event", "final", "space", "status"),
            *("kind", "steps", "trajectory", "which"),
        ),
        "a name in datasets",
    ),
}
# Further names that a parameter cannot have if maps are iterated.
_OF_MAPS = {
    "eps": "the step size",
    **dict.fromkeys(
        ("n", "failed_at", "first_pole", "attitude", "after", "fraction"),
        "a name in datasets of runs and crossings",
    ),
}
# A letter, or the name of a Greek letter, and an index: digits, then n for bodies in n dimensions.
_SYMBOL = re.compile(
    r"(?P<greek>alpha|beta|gamma|delta|epsilon|zeta|eta|theta|iota|kappa|lambda|mu|nu|xi|pi|rho|"
    r"sigma|tau|upsilon|phi|chi|psi|omega|Gamma|Delta|Theta|Lambda|Xi|Pi|Sigma|Upsilon|Phi|Psi|"
    r"Omega)?(?(greek)|(?P<letter>[^\W\d_]))_?(?P<index>\d*n?)"
)
_WITH_COORDINATE = re.compile(r"([pqv])_?([a-z])")  # such as px, a momentum
_AXIS = re.compile(r"batch_\d+")


def labels(D: int) -> tuple[str, ...]:
    """Return the default names of variables: x1, ..., xD."""
    return tuple(f"x{i}" for i in range(1, D + 1))


def latex(name: str) -> str:
    r"""Return `\Omega_{1}` for "Omega1", `p_{x}` for "px"; "" for a name without an index."""
    if match := _WITH_COORDINATE.fullmatch(name):
        return f"{match[1]}_{{{match[2]}}}"
    if not (match := _SYMBOL.fullmatch(name)):
        return ""
    letter = rf"\{match['greek']}" if match["greek"] else match["letter"]
    return f"{letter}_{{{match['index']}}}" if match["index"] else letter


def variables(given: Any, D: int | None = None) -> tuple[str, ...]:
    """Return the checked names of variables; x1, ..., xD if only their number is known."""
    if given is None and D:
        return labels(D)
    if isinstance(given, str):
        names = re.split(r"[\s,]+", given.strip(" ,\t\n"))
    elif isinstance(given, (list, tuple)) or np.ndim(given) == 1:
        names = [str(each) if hasattr(each, "free_symbols") else each for each in given]
    elif D is None:
        expected = f'an integer from 1 to {MOST_VARIABLES}, or names: "u v w"'
        return labels(integer("names", given, 1, expected, MOST_VARIABLES))
    else:
        raise wrong("names", 'names, such as "u v w"', short(given), TypeError)
    if not all(isinstance(name, str) for name in names):
        raise wrong("names", 'names of variables, such as "u v w"', short(given), TypeError)
    names = [str(name) for name in names if name]
    if not names:
        raise wrong("names", 'the names of variables, as in Field(f, "x v")', short(given))
    if D is not None and len(names) != D:
        raise wrong("names", f"one name for each of {D} variables", f"{len(names)}: {short(given)}")
    if len(names) > MOST_VARIABLES:
        raise wrong("names", f"at most {MOST_VARIABLES} names", f"{len(names)}")
    before: set[str] = set()
    for name in names:
        reason = _refused(name)
        if name in before:
            reason = "appears twice: give each variable its own name"
        before.add(name)
        if reason:
            raise ValueError(f"names: the variable {short(name)} {reason}")
    if name := unpaired(names):
        raise ValueError(f"names: {name} must be in a pair, z.real z.imag")
    return tuple(names)


def laid_out(
    f: Any, names: Any, complex: Any, has_time: bool, parameters: Any
) -> tuple[Layout, dict[str, Any]]:
    """Return the layout of variables, of which `complex` names some, and the parameters of f.

    If f has an argument `complex`, the value is a parameter of f instead.
    """
    names = variables(names)
    if complex is not False and "complex" in arguments_of(f):
        parameters, complex = {**parameters, "complex": complex}, False
    if complex is not False:
        names = with_complex(names, names if complex is True else variables(complex))
    return with_time(names, has_time), parameters


def with_time(parts: tuple[str, ...], has_time: bool) -> Layout:
    """Return the layout of parts, and of a hidden time if a function takes it."""
    if has_time and (taken := [name for name in parts if name in TIME]):
        how = "leave it out, or write f as a function of the state alone"
        raise ValueError(f"names: {taken[0]!r} is the time, which f takes beside the state: {how}")
    return layout_of(parts, has_time)


def _refused(name: str) -> str:
    """Return why a variable or parameter cannot have this name; "" if it can."""
    if len(name) > LONGEST_NAME:
        return f"is longer than {LONGEST_NAME} characters"
    name = without_suffix(name)  # parts of complex variables
    plain = unicodedata.normalize("NFKC", name)  # as Python reads it in source text
    if plain != name and plain.isidentifier():
        return f"is {plain!r} to Python, which normalises names: pass that"
    if not name.isidentifier() or iskeyword(name):
        return "is no name in Python: use letters, digits and _, and begin with a letter"
    return ""


def check_order(names: Sequence[str]) -> None:
    """Raise ValueError for the order "x px y py": all coordinates must come first."""
    q, p = names[::2], names[1::2]
    if len(q) > 1 and all(
        b in (f"p{a}", f"p_{a}") or (a[0] == "q" and b == f"p{a[1:]}")
        for a, b in zip(q, p, strict=True)
    ):
        right, given = " ".join([*q, *p]), " ".join(names)
        raise ValueError(
            "names: all coordinates come first, then all momenta, here and in the state of H: "
            f"{right!r}, not {given!r}; for another order pass K"
        )


def check_parameter(name: str, names: Sequence[str]) -> None:
    """Raise ValueError if a parameter cannot have this name in a field with variables `names`."""
    if name in TIME:
        raise ValueError(f"parameters must be constants, not {name!r}: {OF_TIME}")
    if reason := _refused(name):
        raise ValueError(f"parameters: {short(name)} {reason}")
    what = "a name in datasets" if _AXIS.fullmatch(name) else _TAKEN.get(name, "")
    if what := "the variable of that name" if name in names else what:
        how = f"rename it, to {name}_ for example"
        raise ValueError(f"parameters: {name!r} clashes with {what}: {how}")


def check_for_map(variables: Sequence[str], parameters: Collection[str]) -> None:
    """Raise ValueError if a variable or parameter has a name with another meaning in runs."""
    for name in (*(each for each in variables if each == "eps"), *parameters):
        if what := _OF_MAPS.get(name):
            how = f"make it again with another name, {name}_ for example"
            raise ValueError(f"system: {name!r} clashes with {what}: {how}")
