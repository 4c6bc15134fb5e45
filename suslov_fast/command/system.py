"""The body or the field that a command line names: a figure, a file, equations, parameters."""

import argparse
import inspect
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import suslov_fast as sf

from .options import PARAMETERS, number

_EXAMPLE = "x' = x*(1 - y); y' = y*(x - 1), of order 1, and with a ; between two"


def text_of(error: Exception, subject: object = "") -> str:
    """Return the message of an error; it begins with the subject, a file or an option."""
    text = str(error) or type(error).__name__
    if isinstance(error, OSError) and error.strerror:
        subject, text = error.filename or subject, error.strerror
    return text if text.startswith(str(subject)) else f"{subject}: {text}"


@contextmanager
def about(subject: object) -> Iterator[None]:
    """Let the messages of errors begin with a file or an option."""
    try:
        yield
    except Exception as error:
        raise ValueError(text_of(error, subject)) from error


def body_and_step(options: argparse.Namespace, needs_step: bool = True) -> tuple[Any, Any]:
    """Return the body or field, and the step size, None if there may be none."""
    parameters = {name: value for name, value in vars(options).items() if name in PARAMETERS}
    is_given = options.figure or options.body or options.equations is not None
    if parameters and is_given:
        others = "--figure, --body or --equations"
        options.usage_error(f"argument --{min(parameters)}: not allowed with {others}")
    if not parameters and (options.figure or not is_given):
        body, eps = sf.Suslov3D.figure(options.figure or 2)
        return body, eps if options.eps is None and needs_step else options.eps
    in_3d = sf.SuslovGyrostat if "k" in parameters else sf.Suslov3D
    kind: Any = sf.SuslovND if {"J", "I"} & parameters.keys() else in_3d
    signature = {} if is_given else inspect.signature(kind).parameters
    required = [
        name for name, parameter in signature.items() if parameter.default is parameter.empty
    ]
    given = body_of(options)
    if isinstance(given, sf.Field) and needs_step:
        options.usage_error("a Field has a motion, and no map: add --time T")
    required += ["eps"] * needs_step
    missing = [f"--{name}" for name in required if getattr(options, name, None) is None]
    if missing:
        how = "; --eps is the step size, such as --eps 0.01" if "--eps" in missing else ""
        options.usage_error(f"the following arguments are required: {', '.join(missing)}{how}")
    if foreign := parameters.keys() - signature.keys():
        options.usage_error(f"argument --{min(foreign)}: not allowed with --J and --I")
    return given or kind(**parameters), options.eps


def body_of(options: argparse.Namespace) -> Any:
    """Return the body or field in a JSON file or of equations, or None if neither is given."""
    if options.body:
        return _in_file(options.body)
    return None if options.equations is None else _of_equations(options.equations)


def _in_file(path: Path) -> Any:
    with about(path):
        try:
            parameters = json.loads(path.read_bytes())
        except (ValueError, RecursionError) as error:
            raise ValueError(f"not the JSON text of body.to_dict(): {error}") from error
        return sf.body_from_dict(parameters)


def _of_equations(text: str) -> Any:
    """Return the field of a text such as x' = a*x - x*y; y' = x*y - y; a = 2.

    It is a `QuadraticField` where the right-hand sides are polynomials of degree 2 at most.
    """
    equations: dict[str, str] = {}
    parameters: dict[str, float] = {}
    for part in filter(str.strip, re.split("[;\n]", text)):
        name, sign, value = (piece.strip() for piece in part.partition("="))
        name = re.sub(r"^d(\w+)/dt$", r"\1'", name)
        if not (sign and name) or "''" in name or re.search("[^<>=!]=[^=]", value):
            raise ValueError(f"--equations must be like {_EXAMPLE}, not {part.strip()!r}")
        own = name.rstrip("' ")
        if own in equations or own in parameters:
            raise ValueError(f"--equations: {own} has two lines: write one")
        if name.endswith("'"):
            equations[name[:-1].rstrip()] = value
        else:
            try:
                parameters[name] = number(value)
            except argparse.ArgumentTypeError as error:
                how = f"write {name}' = {value} if it is an equation"
                raise ValueError(f"--equations: {name} = {value}: {error}; {how}") from None
    if not equations:
        raise ValueError(f"--equations must be like {_EXAMPLE}, not {text!r}")
    names = list(equations)
    described = {"names": names, "equations": [*equations.values()], "parameters": parameters}
    with about("--equations"):
        field = sf.body_from_dict({"body": "Field", **described})
    from ..bodies.fields.texts import values_of

    def quadratic(x: Any) -> Any:
        known = dict(zip(names, x, strict=True)) | parameters
        return tuple(values_of(enumerate(equations.values()), known, _no_function).values())

    try:
        return sf.QuadraticField.from_function(quadratic, names)
    except (TypeError, ValueError):
        return field


def _no_function(name: str, _: Any) -> Any:
    raise ValueError(f"{name} is no polynomial")
