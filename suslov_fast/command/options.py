"""The options of the command `suslov-fast`: a parser for each subcommand, and suggestions."""

import argparse
import os
import re
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from fractions import Fraction
from pathlib import Path
from typing import Any, NoReturn

import suslov_fast as sf

Command = Callable[[argparse.Namespace], int | None]

_ABOUT = (
    "Iterate the discrete Suslov problem and Kahan maps of quadratic fields; examine the results."
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
_JSON = "a body or a field, saved by json.dump(body.to_dict(), file); - is standard input"
_STATES = "array of numpy.save with a state in each row; - is standard input"
# What Python calls an option of the command, or other packages do.
_OTHERS = {
    "dt h": "eps",
    "x0 y0 u0": "omega0",
    "n-steps num-steps nsteps t t-span t-end t-max tmax tend tf time duration": "steps",
    "order integrator solver": "method",
    "max-step step stepsize step-size delta-t": "eps",
    "m count size orbits": "trajectories",
    "c x y columns variables": "components",
    "d": "degree",
    "timeout limit": "time-limit",
    "workers jobs j cores nproc": "threads",
    "f file out": "output",
    "field system config model": "body",
    "overwrite": "force",
    "format": "json",
    "iterate simulate integrate": "run",
    "draw figure": "plot",
    "show summary status": "info",
    "compile": "warm-up",
    "gui serve": "explore",
    "list": "help",
}
_OTHERS = {word: name for words, name in _OTHERS.items() for word in words.split()}
# What --steps has in place of times.
_SPAN = "a run ends at the time eps * steps"
_TOLERANCE = "a map has steps, --eps and --steps: call suslov_fast.flow in Python for a tolerance"
_SPANS = {"t", "t-span", "t-end", "t-max", "tmax", "tend", "tf", "time", "duration"}
# What to do with a file that stands where a command belongs.
_FOR_FILE = {
    ".json": "write suslov-fast run --body {} --eps 0.01",
    ".npz": "write suslov-fast info {}",
    ".zarr": "write suslov-fast info {}",
}
# What no option does.
_WITHOUT_OPTION = {
    "tol rtol atol reltol abstol tolerance": _TOLERANCE,
    "section surface event events": "call suslov_fast.crossings in Python",
    "n": "did you mean --steps, or --trajectories?",
    "plot": "write the run, -o run.npz, and then suslov-fast plot run.npz -o run.png",
    "set param params parameter parameters p": "parameters are part of the file of --body: write "
    "it anew, with QuadraticField.from_function(f, names, rho=20) for example",
    "timeout": "a run into FILE.zarr may be interrupted, and the same command continues it",
    "v verbose q quiet log-level progress": "progress is shown on a terminal, and once a minute "
    "in a log",
}
_FORCE = "replace an existing file"


class _Parser(argparse.ArgumentParser):
    """A parser whose errors suggest the option or the command that is closest."""

    def error(self, message: str) -> NoReturn:
        unknown = re.search(
            r"unrecognized arguments: (-*[^\s=]+)|invalid choice: '([^']*)'", message
        )
        names = {}
        for action in self._actions:
            for name in (*action.option_strings, *map(str, action.choices or ())):
                names[name.strip("-").lower()] = name
        given = (unknown[1] or unknown[2]).lower() if unknown else ""
        word = given.strip("-")
        if given == word and unknown and unknown[1]:  # a word without an option
            word = "body" if word.endswith(".json") else "components" if "," in word else "file"
        is_number = unknown and unknown[1] and re.match(r"-?\.?\d", given)
        close = [] if is_number else get_close_matches(_OTHERS.get(word, word), names, 1)
        advice = f"did you mean {names[close[0]]}?" if close else ""
        advice += f" {_SPAN}" if close and word in _SPANS else ""
        for words, how in {} if close else _WITHOUT_OPTION.items():
            advice = how if word in words.split() else advice
        advice = "write lists with commas, such as --omega0 1,0.5" if is_number else advice
        if unknown and unknown[1] and given != word and not advice and self.prog.endswith("run"):
            advice = f"if {word} is a parameter of the field, it is part of the file of --body"
        if unknown and unknown[2] and not close and get_close_matches(word, dir(sf), 1):
            [function] = get_close_matches(word, dir(sf), 1)
            advice = f"call suslov_fast.{function} in Python"
        if unknown and unknown[2] and (ending := os.path.splitext(unknown[2])[1]) in _FOR_FILE:
            advice = _FOR_FILE[ending].format(unknown[2])
        if message.endswith(" are required: -o/--output"):
            advice = "it is the figure, such as -o run.png"
        super().error(f"{message}; {advice}" if advice else message)


def parsed(words: Sequence[str], commands: Sequence[Command]) -> argparse.Namespace:
    """Return the options of a command line, with the `function` of the command that it names.

    The docstrings of these functions are the help.
    """
    parser = _Parser("suslov-fast", description=_ABOUT, epilog=_EXAMPLE)
    parser.add_argument("-V", "--version", action="version", version=f"%(prog)s {sf.__version__}")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
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
    if not words:
        parser.error(f"a command is required, such as run: {', '.join(subparsers.choices)}")
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
    return Path(os.path.expanduser(text))


def reading(path: Path) -> str:
    """Return the expression of Python that reads a body."""
    return f"body_from_dict(json.loads(Path({str(path)!r}).read_bytes()))"


def writing(source: str, name: str) -> str:
    """Return the command that writes the value of an expression of Python as a body."""
    code = f"Path({name!r}).write_text(json.dumps({source}.to_dict()))"
    imports = "import json; from pathlib import Path; from suslov_fast import *"
    return f'python -c "{imports}; {code}"'


def check_method(options: argparse.Namespace, body: Any, eps: Any) -> None:
    """Raise an error if a body lacks the method; for one of fields, say how to make its field."""
    from ..maps import map_of

    method = options.method
    try:
        map_of(body, method)
    except ValueError as error:
        text, advice, methods = str(error).partition(": QuadraticField.of(body) has ")
        if not advice:
            raise
        text += f"; the field of this body has {methods}"
        if repr(method) not in methods:
            raise ValueError(text) from None
        source = reading(options.body) if options.body else repr(body)
        make = writing(f"QuadraticField.of({source})", "field.json")
        then = f"suslov-fast run --body field.json --eps {eps} --method {method}"
        raise ValueError(f"{text}: {make}, and then {then}") from None


def names_or_indices(text: str) -> list[str | int]:
    """Return the components in a text such as x,z or 0,2."""
    return [int(part) if part.isdecimal() else part.strip() for part in text.split(",")]


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
        f"system: --figure, --body, or all parameters of a body ({step})"
    )
    add = group.add_mutually_exclusive_group().add_argument
    add(
        "--figure",
        type=integer,
        choices=(1, 2, 3, 4),
        help="body of a figure of the paper (default 2)",
    )
    add("--body", type=path, metavar="FILE.json", help=_JSON)
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
    add = parser.add_argument_group("run").add_argument
    add("--eps", type=fraction, metavar="X", help="step size (default: that of the figure)")
    add("--steps", type=integer, metavar="N", default=1000, help="number of steps (default 1000)")
    methods = "auto (default); of fields order4, order6, order8; in n dimensions gauss, rank2"
    add("--method", default="auto", help=methods)
    add("--threads", type=integer, metavar="N", help="number of threads (default: all)")
    every = "save every K-th state (default: the last one only)"
    add("--save-every", type=integer, metavar="K", help=every)
    add("--attitude", action="store_true", help="compute the orientation as well")
    add("-o", "--output", type=path, metavar="FILE", help="write the run to a .npz or .zarr file")
    add("--force", action="store_true", help=_FORCE)
    add("--json", action="store_true", help="print one JSON object")


