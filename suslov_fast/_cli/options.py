"""Options of the command: each is declared once and shared by subcommands.

This module imports nothing that is slow, so that `--help` and mistakes are answered at once.
"""

from __future__ import annotations

import argparse
import difflib
import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from .. import __version__

FAILURE, USAGE, INTERRUPTED = 1, 2, 130
TRAJECTORIES, EXTENT = 65_536, 2.0
# The body of picture 2 can be made of matter, that of picture 1 cannot.
DEFAULT_PICTURE = 2


class CommandError(Exception):
    """A message for the user, and the exit status."""

    def __init__(self, message: str, status: int = FAILURE) -> None:
        super().__init__(message)
        self.status = status


def usage_error(message: str) -> CommandError:
    """Return the error of a command line that makes no sense."""
    return CommandError(message, USAGE)


# ------------------------------------------------------------------ values


def _reader(expected: str, convert: Callable[[str], Any]) -> Callable[[str], Any]:
    """Return a reader of values, whose ValueErrors say what was expected."""

    def read(text: str) -> Any:
        try:
            return convert(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"expected {expected}, got {text!r}") from None

    return read


def _require(condition: bool) -> None:
    if not condition:
        raise ValueError


def _number(text: str, low: float = -math.inf) -> float:
    value = float(text)
    _require(math.isfinite(value) and value > low)
    return value


def _numbers(text: str) -> list[float]:
    return [_number(part) for part in text.split(",")]


def _numbers_or_file(text: str) -> list[float] | Path:
    return Path(text) if Path(text).suffix.lower() in (".npy", ".csv") else _numbers(text)


def _integer(low: int, below: int = 2**62) -> Callable[[str], int]:
    def convert(text: str) -> int:
        value = int(text) if re.fullmatch(r"[+-]?\d{1,99}", text) else float(text)
        _require(low <= value < below and value == int(value))
        return int(value)

    limit = "2**62" if below == 2**62 else below
    return _reader(f"an integer of at least {low} and below {limit}", convert)


def _result(text: str) -> Path:
    _require(Path(text).suffix.lower() in (".npz", ".nc", ".zarr") and not text.endswith("/"))
    return Path(text)


def _sweep(text: str) -> tuple[str, float, float, int]:
    match = re.fullmatch(r"(\w+)=([^:=]+):([^:=]+):([^:=]+)", text)
    if match is None:
        raise ValueError
    return match[1], _number(match[2]), _number(match[3]), _integer(1)(match[4])


_number_of = _reader("a finite number", _number)
_positive = _reader("a positive number", lambda text: _number(text, 0.0))
_list = _reader("finite numbers separated by commas", _numbers)
_list_or_file = _reader(
    "finite numbers separated by commas or the name of a .npy or .csv file", _numbers_or_file
)
_run_file = _reader("the name of a .npz, .nc or .zarr file", _result)
_picture = _reader("1, 2, 3 or 4", lambda text: ("1", "2", "3", "4").index(text) + 1)


# ------------------------------------------------------------------ options


def _option(help: str, type: Any = None, metavar: str | None = None, **more: Any) -> dict[str, Any]:
    settings = {"help": help, "type": type, "metavar": metavar, **more}
    return {name: value for name, value in settings.items() if value is not None}


def _flag(help: str) -> dict[str, Any]:
    return {"help": help, "action": "store_true"}


