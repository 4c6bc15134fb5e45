"""The options of the command `suslov-fast`: a parser for each subcommand, and suggestions."""

import argparse
import os
import re
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, NoReturn

import suslov_fast as sf

from ..words import answer

Command = Callable[[argparse.Namespace], int | None]

_ABOUT = (
    "Kahan maps of the Suslov problem and of quadratic ODEs, and solutions of any ODEs, in batches."
)
_EXAMPLE = "Example: suslov-fast run --figure 4 --steps 500 --save-every 100 -o run.npz"
PARAMETERS = {
    **dict.fromkeys(("I1", "I2"), "moment of inertia, positive"),
    **dict.fromkeys(("I13", "I23"), "product of inertia"),
    "I3": "moment of inertia about the constrained axis; only drawings use it",
    "k": "angular momentum of a rotor along the constrained axis",
    "J": "n - 1 numbers J_i = I_ii + I_nn of a body in n dimensions, positive",
    "I": "n - 1 products of inertia I_in of a body in n dimensions",
}
_JSON = "a body or a field, saved by json.dump(body.to_dict(), file)"
_EQUATIONS = "such as \"x' = a*x - x*y; y' = x*y - y; a = 2\"; names without ' are parameters"
_STATES = "array of numpy.save with a state in each row"
_FORCE = "replace an existing file"


class _Parser(argparse.ArgumentParser):
    """A parser whose errors suggest the option or the command that is closest."""

    def error(self, message: str) -> NoReturn:
        names = {}
        for action in self._actions:
            for name in (*action.option_strings, *map(str, action.choices or ())):
                names[name.strip("-").replace("-", "_")] = name
        options = r" --?([^\s=]+)" if "unrecognized" in message else "invalid choice: '([^']*)'"
        for word in re.findall(options, message):
            plain = word.replace("-", "_")
            if (how := answer(plain, names, "command")).startswith("--"):
                message += f"; for {word} use {how}"
            elif here := names.get(how) or names.get(answer(plain, names, "command", "words")):
                message += f"; for {word} did you mean {here}?"
            elif (here := answer(plain, dir(sf), "module", "words")) in dir(sf):
                message += f"; call suslov_fast.{here} in Python"
        if "body" in names and re.search(r"arguments: [\d.,-]+$", message):
            message += "; a list is written with commas, --omega0 1,0.5"
        elif "body" in names and re.search("arguments: [^-]|mean --(body|equations)", message):
            message += "; equations are an option: --equations \"x' = x*(1 - y); y' = y*(x - 1)\""
            message += ", with a state --omega0 2,1" * ("omega0" in names)
        elif "output" in names and "--format" in message:
            message += "; the ending of a file is its format: suslov-fast plot RUN.npz -o RUN.pdf"
        elif self.prog.endswith(" figures"):
            message += "; figures draws all four of the paper into the folder -o"
        elif self.prog.endswith(" plot"):
            message += "; the call is suslov-fast plot RUN.npz x z -o RUN.png"
        super().error(message)


def parsed(words: Sequence[str], commands: Sequence[Command]) -> argparse.Namespace:
    """Return the options of a command line, with the `function` of the command that it names.

    The docstrings of these functions are the help.
    """
    parser = _Parser("suslov-fast", description=_ABOUT, epilog=_EXAMPLE)
    parser.add_argument("-V", "--version", action="version", version=f"%(prog)s {sf.__version__}")
    parser.set_defaults(function=lambda _: parser.print_help(), usage_error=parser.error)
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND")
    for function in commands:
        text = function.__doc__ or ""
        keywords: dict[str, Any] = {"help": text.partition(".")[0], "description": text}
        name = function.__name__.replace("_", "-")
        subparser = subparsers.add_parser(name, allow_abbrev=False, **keywords)
        subparser.set_defaults(function=function, usage_error=subparser.error)
        if name in _ADD_OPTIONS:
            _ADD_OPTIONS[name](subparser)
    # A blank, because argparse takes a word such as -1,.5 for an option.
    words = [f" {word}" if re.match(r"-[\d.]", word) else word for word in words]
    if words and words[0].startswith("--") and words[0] not in ("--help", "--version"):
        after = next((word for word in words[1:] if word in subparsers.choices), "COMMAND")
        parser.error(f"{words[0]} comes after the command: suslov-fast {after} {words[0]}")
    options, unknown = parser.parse_known_args(words)
    if unknown:
        options.usage_error(f"unrecognized arguments: {' '.join(unknown)}")
    return options


def fraction(text: str) -> Fraction:
    """Return the number in a text such as 0.1, 1/3 or 1e6, exactly."""
    from ..bodies.fields.polynomials import from_text

    try:
        return from_text(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number, such as 0.1 or 1/3") from None


def number(text: str) -> float:
    """Return the number in a text such as 0.1, 1/3 or 1e6."""
    try:
        return float(fraction(text))
    except OverflowError:
        raise argparse.ArgumentTypeError(f"{text!r} is beyond 1.8e308") from None


def integer(text: str) -> int:
    """Return the integer in a text such as 1000 or 1e3."""
    from ..bodies.fields.polynomials import from_text

    try:
        if (value := from_text(text)).denominator == 1:
            return int(value)
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"{text!r} is not an integer, such as 1000 or 1e6")


def path(text: str) -> Path:
    """Return the name of a file or folder; a shell leaves the ~ in --output=~/run.npz as it is."""
    if not text:
        raise argparse.ArgumentTypeError("the name of a file is empty")
    return Path(os.path.expanduser(text))