def _info(parser: Any) -> None:
    add = parser.add_argument
    add("file", type=path, nargs="+", metavar="FILE", help="a .npz file or a .zarr store of a run")
    add("--json", action="store_true", help="print a JSON object for each file, in one line")


def _plot(parser: Any) -> None:
    add = parser.add_argument
    add("file", type=path, metavar="FILE.npz", help="a file of a run or of crossings")
    which = "two or three components, such as x,z or time,x (default: the first two)"
    add("--components", type=names_or_indices, metavar="X,Y", help=which)
    add("-o", "--output", type=path, metavar="FILE.png", required=True, help="the figure")
    add("--force", action="store_true", help=_FORCE)


def _report(parser: Any) -> None:
    _system(parser, "without --eps it is symbolic")
    add = parser.add_argument
    add(
        "--eps",
        type=fraction,
        metavar="X",
        help="step size, such as 1/3 or 0.1 (default: symbolic)",
    )
    add(
        "--degree",
        type=integer,
        metavar="D",
        default=3,
        help="highest degree of polynomials (default 3)",
    )
    add("--time-limit", type=float, metavar="SECONDS", help="end of the search (default: none)")
    add("--json", action="store_true", help="print one JSON object")


def _pictures(parser: Any) -> None:
    add = parser.add_argument
    add(
        "-o",
        "--output",
        type=path,
        default=Path(),
        metavar="DIR",
        help="folder (default: this one)",
    )
    add("--force", action="store_true", help=_FORCE)


def _explore(parser: Any) -> None:
    add = parser.add_argument
    add("--body", type=path, metavar="FILE.json", help=_JSON)
    add(
        "--port",
        type=integer,
        metavar="N",
        default=0,
        help="port of 127.0.0.1 (default: a free one)",
    )
    add("--no-browser", action="store_true", help="print the address only")


_ADD_OPTIONS: dict[str, Callable[[Any], None]] = {
    "run": _run,
    "info": _info,
    "plot": _plot,
    "report": _report,
    "pictures": _pictures,
    "explore": _explore,
}