# By name. A default is added to the help. What `iterate` or `ensemble` takes has the name that it
# has there.
_O = ("-o", "--output")
OPTIONS: dict[str, dict[str, Any]] = {
    "picture": _option(
        "picture of the paper; parameters beside it replace its own (2)", _picture, "1..4"
    ),
    "inertia": _option(
        "inertia tensor, entries Ixx,Iyy,Izz,Ixy,Ixz,Iyz or a file", _list_or_file, "TENSOR"
    ),
    "mass_tensor": _option("in n dimensions, a file: the I of M = I Omega + Omega I", Path, "FILE"),
    "axis": _option("with a tensor: the forbidden axis, in its basis (the last)", _list, "A1,..."),
    "eps": _option("step size (that of the picture)", _number_of),
    "omega0": _option("a start; may be repeated", _list, "OMEGA1,...", action="append"),
    "initial": _option("starts from a file, one per row", Path, "FILE"),
    "trajectories": _option(f"number of random starts ({TRAJECTORIES})", _integer(1), "N"),
    "extent": _option(f"random components lie in [-EXTENT, EXTENT) ({EXTENT:g})", _positive),
    "seed": _option("seed of the random starts (0)", _integer(0)),
    "orientation": _option(
        "at the start: rotation vector X,Y,Z in degrees, or matrix in a file", _list_or_file, "R0"
    ),
    "steps": _option("number of steps", _integer(0), "N"),
    "method": _option("method of iterate", default="auto"),
    "threads": _option("number of threads (all)", _integer(1), "N"),
    "save_every": _option("keep every K-th state (the last only)", _integer(1), "K"),
    "attitude": _flag("carry the orientation of the body along"),
    "output": _option("where to write it", Path, "FILE", flags=_O),
    "force": _flag("replace files that exist"),
    "json": _flag("print one JSON object, for programs"),
    "chunk": _option("trajectories computed at a time (a few MB)", _integer(1), "N"),
    "scheduler": _option("Dask scheduler whose workers compute", metavar="ADDRESS"),
    "sweep": _option(
        "axis of step sizes (eps) or of a parameter (I13, J2); may be repeated",
        _reader("NAME=LOW:HIGH:COUNT", _sweep),
        "NAME=LOW:HIGH:COUNT",
        action="append",
    ),
    "compression": _option("compress what is written", choices=("lz4", "zstd")),
    "reductions": _option(
        "keep no states but the last, and this: first_integral_drift, omega_max, ...",
        metavar="NAME",
        action="append",
        flags=("--reduce",),
    ),
    "verify": _flag("read what is stored, and compute again what is damaged"),
    "file": _option("a .npz, .nc or .zarr", _run_file, "FILE", flags=("file",)),
    "folder": _option("where to write them (this folder)", Path, "DIR", flags=_O, default=Path()),
    "format": _option("format of the files", choices=("png", "pdf", "svg"), default="png"),
    "dpi": _option("dots per inch", _integer(1), "N"),
    "letters": _flag("write the letters of panels, (a), (b) ..."),
    "link": _option("a link copied from the page", None, "LINK", nargs="?", flags=("link",)),
    "port": _option("port of 127.0.0.1 (a free one)", _integer(0, 2**16), "N", default=0),
    "no_browser": _flag("print the address only"),
}
_PARAMETERS = {
    "I3": "moment of inertia, which the map does not depend on",
    "J": "in n dimensions: I_ii + I_nn",
    "I": "in n dimensions: the couplings I_in",
    "k": "momentum of a rotor along the forbidden axis: a gyrostat",
}


class Command(NamedTuple):
    """A subcommand: module, help, description, options in groups, and changes of their settings."""

    module: str
    help: str
    description: str
    groups: dict[str, str]
    changes: dict[str, dict[str, Any]] = {}  # noqa: RUF012  (nobody writes to it)


# Options of runs that are larger than memory.
STORE = "chunk scheduler sweep compression reductions verify"
_BODY = {
    "body (a picture, all parameters, or a tensor; files are .npy or .csv)": (
        "picture PARAMETERS inertia mass_tensor axis eps"
    )
}
COMMANDS = {
    "run": Command(
        "run",
        "iterate a batch of trajectories and print a summary",
        "Iterate a batch of trajectories of the discrete Suslov problem. With no options: "
        f"{TRAJECTORIES:,} random starts of the paper's picture {DEFAULT_PICTURE}, 1000 steps. A mass "
        "tensor holds second moments of mass: for n = 3 it is trace(T)/2 - T, T the inertia tensor.",
        {
            **_BODY,
            "starts (random ones, or your own)": "trajectories extent seed omega0 initial",
            "run": "steps method threads attitude orientation",
            "output": "output save_every force json",
            "with -o FILE.zarr (computed and written in parts; the same command goes on)": STORE,
        },
        {
            "steps": {"default": 1000},
            "output": {"type": _run_file, "help": "write the run to a .npz, .nc or .zarr"},
        },
    ),
    "info": Command(
        "others",
        "print what a saved run is and what came of it",
        "Print what a file of `suslov-fast run -o` or Trajectories.save holds. The drift is that "
        "since state 0, where it was saved.",
        {"": "file json"},
    ),
    "warm-up": Command(
        "warm_up",
        "compile everything, so that no later run has to",
        "Compile everything, for every kind of body, for one thread and for all, into the cache "
        "that later processes read.",
        {},
    ),
    "pictures": Command(
        "pictures",
        "draw the paper's four pictures, and four more",
        "Draw the four pictures of the paper (picture1 ... picture4), an orbit in each regime with "
        "its closed form (regimes), the order of the map (convergence), motion for n = 4 "
        "(four_dimensions), and the scattering angle (scattering).",
        {"": "folder format dpi letters force"},
        {"dpi": {"default": 160}},
    ),
    "animate": Command(
        "pictures",
        "draw a moving body in space",
        "Draw the ellipsoid of inertia of a body, its axes e1 and e2, and the path of the axis a "
        "about which it does not turn. By default it passes from one steady rotation to the "
        "other. FILE ends in .gif, or in .mp4 where ffmpeg is installed.",
        {**_BODY, "motion": "omega0 orientation steps", "output": "output dpi force"},
        {
            "eps": {"help": "step size (0.05 with a picture)"},
            "omega0": {"action": "store", "help": "the start (one beside a steady rotation)"},
            "steps": {"type": _integer(1), "default": 440},
            "output": {"required": True},
            "dpi": {"default": 100},
        },
    ),
    "explore": Command(
        "others",
        "move a body, a step size and a start on a page in the browser",
        "Serve a page to the browser of this machine, on which the body, the step size and the "
        "start are moved, and the orbit, its regime and the body in space are seen at once. "
        "Nothing is sent to or fetched from elsewhere. Ctrl-C ends it.",
        {"": "link port no_browser"},
    ),
}


