"""The command `suslov-fast`: runs, figures of runs, the figures of the paper, and reports."""

import argparse
import json
import math
import os
import re
import sys
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NoReturn

import suslov_fast as sf

from .waiting import Waiting
from .words import answer

# Functions import the modules that need NumPy or Numba, because `--help` and most errors need none.

_ABOUT = "Kahan maps of the Suslov problem and of quadratic ODEs, and solutions of any ODEs."
_EXAMPLES = """examples:
  suslov-fast run
  suslov-fast run --equations "x' = v; v' = -sin(x)" --x0 1,0 --time 20 -o run.npz
  suslov-fast plot run.npz x v
  suslov-fast report --equations "x' = y**2; y' = -x"
"""
_LIKE = "x' = a*x - x*y; y' = x*y - y; a = 2"
_OF_STEPS = "eps", "steps", "save_every", "method"  # options only for the map
_OF_TIMES = "points", "rtol", "atol"  # options only for the motion
_AGAIN = 30.0  # what takes more seconds at first is not computed a second time, to measure a rate
_CHECKED = 256  # number of trajectories of which the closed form is computed
_NEXT = """next:
  suslov-fast figures         the four figures of the paper
  suslov-fast report          integrals and measures of the map, by proof
  suslov-fast run --equations "x' = v; v' = -sin(x)" --x0 1,0 --time 20 -o run.npz
  suslov-fast plot run.npz x v
  docs/howto/first_ode.md     your equations in Python"""


class _Parser(argparse.ArgumentParser):
    """A parser whose errors have one line, with the nearest option or command."""

    def error(self, message: str) -> NoReturn:
        known = {}
        for action in self._actions:
            for name in (*action.option_strings, *map(str, action.choices or ())):
                known[name.strip("-").replace("-", "_")] = name
        wrong = r" --?([^\s=]+)" if "unrecognized" in message else "invalid choice: '([^']*)'"
        for word in re.findall(wrong, message):
            plain = word.replace("-", "_").lower()
            if near := known.get(plain) or known.get(answer(plain, known)):
                message += f"; for {word} use {near}"
        if "unrecognized" in message and " -" not in message:
            message += "; lists have commas, --x0 1,0.5, and texts quotation marks"
        print(f"{self.prog}: {message} (see {self.prog} --help)", file=sys.stderr)
        sys.exit(2)