def name_or_index(text: str) -> str | int:
    """Return a component, by its name or its index."""
    return int(text) if text.isdecimal() else text.strip()


def numbers(text: str) -> list[float]:
    """Return the numbers in a text such as 1,0.5."""
    try:
        return [float(number) for number in text.split(",")]
    except ValueError:
        how = "write numbers with commas, such as 1,0.5"
        raise argparse.ArgumentTypeError(f"{text!r} is not a list of numbers: {how}") from None


def _system(parser: Any, step: str) -> None:
    """Add the options that say which system, in a group; `step` says when --eps may be missing."""
    group = parser.add_argument_group(
        f"system: --figure, --body, --equations, or all parameters of a body ({step})"
    )
    add = group.add_mutually_exclusive_group().add_argument
    of_paper = "body of a figure of the paper (default 2)"
    add("--figure", type=integer, choices=(1, 2, 3, 4), help=of_paper)
    add("--body", type=path, metavar="FILE.json", help=_JSON)
    add("--equations", metavar="TEXT", help=_EQUATIONS)
    for name, text in PARAMETERS.items():
        kind, form = (numbers, "X,...") if name in "JI" else (float, "X")
        keywords = {"metavar": form, "default": argparse.SUPPRESS, "help": text}
        group.add_argument(f"--{name}", type=kind, **keywords)


def _run(parser: Any) -> None:
    """Add the options of `run`, in groups."""
    _system(parser, "then --eps is required")
    group = parser.add_argument_group("initial states: random, or given")
    add = group.add_mutually_exclusive_group().add_argument
    many = "number of random states (default 65536)"
    add("--trajectories", type=integer, metavar="N", default=65_536, help=many)
    add("--omega0", type=numbers, action="append", metavar="X,...", help="a state; repeat for more")
    add("--initial", type=path, metavar="FILE.npy", help=_STATES)
    add = group.add_argument
    add("--extent", type=float, metavar="X", help="random states lie in [-X, X) (default 2)")
    of_each = "a number, or one for each component"
    add("--low", type=numbers, metavar="X,...", help=f"random states lie above this: {of_each}")
    add("--high", type=numbers, metavar="X,...", help=f"random states lie below this: {of_each}")
    add("--seed", type=integer, metavar="N", help="seed of the random states (default 0)")
    add = parser.add_argument_group("steps of the map").add_argument
    add("--eps", type=number, metavar="X", help="step size (default: that of the figure)")
    add("--steps", type=integer, metavar="N", help="number of steps (default 1000)")
    methods = "auto (default); of fields order4, order6, order8; in n dimensions gauss"
    add("--method", metavar="NAME", help=methods)
    every = "save every K-th state (default: the last one only)"
    add("--save-every", type=integer, metavar="K", help=every)
    add("--attitude", action="store_true", help="compute the orientation as well")
    add = parser.add_argument_group("motion, to a tolerance").add_argument
    add("--time", type=float, metavar="T", help="the motion from 0 to T, in place of the map")
    add("--points", type=integer, metavar="N", help="number of times from 0 to T (default 101)")
    add("--rtol", type=float, metavar="X", help="relative tolerance (default 1e-9)")
    add("--atol", type=numbers, metavar="X,...", help="absolute tolerance, or of each component")
    add = parser.add_argument_group("run").add_argument
    add("--threads", type=integer, metavar="N", help="number of threads (default: all)")
    saved = "write the last states, or those of --save-every or --time, to a .npz or .zarr file"
    add("-o", "--output", type=path, metavar="FILE", help=saved)
    add("--force", action="store_true", help=_FORCE)


def _info(parser: Any) -> None:
    about = "a .npz file or a .zarr store of a run"
    parser.add_argument("file", type=path, nargs="+", metavar="FILE", help=about)


def _plot(parser: Any) -> None:
    add = parser.add_argument
    add("file", type=path, metavar="FILE.npz", help="a file of a run, of crossings or of a motion")
    which = "two or three components, such as x z or time x (default: the first two)"
    add("names", type=name_or_index, nargs="*", metavar="NAME", help=which)
    add("-o", "--output", type=path, metavar="FILE.png", required=True, help="the figure")
    add("--force", action="store_true", help=_FORCE)


def _report(parser: Any) -> None:
    _system(parser, "without --eps it is symbolic")
    add = parser.add_argument
    step = "step size, such as 1/3 or 0.1 (default: symbolic)"
    add("--eps", type=fraction, metavar="X", help=step)
    highest = "highest degree of polynomials (default 3)"
    add("--degree", type=integer, metavar="D", default=3, help=highest)
    add("--time-limit", type=float, metavar="SECONDS", help="end of the search (default: none)")
    add("--json", action="store_true", help="print one JSON object")


def _figures(parser: Any) -> None:
    add, folder = parser.add_argument, "folder (default: this one)"
    add("-o", "--output", type=path, default=Path(), metavar="DIR", help=folder)
    add("--force", action="store_true", help=_FORCE)


def _explore(parser: Any) -> None:
    add = parser.add_mutually_exclusive_group().add_argument
    add("--body", type=path, metavar="FILE.json", help=_JSON)
    add("--equations", metavar="TEXT", help=_EQUATIONS)
    add, port = parser.add_argument, "port of 127.0.0.1 (default: a free one)"
    add("--port", type=integer, metavar="N", default=0, help=port)
    add("--no-browser", action="store_true", help="print the address only")


_ADD_OPTIONS: dict[str, Callable[[Any], None]] = {
    add.__name__.strip("_"): add for add in (_run, _info, _plot, _report, _figures, _explore)
}