def body_classes() -> list[Any]:
    """Return the classes of bodies that have a map."""
    import suslov_fast

    from .._maps.registry import body_names

    return [getattr(suslov_fast, name) for name in body_names()]


def flag(name: str) -> str:
    """Return an option as it is written."""
    default = (f"--{name.replace('_', '-')}",)
    return str(OPTIONS.get(name, {}).get("flags", default)[-1])


# ------------------------------------------------------------------ parsing


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise usage_error(message)


def parse(words: Sequence[str]) -> argparse.Namespace:
    """Read a command line; its attribute `command` is the name of the subcommand."""
    if not words or words[0] not in COMMANDS:
        _parse_general(words)
    parser = _parser(words[0])
    options, rest = parser.parse_known_args(_with_numbers_joined(words[1:]))
    for word in rest:
        name = word.partition("=")[0]
        if not name.startswith("-"):
            raise usage_error(f"expected no argument {word!r}")
        hint = f"`suslov-fast {words[0]} --help` lists the options"
        raise usage_error(
            f"unknown option {name}; {_suggestion(name, [*parser._option_string_actions], hint)}"
        )
    options.command = words[0]
    return options


def _parse_general(words: Sequence[str]) -> NoReturn:
    """Answer a command line that names no subcommand."""
    parser = _Parser(
        prog="suslov-fast",
        usage=f"suslov-fast [-h] [-V] {{{','.join(COMMANDS)}}} ...",
        description="The Hirota-Kimura discretization of the nonholonomic Suslov problem.",
        epilog="subcommands, each with a --help of its own:\n"
        + "\n".join(f"  {name:<10}{each.help}" for name, each in COMMANDS.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    version = f"suslov-fast {__version__}"
    parser.add_argument("-V", "--version", action="version", version=version)
    parser.parse_known_args(words[:1])
    expected = f"expected one of {', '.join(COMMANDS)}"
    if not words:
        raise usage_error(f"{expected}, got nothing")
    raise usage_error(
        f"unknown command {words[0]!r}; {_suggestion(words[0], [*COMMANDS], expected)}"
    )


def _suggestion(word: str, known: list[str], otherwise: str) -> str:
    close = difflib.get_close_matches(word, known, 1)
    return f"did you mean {close[0]}?" if close else otherwise


def _parser(name: str) -> argparse.ArgumentParser:
    command = COMMANDS[name]
    parser = _Parser(
        prog=f"suslov-fast {name}", description=command.description, allow_abbrev=False
    )
    for title, options in command.groups.items():
        group: Any = parser.add_argument_group(title) if title else parser
        for option in options.split():
            if option == "PARAMETERS":
                _add_parameters(group)
                continue
            settings = {**OPTIONS[option], **command.changes.get(option, {})}
            flags = settings.pop("flags", (flag(option),))
            if settings.get("default") and "(" not in settings["help"]:
                settings["help"] += " (%(default)s)"
            if flags[0].startswith("-"):
                settings["dest"] = option
            group.add_argument(*flags, **settings)
    return parser


def _add_parameters(group: Any) -> None:
    """Add an option for each parameter of each body."""
    kinds = {name: kind for kind in reversed(body_classes()) for name in kind._names()}
    for name, kind in sorted(kinds.items(), key=lambda each: (each[1]._own_axes, len(each[0]))):
        what = "moment" if name in kind._positive else "product"
        settings = _option(
            _PARAMETERS.get(name, f"{what} of inertia"),
            _list if kind._own_axes else _positive if name in kind._positive else _number_of,
            f"{name}1,..." if kind._own_axes else None,
        )
        group.add_argument(f"--{name}", **settings)


def _with_numbers_joined(words: Sequence[str]) -> list[str]:
    """Write `--eps -1e-3` as `--eps=-1e-3`: argparse takes some negative numbers for options."""
    joined: list[str] = []
    for word in words:
        if joined and re.fullmatch(r"--[\w-]+", joined[-1]) and re.match(r"-[\d.]", word):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined
