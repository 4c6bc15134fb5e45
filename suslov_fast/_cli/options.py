"""Options of the command: each is declared once and shared by subcommands.

This module imports nothing that is slow, so that `--help` and mistakes are answered at once.
"""

from __future__ import annotations

import argparse
import difflib
import math
import re
from collections.abc import Callable, Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from .. import __version__

USAGE, FAILURE = 2, 1
TRAJECTORIES = 65_536
# The paper's pictures; the bodies of 2, 3 and 4 can be made of matter.
PICTURES, DEFAULT_PICTURE = (1, 2, 3, 4), 2


class CommandError(Exception):
    """A message for the user, and the exit status."""

    def __init__(self, message: str, status: int = FAILURE) -> None:
        super().__init__(message)
        self.status = status


def usage_error(message: str) -> CommandError:
    """Return the error of a command line that makes no sense."""
    return CommandError(message, USAGE)


def number(text: str) -> float:
    """Read a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a finite number, got {text!r}")
    return value


def positive(text: str) -> float:
    """Read a positive number."""
    try:
        value = number(text)
    except argparse.ArgumentTypeError:
        value = 0.0
    if value <= 0:
        raise argparse.ArgumentTypeError(f"expected a positive number, got {text!r}")
    return value


def numbers(text: str) -> list[float]:
    """Read finite numbers separated by commas."""
    return [number(part) for part in text.split(",")]


def numbers_or_file(text: str) -> list[float] | Path:
    """Read numbers separated by commas, or the name of a file."""
    return Path(text) if Path(text).suffix.lower() in (".npy", ".csv") else numbers(text)


def integer(minimum: int, below: int = 2**62) -> Callable[[str], int]:
    """Return a reader of integers, which may be written as 1e6."""

    def read(text: str) -> int:
        try:
            value = Decimal(text)
        except InvalidOperation:
            value = Decimal("NaN")
        # Large exponents are refused before they become digits.
        large = value.is_finite() and value.adjusted() > 19 and value > 0
        if not large and not (value.is_finite() and value >= minimum and value == int(value)):
            raise argparse.ArgumentTypeError(
                f"expected an integer of at least {minimum}, got {text!r}"
            )
        if large or value >= below:
            limit = "2**62" if below == 2**62 else below
            raise argparse.ArgumentTypeError(f"expected an integer below {limit}, got {text!r}")
        return int(value)

    return read


def picture(text: str) -> int:
    """Read the number of a picture."""
    if text not in map(str, PICTURES):
        raise argparse.ArgumentTypeError(f"expected 1, 2, 3 or 4, got {text!r}")
    return int(text)


def result_file(text: str) -> Path:
    """Read the name of a file that holds a run."""
    if Path(text).suffix.lower() not in (".npz", ".nc", ".zarr") or text.endswith("/"):
        raise argparse.ArgumentTypeError(
            f"expected the name of a .npz, .nc or .zarr file, got {text!r}"
        )
    return Path(text)


def sweep(text: str) -> tuple[str, float, float, int]:
    """Read a range of values of a parameter."""
    match = re.fullmatch(r"(\w+)=([^:=]+):([^:=]+):([^:=]+)", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"expected NAME=LOW:HIGH:COUNT, got {text!r}")
    return match[1], number(match[2]), number(match[3]), integer(1)(match[4])


_FLAG: dict[str, Any] = {"action": "store_true"}
_COUNT: dict[str, Any] = {"type": integer(1), "metavar": "N"}

# Options by name; a default, if a command has one, is added to the help. Options that `iterate` or
# `ensemble` takes have the name of its argument.
OPTIONS: dict[str, dict[str, Any]] = {
    "picture": {
        "type": picture,
        "metavar": "1..4",
        "help": f"body and step size of a picture of the paper ({DEFAULT_PICTURE}); "
        "parameters that are given too replace those of the picture",
    },
    "inertia": {
        "type": numbers_or_file,
        "metavar": "TENSOR",
        "help": "3 x 3 inertia tensor in any basis: its entries Ixx,Iyy,Izz,Ixy,Ixz,Iyz, or a .npy "
        "or .csv file",
    },
    "mass_tensor": {
        "type": Path,
        "metavar": "FILE",
        "help": "in n dimensions: n x n second moments of mass in any basis, the I of "
        "M = I Omega + Omega I, .npy or .csv (for n = 3: trace(T)/2 - T, T the inertia tensor)",
    },
    "axis": {
        "type": numbers,
        "metavar": "A1,A2,...",
        "help": "with a tensor: the axis of the constraint, in its basis (the last one)",
    },
    "eps": {"type": number, "help": "step size (that of the picture)"},
    "omega0": {
        "type": numbers,
        "action": "append",
        "metavar": "OMEGA1,OMEGA2",
        "help": "a start; may be repeated",
    },
    "initial": {
        "type": Path,
        "metavar": "FILE",
        "help": "starts from a .npy or .csv file, one per row",
    },
    "trajectories": {**_COUNT, "help": f"number of random starts ({TRAJECTORIES})"},
    "extent": {"type": positive, "help": "random starts have components in [-EXTENT, EXTENT) (2)"},
    "seed": {"type": integer(0), "help": "seed of the random starts (0)"},
    "orientation": {
        "type": numbers_or_file,
        "metavar": "R0",
        "help": "orientation at the start: a rotation vector in degrees, X,Y,Z, or the rotation "
        "matrix in a .npy or .csv file (the identity)",
    },
    "steps": {"type": integer(0), "metavar": "N", "help": "number of steps"},
    "method": {"default": "auto", "help": "method of iterate"},
    "threads": {**_COUNT, "help": "number of threads (all)"},
    "save_every": {
        "type": integer(1),
        "metavar": "K",
        "help": "keep every K-th state (the last state only)",
    },
    "attitude": {**_FLAG, "help": "carry the orientation of the body along"},
    "output": {"flags": ("-o", "--output"), "metavar": "FILE"},
    "force": {**_FLAG, "help": "replace files that exist"},
    "json": {**_FLAG, "help": "print one JSON object, for programs"},
    "chunk": {**_COUNT, "help": "trajectories computed at a time (a few MB)"},
    "scheduler": {"metavar": "ADDRESS", "help": "Dask scheduler whose workers compute"},
    "sweep": {
        "type": sweep,
        "action": "append",
        "metavar": "NAME=LOW:HIGH:COUNT",
        "help": "an axis of step sizes (eps) or of a parameter (I13, J2); may be repeated",
    },
    "compression": {"choices": ("lz4", "zstd"), "help": "compress what is written"},
    "reductions": {
        "flags": ("--reduce",),
        "action": "append",
        "metavar": "NAME",
        "help": "write the last states and this only: first_integral_drift, omega_max, ...",
    },
    "verify": {**_FLAG, "help": "read what is stored, and compute again what is damaged"},
    "file": {"flags": ("file",), "type": result_file, "metavar": "FILE", "help": "a run"},
    "folder": {
        "flags": ("-o", "--output"),
        "type": Path,
        "default": Path(),
        "metavar": "DIR",
        "help": "where to write them (this folder)",
    },
    "format": {"choices": ("png", "pdf", "svg"), "default": "png", "help": "format of the files"},
    "dpi": {**_COUNT, "help": "dots per inch"},
    "letters": {**_FLAG, "help": "write the letters of panels, (a), (b) ..."},
    "link": {
        "flags": ("link",),
        "nargs": "?",
        "metavar": "LINK",
        "help": "a link copied from the page: begin with what it shows",
    },
    "port": {
        "type": integer(0, 2**16),
        "default": 0,
        "metavar": "N",
        "help": "port of 127.0.0.1 (a free one)",
    },
    "no_browser": {**_FLAG, "help": "print the address only"},
}

_PARAMETERS = {
    "I1": "moment of inertia",
    "I2": "moment of inertia",
    "I3": "moment of inertia, which does not enter the map",
    "I13": "product of inertia",
    "I23": "product of inertia",
    "J": "in n dimensions: I_ii + I_nn",
    "I": "in n dimensions: I_in",
    "k": "momentum of a rotor along the axis of the constraint: a gyrostat",
}


class Command(NamedTuple):
    """A subcommand: its module, its help, its options in groups, and what it changes in them."""

    module: str
    help: str
    description: str
    groups: dict[str, str]
    changes: dict[str, dict[str, Any]]


# Options of runs that are larger than memory.
STORE = "chunk scheduler sweep compression reductions verify"
_BODY = "picture PARAMETERS inertia mass_tensor axis eps"
COMMANDS = {
    "run": Command(
        "run",
        "iterate a batch of trajectories and print a summary",
        "Iterate a batch of trajectories of the discrete Suslov problem. With no options: "
        f"{TRAJECTORIES:,} random starts of the paper's picture {DEFAULT_PICTURE}, 1000 steps.",
        {
            "body (a picture, all parameters, or a tensor)": _BODY,
            "starts (random ones, or your own)": "trajectories extent seed omega0 initial",
            "run": "steps method threads attitude orientation",
            "output": "output save_every force json",
            "with -o FILE.zarr (computed and written in parts; the same command goes on)": (
                STORE
            ),
        },
        {
            "steps": {"default": 1000},
            "output": {
                "type": result_file,
                "help": "write all that Trajectories.load needs, to a .npz, .nc or .zarr",
            },
        },
    ),
    "info": Command(
        "others",
        "print what a saved run is and what came of it",
        "Print what a file of `suslov-fast run -o` or Trajectories.save holds. The drift is that "
        "since state 0, where it was saved.",
        {"options": "file json"},
        {},
    ),
    "warm-up": Command(
        "warm_up",
        "compile everything, so that no later run has to",
        "Compile everything, for every kind of body, for one thread and for all, into the cache "
        "that later processes read.",
        {},
        {},
    ),
    "pictures": Command(
        "pictures",
        "draw the paper's four pictures, and four more",
        "Draw the four pictures of the paper as DIR/picture1.png ... picture4.png, an orbit in "
        "each regime with its closed form as regimes.png, the order of the map as "
        "convergence.png, motion for n = 4 as four_dimensions.png, and the scattering angle as "
        "scattering.png.",
        {"options": "folder format dpi letters force"},
        {"dpi": {"default": 160}},
    ),
    "animate": Command(
        "pictures",
        "draw a moving body in space",
        "Draw the ellipsoid of inertia of a body, its axes e1 and e2, and the path of the axis a "
        "about which it does not turn. By default it passes from one steady rotation to the "
        "other. FILE ends in .gif, or in .mp4 where ffmpeg is installed.",
        {
            "body (a picture, all parameters, or a tensor)": _BODY,
            "motion": "omega0 orientation steps",
            "output": "output dpi force",
        },
        {
            "eps": {"help": "step size (0.05 with a picture)"},
            "omega0": {"action": "store", "help": "the start (one beside a steady rotation)"},
            "steps": {"type": integer(1), "default": 440},
            "output": {"type": Path, "required": True, "help": "where to write it"},
            "dpi": {"default": 100},
        },
    ),
    "explore": Command(
        "others",
        "move a body, a step size and a start on a page in the browser",
        "Serve a page to the browser of this machine, on which the body, the step size and the "
        "start are moved, and the orbit, its regime and the body in space are seen at once. "
        "Nothing is sent to or fetched from elsewhere. Ctrl-C ends it.",
        {"options": "link port no_browser"},
        {},
    ),
}


def body_classes() -> list[Any]:
    """Return the classes of bodies that have a map."""
    import suslov_fast

    from .._maps.registry import body_names

    return [getattr(suslov_fast, name) for name in body_names()]


def flag(name: str) -> str:
    """Return an option as it is written."""
    flags = OPTIONS.get(name, {}).get("flags", (f"--{name.replace('_', '-')}",))
    return str(flags[-1])


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
        known = [each for each in parser._option_string_actions if each.startswith("--")]
        raise usage_error(
            f"unknown option {name}; "
            + _suggestion(name, known, f"`suslov-fast {words[0]} --help` lists the options")
        )
    options.command = words[0]
    return options


def _parse_general(words: Sequence[str]) -> NoReturn:
    """Answer what names no subcommand."""
    names = ",".join(COMMANDS)
    width = max(map(len, COMMANDS))
    parser = _Parser(
        prog="suslov-fast",
        usage=f"suslov-fast [-h] [-V] {{{names}}} ...",
        description="The Hirota-Kimura discretization of the nonholonomic Suslov problem.",
        epilog="subcommands, each with a --help of its own:\n"
        + "\n".join(f"  {name:<{width}}  {each.help}" for name, each in COMMANDS.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    version = f"suslov-fast {__version__}"
    parser.add_argument("-V", "--version", action="version", version=version)
    _, rest = parser.parse_known_args(words[:1])
    if rest:
        hint = _suggestion(rest[0], list(COMMANDS), f"expected one of {names.replace(',', ', ')}")
        raise usage_error(f"unknown command {rest[0]!r}; {hint}")
    raise usage_error(f"expected a command, one of {names.replace(',', ', ')}, got none")


def _suggestion(word: str, known: list[str], otherwise: str) -> str:
    close = difflib.get_close_matches(word, known, 1)
    return f"did you mean {close[0]}?" if close else otherwise


def _parser(name: str) -> argparse.ArgumentParser:
    command = COMMANDS[name]
    parser = _Parser(
        prog=f"suslov-fast {name}", description=command.description, allow_abbrev=False
    )
    for title, options in command.groups.items():
        group = parser if title == "options" else parser.add_argument_group(title)
        for option in options.split():
            if option == "PARAMETERS":
                _add_parameters(group)
                continue
            settings = {**OPTIONS[option], **command.changes.get(option, {})}
            flags = settings.pop("flags", (flag(option),))
            if flags[0].startswith("-"):
                settings["dest"] = option
            default = settings.get("default")
            if isinstance(default, (str, int)) and default:
                settings["help"] += " (%(default)s)"
            group.add_argument(*flags, **settings)
    return parser


def _add_parameters(group: Any) -> None:
    """Add an option for each parameter of each body."""
    added = set()
    for kind in body_classes():
        for name in kind._names():
            if name in added:
                continue
            added.add(name)
            settings: dict[str, Any] = {"type": positive if name in kind._positive else number}
            if kind._own_axes:
                settings = {"type": numbers, "metavar": f"{name}1,{name}2,..."}
            text = _PARAMETERS.get(name, f"parameter of {kind.__name__}")
            group.add_argument(f"--{name}", help=text, **settings)


def _with_numbers_joined(words: Sequence[str]) -> list[str]:
    """Write `--eps -1e-3` as `--eps=-1e-3`: argparse takes some negative numbers for options."""
    joined: list[str] = []
    for word in words:
        if joined and re.fullmatch(r"--\w+", joined[-1]) and re.match(r"-[\d.]", word):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined
