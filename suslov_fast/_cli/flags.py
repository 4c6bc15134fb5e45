"""Options of the command: each is declared once and shared by subcommands.

This module has no slow imports, so `--help` and usage errors are fast.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, get_args

from .. import __version__

# Exit statuses; the last two are those of a shell for a process that a signal ends.
FAILURE, USAGE, INTERRUPTED, CLOSED_PIPE = 1, 2, 130, 141
TRAJECTORIES, EXTENT = 65_536, 2.0
# The body of picture 2 is realizable, that of picture 1 is not.
DEFAULT_PICTURE = 2
ENTRIES = "Ixx,Iyy,Izz,Ixy,Ixz,Iyz"


class CommandError(Exception):
    """A message for the user; the exit status is that of the class."""

    status = FAILURE


class UsageError(CommandError):
    status = USAGE


# ------------------------------------------------------------------ values


def _value(expected: str, convert: Callable[[str], Any]) -> Callable[[str], Any]:
    """Return a converter of values, whose errors state what was expected."""

    def read(text: str) -> Any:
        try:
            return convert(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"expected {expected}, got {text!r}") from None

    return read


def _integer(low: int, high: int = 2**62 - 1) -> Callable[[str], int]:
    def convert(text: str) -> int:
        value = int(text) if re.fullmatch(r"[+-]?\d{1,99}", text) else float(text)
        if not (low <= value <= high and value == int(value)):
            raise ValueError
        return int(value)

    most = "below 2**62" if high == 2**62 - 1 else f"at most {high}"
    return _value(f"an integer of at least {low} and {most}", convert)


def _finite_float(text: str) -> float:
    if not math.isfinite(value := float(text)):
        raise ValueError
    return value


def _positive_float(text: str) -> float:
    if (value := _finite_float(text)) <= 0:
        raise ValueError
    return value


def _file(*suffixes: str) -> Callable[[str], Path]:
    def convert(text: str) -> Path:
        if Path(text).suffix.lower() not in suffixes or text.endswith("/"):
            raise ValueError
        return Path(text)

    return _value(f"the name of a {' or '.join(suffixes)} file", convert)


def _split_sweep(text: str) -> tuple[str, float, float, int]:
    name, _, values = text.partition("=")
    low, high, count = values.split(":")
    return name, _finite_float(low), _finite_float(high), _integer(1)(count)


def _read_fraction(text: str) -> Fraction:
    try:
        return Fraction(text)
    except ZeroDivisionError as error:
        raise ValueError from error


def _list_or_table(text: str) -> Any:
    return (_table_file if re.search(r"\.[A-Za-z]\w*$", text) else _list)(text)


_SWEEP = "NAME=LOW:HIGH:COUNT"
_sweep = _value(_SWEEP, _split_sweep)
_number = _value("a finite number", _finite_float)
_positive = _value("a positive number", _positive_float)
_fraction = _value("a number such as 1/3 or 0.25", _read_fraction)
_list = _value(
    "finite numbers separated by commas without spaces",
    lambda text: [*map(_finite_float, text.split(","))],
)
_table_file, _result, _body = _file(".npy", ".csv"), _file(".npz", ".zarr"), _file(".json")


# ------------------------------------------------------------------ options


def _option(help: str, type: Any = None, metavar: str | None = None, **more: Any) -> dict[str, Any]:
    return {"help": help, "type": type, "metavar": metavar, **more}


def _flag(help: str) -> dict[str, Any]:
    return {"help": help, "action": "store_true"}


_repeated = partial(_option, action="append")
# Settings by name; arguments of `iterate` and `ensemble` have the same names there.
SETTINGS: dict[str, dict[str, Any]] = {
    "picture": _option(
        "picture of the paper; parameters given beside it replace its own "
        f"({DEFAULT_PICTURE} if no body is given)",
        choices=tuple("1234"),
    ),
    "body": _option("body or field, as its to_dict() was written; likewise", _body, "FILE.json"),
    "inertia": _option(f"inertia tensor, entries {ENTRIES} or a file", _list_or_table, "TENSOR"),
    "mass_tensor": _option("in n dimensions: I of M = I Omega + Omega I", _table_file, "FILE"),
    "axis": _option("with a tensor: constrained axis, in its basis (last axis)", _list, "A1,..."),
    "eps": _option("step size (that of the picture)", _number),
    "omega0": _repeated("initial state; may be repeated", _list, "OMEGA1,..."),
    "initial": _option("file of initial states, one per row", _table_file, "FILE"),
    "trajectories": _option(f"number of random initial states ({TRAJECTORIES})", _integer(1), "N"),
    "extent": _option(f"range [-EXTENT, EXTENT) of random components ({EXTENT:g})", _positive),
    "seed": _option("seed of the random initial states (0)", _integer(0)),
    "orientation": _option("rotation vector X,Y,Z in degrees, or a file", _list_or_table, "R0"),
    "steps": _option("number of steps (%(default)s)", _integer(0), "N", default=1000),
    "method": _option("method of iterate (%(default)s)", default="auto"),
    "threads": _option("number of threads (all)", _integer(1), "N"),
    "save_every": _option("save every K-th state (only the last)", _integer(1), "K"),
    "attitude": _flag("compute the orientation of the body"),
    "output": _option("output file", Path, "FILE"),
    "force": _flag("replace existing files"),
    "json": _flag("print one JSON object, for programs"),
    "chunk": _option("trajectories computed at a time (a few MB)", _integer(1), "N"),
    "scheduler": _option("address of a Dask scheduler", metavar="ADDRESS"),
    "sweep": _repeated(
        "axis of eps or of a parameter (I13); may be repeated", _sweep, _SWEEP, default=[]
    ),
    "compression": _option("compression of the store", choices=("lz4", "zstd")),
    "reduce": _repeated("store first_integral_drift, ...; may be repeated", metavar="NAME"),
    "verify": _flag("verify the store and recompute damaged data"),
    "degree": _option("largest degree of polynomials (%(default)s)", _integer(1), default=3),
    "time_limit": _option("seconds after which it prints what it found", _number, "SECONDS"),
    "file": _option(".npz or .zarr files", _result, "FILE", nargs="+"),
    "format": _option("format (%(default)s)", choices=("png", "pdf", "svg"), default="png"),
    "dpi": _option("dots per inch (%(default)s)", _integer(1, 2400), "N", default=160),
    "letters": _flag("label the panels (a), (b) ..."),
    "link": _option("link copied from the page", metavar="LINK", nargs="?"),
    "port": _option("port of 127.0.0.1 (a free one)", _integer(0, 65535), default=0),
    "no_browser": _flag("print the address, open no browser"),
}
# Names on the command line other than those of the table with two dashes.
_NAMES = {"output": ["-o", "--output"], "file": ["file"], "link": ["link"]}


class Command(NamedTuple):
    """A subcommand: its function, text, options in groups, and changes of their settings.

    The list of commands shows the first sentence of the text. PARAMETERS are those of all bodies;
    of options joined by | only one may be given.
    """

    function: str
    text: str
    groups: dict[str, str] = {}  # noqa: RUF012  (nobody writes to it)
    changes: dict[str, dict[str, Any]] = {}  # noqa: RUF012


# Options of what is written, and of runs that are larger than memory.
SAVED = "save_every attitude orientation force"
STORE = "chunk scheduler sweep compression reduce verify"
_BODY_OPTIONS = {
    "body (a picture, all parameters, a file or a tensor; tables are .npy or .csv)": (
        "picture|body|inertia|mass_tensor axis PARAMETERS eps"
    )
}
COMMANDS = {
    "run": Command(
        "run_command.summary_of_run",
        "Iterate a batch of trajectories and print a summary. The default is "
        f"{TRAJECTORIES:,} random initial states, the body and step size of the paper's picture "
        f"{DEFAULT_PICTURE}, and 1000 steps. For n = 3, the --mass-tensor of a body with the "
        "inertia tensor T is trace(T)/2 - T.",
        {
            **_BODY_OPTIONS,
            "initial states (random or given)": "trajectories extent seed omega0 initial",
            "run": "steps method threads attitude orientation",
            "output": "output save_every force json",
            "with -o FILE.zarr (written in parts; repeat the command to resume)": STORE,
        },
        {"output": {"type": _result, "help": "write the run to a .npz or .zarr"}},
    ),
    "info": Command(
        "summary.print_summaries",
        "Print a summary of saved runs. FILE was written by `suslov-fast run -o`, "
        "Trajectories.save or ensemble. The drift is the change since state 0, if that was saved.",
        {"": "file json"},
    ),
    "warm-up": Command(
        "warm_up.warm_up",
        "Compile all kernels in advance. The cache on disk then holds the serial and parallel "
        "kernels for every kind of body, and later processes need not compile.",
    ),
    "pictures": Command(
        "pictures.draw_pictures",
        "Draw the paper's four pictures. The gallery of the documentation has scripts of others.",
        {"": "output format dpi letters force"},
        {"output": {"metavar": "DIR", "help": "a folder (this one)", "default": Path()}},
    ),
    "report": Command(
        "report_command.text_of_report",
        "Report what is there of the integrability of a Kahan map. Degrees of iterates and their "
        "growth, first integrals, invariant measures and Darboux polynomials are exact; a decimal "
        "such as 0.1 is 1/10. Needs python-flint.",
        {"": "body eps degree time_limit json"},
        {
            "body": {"required": True, "help": "body or field, as its to_dict() was written"},
            "eps": {"required": True, "help": "step size, as 1/3 or 0.25", "type": _fraction},
        },
    ),
    "animate": Command(
        "pictures.draw_animation",
        "Draw a moving body in space. The picture shows the ellipsoid of inertia, its axes e1 and "
        "e2, and the path of the constrained axis a. By default the body passes from one steady "
        "rotation to the opposite one. FILE ends in .gif, or in .mp4 if ffmpeg is installed.",
        {**_BODY_OPTIONS, "motion": "omega0 orientation steps", "output": "output dpi force"},
        {
            "eps": {"default": 0.05, "help": "step size (%(default)s)"},
            "omega0": {"action": "store", "help": "initial state (near a steady rotation)"},
            "steps": {"default": 440, "type": _integer(1, 10**5)},
            "output": {"required": True, "type": _file(".gif", ".mp4")},
            "dpi": {"default": 100},
        },
    ),
    "explore": Command(
        "pictures.serve",
        "Vary a body, a step size and an initial state on a browser page. The page shows the "
        "orbit, its regime and the body in space, and makes no other network requests. Ctrl-C "
        "ends the server.",
        {"": "link port no_browser"},
    ),
}


def body_classes() -> tuple[Any, ...]:
    """Return the classes of bodies, without fields."""
    from .._engine.arguments import AnyBody

    return get_args(AnyBody)


def flag(name: str) -> str:
    """Return an option in its form on the command line."""
    return f"--{name.replace('_', '-')}"


# ------------------------------------------------------------------ parsing


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(message)


def parse(words: Sequence[str]) -> argparse.Namespace:
    """Read a command line; its attribute `command` is the name of the subcommand."""
    parser = _Parser(
        prog="suslov-fast",
        description="The Hirota-Kimura discretization of the nonholonomic Suslov problem.",
        allow_abbrev=False,
    )
    parser.add_argument("-V", "--version", action="version", version=f"suslov-fast {__version__}")
    title = "commands, each with a --help of its own"
    parsers = parser.add_subparsers(title=title, dest="command", metavar="COMMAND", required=True)
    known: dict[str, list[str]] = {}
    for name, command in COMMANDS.items():
        first = command.text.partition(".")[0]
        settings: Any = {"help": first, "description": command.text, "allow_abbrev": False}
        actions = _fill(parsers.add_parser(name, **settings), command)
        known[name] = ["--help", "-h", *(word for each in actions for word in each.option_strings)]
    words = _with_negative_values(words) or ["--help"]
    if words[0] not in ("-h", "--help", "-V", "--version"):
        _check_names(words, known)
    options, strays = parser.parse_known_args(words)
    if strays:
        numbers = "; numbers of one option are separated by commas, as --omega0 1,2"
        of_option = re.match(r"[-+.\d]", strays[0]) and strays[0] != words[1]
        hint = numbers if of_option else ""
        raise UsageError(f"{words[0]}: expected options, got {strays[0]!r}{hint}")
    return options


def _check_names(words: Sequence[str], known: dict[str, list[str]]) -> None:
    """Raise UsageError for an unknown command or option, before argparse asks for missing ones."""
    command, *others = words
    if command not in known:
        of_option = [name for name in known if command.partition("=")[0] in known[name]]
        hint = _meant(command, [*known, "--help", "--version", "-V"])
        if of_option or command.endswith((".npz", ".zarr")):
            hint = f"; did you mean: suslov-fast {(*of_option, 'info')[0]} {' '.join(words)}"
        raise UsageError(f"expected a command, {', '.join(known)}, got {command}{hint}")
    for word in others:
        name = word.partition("=")[0] if word.startswith("--") else word[:2]
        if re.match("--?[A-Za-z]", word) and name not in known[command]:
            hint = _meant({"--step-size": "--eps"}.get(name, name), known[command])
            hint = hint or f"; suslov-fast {command} --help lists all"
            raise UsageError(f"{command}: expected one of its options, got {name}{hint}")


def _meant(word: str, choices: Iterable[str]) -> str:
    """Return a question for the most similar of several words, if there is one."""
    lower = {choice.lower(): choice for choice in choices}
    close = get_close_matches(word.lower(), lower, 1, 0.65)
    return f"; did you mean {lower[close[0]]}?" if close else ""


def _with_negative_values(words: Sequence[str]) -> list[str]:
    """Join options and negative values, such as -1,0.5, which argparse takes for options."""
    joined: list[str] = []
    for word in words:
        if re.match(r"-[\d.]", word) and joined and re.fullmatch(r"--[\w-]+", joined[-1]):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def _fill(parser: argparse.ArgumentParser, command: Command) -> list[argparse.Action]:
    """Add the arguments of a subcommand, and return them."""
    actions: list[argparse.Action] = []
    for title, words in command.groups.items():
        group: Any = parser.add_argument_group(title) if title else parser
        for word in words.split():
            if word == "PARAMETERS":
                actions += _add_parameters(group)
                continue
            names = word.split("|")
            place = group.add_mutually_exclusive_group() if len(names) > 1 else group
            for name in names:
                settings = {**SETTINGS[name], **command.changes.get(name, {})}
                actions.append(place.add_argument(*_NAMES.get(name, [flag(name)]), **settings))
    return actions


def _add_parameters(group: Any) -> list[argparse.Action]:
    """Add an option for each name of a parameter, a number or a list of numbers."""
    actions = []
    for name in dict.fromkeys(name for kind in body_classes() for name in kind._names()):
        kinds = [kind for kind in body_classes() if name in kind._names()]
        form, read = name.upper(), _positive if name in kinds[0]._positive else _number
        if kinds[0]._axes(name):
            form, read = f"{name}1,...", _list
        meanings = "; ".join(dict.fromkeys(kind._meanings[name] for kind in kinds))
        meanings += f" ({', '.join(kind.__name__ for kind in kinds)})"
        actions.append(group.add_argument(f"--{name}", type=read, metavar=form, help=meanings))
    return actions