def main(words: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit status.

    The status is 0 after success, 1 after a failure of the computation, 2 if the command line or a
    file is wrong, and 130 after Ctrl-C.
    """
    words = [*(sys.argv[1:] if words is None else words)]
    parser = _parser()
    if not words:
        parser.print_help()
        return 0
    # Prepend a blank, because argparse takes a list such as -1,.5 for an option.
    words = [f" {each}" if re.match(r"-[\d.]", each) else each for each in words]
    options, unknown = parser.parse_known_args(words)
    if unknown:
        options.refuse(f"unrecognized arguments: {' '.join(unknown)}")
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: _tell(f"warning: {message}")
            return int(options.function(options) or 0)
    except KeyboardInterrupt:
        _tell("interrupted")
        return 130
    except (ValueError, TypeError, OSError, ImportError, MemoryError) as error:
        file = error.filename if isinstance(error, OSError) else None
        _tell(f"{file}: {error.strerror}" if file else error)  # type: ignore[union-attr]
        return 2
    except Exception as error:
        _tell(error)
        return 1


def _tell(message: object) -> None:
    """Print a message as one line on stderr."""
    text = str(message) or type(message).__name__
    print("suslov-fast:", " ".join(text.split()), file=sys.stderr, flush=True)


# ---------------------------------------------------------------------------------- commands
def run(options: argparse.Namespace) -> int:
    """Compute a batch of trajectories; print the time that this takes, and checks of the paper.

    By default take 1000 steps of the map from 65,536 random states of the body of figure 2 of the
    paper. With --time solve the equations of motion, as `flow` does. With --json, and if the output
    is no terminal, print the same facts as JSON. No time contains compilation.
    """
    given = {name: value for name, value in vars(options).items() if value not in (None, False)}
    is_motion = "time" in given
    for name in _OF_STEPS if is_motion else _OF_TIMES:
        if name in given:
            how = "is for steps of the map: leave out --time" if is_motion else "needs --time T"
            raise ValueError(f"--{name.replace('_', '-')} {how}")
    if "output" in given:
        _check_writable([options.output], (".npz",), options.force)
    elif "save_every" in given:
        raise ValueError("--save-every needs a file: add -o run.npz")
    system, eps = _system(options)
    compute, chosen = _computation(system, eps, options, given)
    result, seconds = _timed(
        compute, math.inf if given.keys() <= {"function", "refuse"} else _AGAIN
    )
    if "output" in given:
        result.save(options.output, overwrite=options.force)
    facts = _facts(system, result, seconds, is_motion)
    failed, steps = result.status < 0, facts["steps"]
    if "threads" not in given and seconds and seconds < _AGAIN / 10:
        facts |= _on_threads(compute, steps)
    facts |= {"trajectories": failed.size, "failed": int(failed.sum())}
    if not is_motion:
        facts |= _checks(system, compute.args[1], eps, chosen, result)
    facts |= {"written": str(options.output)} if "output" in given else {}
    if options.json or not sys.stdout.isatty():
        print(json.dumps(facts))
    else:
        ending = "" if failed.size == 1 else "s"
        way = f"orbit{ending} of Kahan's map, {steps:,} steps in all, of length {float(eps or 0):g}"
        if is_motion:
            way = f"solution{ending} to time {options.time:g}, {steps:,} steps"
        print(_readable(facts, way, options))
    return int(failed.size > 0 and bool(failed.all()))


def _computation(
    system: Any, eps: Any, options: argparse.Namespace, given: Mapping[str, Any]
) -> tuple[partial[Any], dict[str, Any]]:
    """Return the call that computes the trajectories, and the arguments that were chosen for it."""
    import numpy as np

    like = f"--x0 {','.join('1' * system.dimension)}"
    if "equations" in given and not {"x0", "trajectories"} & {*given}:
        raise ValueError(f"--x0 is missing, the initial state, such as {like}")
    size = options.trajectories or 65_536, system.dimension
    states = options.x0 or np.random.default_rng(0).uniform(-2.0, 2.0, size)
    if any(len(each) != system.dimension for each in states):
        raise ValueError(f"--x0 must be {system.dimension} numbers, such as {like}")
    if len(states) == 1:
        [states] = states
    names = "threads", "rtol", "atol", "steps", "save_every", "method"
    chosen: dict[str, Any] = {name: given[name] for name in names if name in given}
    if "time" in given:
        times = np.linspace(0.0, options.time, options.points or 101)
        return partial(sf.flow, system, states, time=times, **chosen), chosen
    if not _has_map(system):
        raise ValueError("--equations of degree 2 at most have Kahan's map: add --time T")
    if eps is None:
        raise ValueError("--eps is missing, the step size, such as --eps 1/64; or add --time T")
    chosen = {"steps": 1000, "save_every": None, "on_singular": "ignore", **chosen}
    return partial(sf.iterate, system, np.asarray(states), eps, **chosen), chosen


def _facts(system: Any, result: Any, seconds: float | None, is_motion: bool) -> dict[str, Any]:
    """Return what a run tells first: its system, its steps, and how fast they were."""
    import numpy as np

    taken = result.steps
    if not is_motion:  # these are the steps that were asked for
        taken = np.where(result.status < 0, result.failed_at, taken)
    steps = int(taken.sum())
    rate = seconds and steps / seconds
    return {
        "system": str(system), "steps": steps, "seconds": seconds, "steps_per_second": rate,
    }  # fmt: skip


def _on_threads(compute: partial[Any], steps: int) -> dict[str, Any]:
    """Return the steps per second on one thread and on two."""
    from numba import config

    facts = {}
    for number, name in ((1, "one_thread"), (2, "two_threads")):
        if number <= config.NUMBA_NUM_THREADS:
            each = _timed(partial(compute, threads=number), math.inf)[1]
            facts[f"steps_per_second_{name}"] = each and steps / each
    return facts


def _timed(compute: Callable[..., Any], longest: float) -> tuple[Any, float | None]:
    """Return the result of a call, and the seconds of a later call, because the first compiles.

    The seconds are the least of up to five calls within a second, or None if the first call takes
    longer than `longest`.
    """
    begin = time.perf_counter()
    with Waiting() as waiting:
        result = compute(progress=waiting.report)
    if time.perf_counter() - begin > longest:
        return result, None
    begin, least = time.perf_counter(), math.inf
    for _ in range(5):
        start = time.perf_counter()
        result = compute()
        now = time.perf_counter()
        least = min(least, now - start)
        if now - begin > 1.0:
            break
    return result, least


def _checks(system: Any, states: Any, eps: Any, chosen: dict[str, Any], result: Any) -> Any:
    """Return errors of Lemma 1 and Theorem 1 of the paper, for a body without a rotor."""
    import numpy as np

    if type(system) is not sf.Suslov3D or system.k != 0 or chosen.get("method", "auto") != "auto":
        return {}
    starts, ends = states.reshape(-1, 2), result.final.reshape(-1, 2)
    some = slice(_CHECKED)
    with np.errstate(all="ignore"):
        F, after = (system.first_integral(x, eps) for x in (starts, ends))
        exact = system.exact(starts[some], eps, n=chosen["steps"])
        size = np.fmax(abs(starts[some]), abs(ends[some])).max(axis=-1, keepdims=True)
        errors = abs(after / F - 1), abs(exact - ends[some]) / size
    names = "relative_change_of_F", "relative_difference_from_theorem_1"
    return {
        name: float(np.nanmax(error))
        for name, error in zip(names, errors, strict=True)
        if not np.isnan(error).all()
    }


def _readable(facts: dict[str, Any], way: str, options: argparse.Namespace) -> str:
    """Return the facts of a run as lines of text; `way` says what was computed."""
    lines = [f"{facts['trajectories']:,} {way}", f"of {facts['system']}"]
    rates = {"rate": "", "one thread": "_one_thread", "two threads": "_two_threads"}
    found = {name: facts.get(f"steps_per_second{each}") for name, each in rates.items()}
    if found["one thread"]:
        del found["rate"]
    lines += [
        f"{name + ':':12} {rate:.2g} steps per second" for name, rate in found.items() if rate
    ]
    if facts["seconds"] and not any(found.values()):
        lines += [f"time:        {facts['seconds']:.2g} s"]
    if facts["seconds"] is None:
        lines += ["rate:        not known, because only one call was made, and the first compiles"]
    change = facts.get("relative_change_of_F")
    if change is not None:
        lines += [f"Lemma 1:     F is conserved; its largest relative change is {change:.0e}"]
    change = facts.get("relative_difference_from_theorem_1")
    if change is not None:
        lines += [f"Theorem 1:   the closed form and the iteration differ by {change:.0e} at most"]
    lines += [f"failed:      {facts['failed']:,}"] * bool(facts["failed"])
    lines += [f"written:     {facts['written']}"] if "written" in facts else []
    lines += [f"picture:     {_picture(options)}"]
    return "\n".join([*lines, _NEXT])


def _picture(options: argparse.Namespace) -> str:
    """Return what draws the trajectories of a run."""
    if not find_spec("matplotlib"):
        return "pip install '.[plots]' installs what draws it"
    if options.output:
        return f"suslov-fast plot {options.output}"
    if options.equations or options.body or options.time:
        return "add -o run.npz, then suslov-fast plot run.npz"
    return f"suslov-fast figures -o figures draws it, figures/figure{options.figure or 2}.png"


def plot(options: argparse.Namespace) -> None:
    """Draw a file of a run."""
    target = options.output or options.file.with_suffix(".png")
    _check_writable([target], (".png", ".svg", ".pdf"), options.force)
    from .results.figures import plt

    figure = sf.load(options.file).plot(*options.components).figure
    figure.savefig(target, dpi=150)
    plt.close(figure)
    print(target)


def figures(options: argparse.Namespace) -> None:
    """Draw the four figures of the paper."""
    folder = options.output
    if folder.suffix or (folder.exists() and not folder.is_dir()):
        raise ValueError(f"-o {folder} must be a folder, of figure1.png to figure4.png")
    from .bodies.rigid import FIGURES
    from .results.figures import plt

    paths = [folder / f"figure{number}.png" for number in FIGURES]
    folder.mkdir(parents=True, exist_ok=True)
    _check_writable(paths, (".png",), options.force)
    for path, figure in zip(paths, FIGURES.values(), strict=True):
        drawn = sf.plot_phase(*figure).figure
        drawn.savefig(path, dpi=150)
        plt.close(drawn)
    print(*paths, sep="\n")


def report(options: argparse.Namespace) -> None:
    """Print integrals and measures that Kahan's map conserves, and the growth of its degrees.

    Numbers are exact: 0.1 is 1/10. Without --eps the step size is a symbol.
    """
    from .integrability import report as report_of

    system, _ = _system(options)
    if not _has_map(system):
        raise ValueError("--equations: report is for right-hand sides of degree 2 at most")
    print(report_of(system, eps=options.eps, degree=options.degree))


def _check_writable(paths: Sequence[Path], endings: Sequence[str], force: bool) -> None:
    """Raise an error if a file has none of these endings, or cannot be written."""
    for path in paths:
        folder = path.absolute().parent
        if path.suffix.lower() not in endings:
            how = ": load(path).to_dataframe() makes tables" if ".npz" in endings else ""
            raise ValueError(f"-o {path} must end in {' or '.join(endings)}{how}")
        if path.is_dir() or (path.exists() and not force):
            how = "is a folder" if path.is_dir() else "exists: add --force"
            raise ValueError(f"-o {path} {how}, or choose another name")
        if not folder.is_dir():
            raise ValueError(f"-o {path}: there is no folder {folder}")
        if not os.access(folder, os.W_OK):
            raise ValueError(f"-o {path}: the folder {folder} cannot be written")


# ---------------------------------------------------------------------------------- systems
def _system(options: argparse.Namespace) -> tuple[Any, Any]:
    """Return the body or the field that options name, and the step size or None."""
    if options.equations is not None:
        return sf.Field.from_equations(options.equations), options.eps
    if options.body is None:
        body, eps = sf.Suslov3D.figure(options.figure or 2)
        return body, eps if options.eps is None else float(options.eps)
    if len(options.body) not in (4, 5):
        raise ValueError("--body must be four numbers I1,I2,I13,I23, or five, with the rotor k")
    return sf.Suslov3D(*options.body), options.eps


def _has_map(system: Any) -> bool:
    """Return True for a body, and for a field of degree 2."""
    try:
        return bool(system._field.terms)
    except TypeError:
        return False


# ---------------------------------------------------------------------------------- options
def _fraction(text: str) -> Fraction:
    """Return the number in a text such as 0.1, 1/3 or 1e6, exactly."""
    from .fields.exact_numbers import from_text

    try:
        return from_text(text.strip())
    except ValueError:
        how = "is not a number, such as 0.1, 1/3 or 1e6"
        raise argparse.ArgumentTypeError(f"{text.strip()!r} {how}") from None


def _number(text: str) -> float:
    try:
        return float(_fraction(text))
    except OverflowError:
        raise argparse.ArgumentTypeError(f"{text!r} is beyond 1.8e308") from None


def _numbers(text: str) -> list[float]:
    """Return the numbers in a text such as 1,0.5."""
    return [_number(each) for each in text.split(",")]


def _count(text: str) -> int:
    """Return a positive integer below 2**62 in a text such as 1000 or 1e3."""
    value = _fraction(text)
    if value.denominator != 1 or not 0 < value <= 2**62:
        raise argparse.ArgumentTypeError(f"{text.strip()!r} is not an integer from 1 to 2**62")
    return int(value)


def _path(text: str) -> Path:
    """Return the path of a file or folder."""
    if not text.strip():
        raise argparse.ArgumentTypeError("the name of a file is empty")
    return Path(text).expanduser()


def _parser() -> _Parser:
    """Return the parser of the command; its help texts are the docstrings of functions."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = _Parser("suslov-fast", description=_ABOUT, epilog=_EXAMPLES, formatter_class=raw)
    parser.add_argument("-V", "--version", action="version", version=f"%(prog)s {sf.__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    def command(function: Callable[[argparse.Namespace], int | None]) -> Any:
        text = function.__doc__ or ""
        summary: dict[str, Any] = {"help": text.partition("\n")[0], "description": text}
        subparser = commands.add_parser(function.__name__, allow_abbrev=False, **summary)
        subparser.set_defaults(function=function, refuse=subparser.error)
        return subparser

    def add_system(to: Any) -> None:
        add = to.add_mutually_exclusive_group().add_argument
        add("--figure", type=int, choices=(1, 2, 3, 4), help="body of the paper (default 2)")
        add("--body", type=_numbers, metavar="I1,I2,I13,I23", help="another body; a fifth is k")
        add("--equations", metavar="TEXT", help=f'such as "{_LIKE}"')

    def add_file(to: Any, of: str, **keywords: Any) -> None:
        to.add_argument("-o", "--output", type=_path, help=of, **keywords)
        to.add_argument("--force", action="store_true", help="replace files that exist")

    of_run = command(run)
    add_system(of_run)
    add = of_run.add_argument
    add("--x0", type=_numbers, action="append", metavar="X,...", help="initial state; repeatable")
    add("--trajectories", type=_count, metavar="N", help="random states (default 65536)")
    add("--eps", type=_number, metavar="X", help="step size (default: of the figure)")
    add("--steps", type=_count, metavar="N", help="steps of the map (default 1000)")
    add("--save-every", type=_count, metavar="K", help="states in the file (default: the last)")
    add("--method", metavar="NAME", help="auto (default), order4, order6 or order8")
    add("--time", type=_number, metavar="T", help="solve the equations from 0 to T instead")
    add("--points", type=_count, metavar="N", help="times from 0 to T (default 101)")
    add("--rtol", type=_number, metavar="X", help="relative tolerance (default 1e-9)")
    add("--atol", type=_number, metavar="X", help="absolute tolerance")
    add("--threads", type=_count, metavar="N", help="threads (default: all)")
    add("--json", action="store_true", help="print JSON at a terminal, too")
    add_file(of_run, "file of the run", metavar="RUN.npz")
    of_plot = command(plot)
    of_plot.add_argument("file", type=_path, metavar="RUN.npz")
    of_plot.add_argument("components", nargs="*", metavar="NAME", help="such as x v, or time x")
    add_file(of_plot, "figure (default RUN.png)", metavar="FILE.png")
    add_file(command(figures), "folder (default: this one)", metavar="DIR", default=Path())
    of_report = command(report)
    add_system(of_report)
    of_report.add_argument("--eps", type=_fraction, metavar="X", help="step size, such as 1/3")
    of_report.add_argument("--degree", type=_count, metavar="D", default=3, help="default 3")
    return parser
