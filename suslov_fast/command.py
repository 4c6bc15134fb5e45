"""The command `suslov-fast`: runs, their summaries, reports, pictures and a page in the browser."""

import argparse
import inspect
import json
import os
import re
import shutil
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NoReturn

import suslov_fast as sf

from .summary import facts_in, facts_of, lines_of, result_in

# Modules that need Numba, which would delay `--help`, are imported where they are used.
_PARAMETERS = {
    **dict.fromkeys(("I1", "I2"), "moment of inertia, positive"),
    **dict.fromkeys(("I13", "I23"), "product of inertia"),
    "I3": "moment about the constrained axis, which only drawings use",
    "k": "momentum of a rotor along the constrained axis",
    "J": "J_i = I_ii + I_nn of a body in n dimensions, positive",
    "I": "couplings I_in of a body in n dimensions",
}
_JSON = "JSON file from json.dump(body.to_dict(), ...)"
# Seconds, more than any search takes.
_NO_LIMIT = 1e9


def main(words: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit status; errors are one line on stderr."""
    try:
        options = _parsed(sys.argv[1:] if words is None else words)
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: _tell(f"warning: {message}")
            return int(options.function(options) or 0)
    except KeyboardInterrupt as error:
        _tell(f"interrupted{error}")
        return 130  # as a shell does for a process that a signal ended
    except BrokenPipeError:  # nobody reads the output
        return 141
    except Exception as error:
        _tell(_text_of(error))
        return 1
    finally:
        try:
            sys.stdout.flush()
        except OSError:  # Python would try again at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _tell(text: str) -> None:
    print("suslov-fast:", " ".join(text.split()), file=sys.stderr, flush=True)


def _text_of(error: Exception, what: object = "") -> str:
    """Return the message of an error, which begins with what it is about."""
    text = str(error) or type(error).__name__
    if isinstance(error, OSError) and error.strerror:
        what, text = error.filename or what, error.strerror
    return text if text.startswith(str(what)) else f"{what}: {text}"


@contextmanager
def _about(what: object) -> Iterator[None]:
    """Let the messages of errors begin with the name of a file or an option."""
    try:
        yield
    except Exception as error:
        raise ValueError(_text_of(error, what)) from error


class _Parser(argparse.ArgumentParser):
    """A parser whose errors ask what was meant."""

    def error(self, message: str) -> NoReturn:
        found = re.search(r"unrecognized arguments: -+([^\s=]+)|invalid choice: '([^']*)'", message)
        known = [[*each.option_strings, *map(str, each.choices or ())] for each in self._actions]
        names = {name.strip("-").lower(): name for each in known for name in each}
        close = get_close_matches((found[1] or found[2]).lower(), names, 1) if found else []
        super().error(f"{message}; did you mean {names[close[0]]}?" if close else message)


def _parsed(words: Sequence[str]) -> argparse.Namespace:
    parser = _Parser("suslov-fast", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("-V", "--version", action="version", version=f"%(prog)s {sf.__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)

    def command(function: Callable[..., int | None]) -> Any:
        name, text = function.__name__.replace("_", "-"), function.__doc__ or ""
        about: dict[str, Any] = {"help": text.partition(".")[0], "description": text}
        made = commands.add_parser(name, allow_abbrev=False, **about)
        made.set_defaults(function=function, usage_error=made.error)
        return made

    _add_options_of_run(command(run))
    made = command(info)
    made.add_argument("file", type=Path, nargs="+", metavar="FILE", help=".npz or .zarr")
    made.add_argument("--json", action="store_true", help="print JSON, an object in each line")
    made = command(plot)
    made.add_argument("file", type=Path, metavar="FILE.npz")
    made.add_argument("-o", "--output", type=Path, metavar="FILE.png", required=True)
    made.add_argument("--force", action="store_true", help="replace what is there")
    made = command(report)
    made.add_argument("--body", type=Path, metavar="FILE.json", required=True, help=_JSON)
    made.add_argument(
        "--eps", type=fraction, metavar="X", help="step size, 1/3 or 0.1 (default: symbolic)"
    )
    made.add_argument("--degree", type=integer, default=3, help="largest degree of polynomials (3)")
    made.add_argument("--time-limit", type=float, metavar="SECONDS", help="(none)")
    made.add_argument("--json", action="store_true", help="print JSON, for programs")
    made = command(pictures)
    made.add_argument("-o", "--output", type=Path, default=Path(), metavar="DIR")
    made.add_argument("--force", action="store_true", help="replace what is there")
    made = command(explore)
    made.add_argument("--port", type=integer, default=0, help="port of 127.0.0.1 (a free one)")
    made.add_argument("--no-browser", action="store_true", help="only print the address")
    command(warm_up)
    # argparse takes a word such as -1,.5 for an option, unless it begins with a blank.
    words = [f" {word}" if re.match(r"-[\d.]", word) else word for word in words]
    options, strays = parser.parse_known_args(words)
    if strays:
        options.usage_error(f"unrecognized arguments: {' '.join(strays)}")
    return options


def fraction(text: str) -> Fraction:
    """Return a number, which may be written as 1/3 or 1e6."""
    from .bodies.polynomials import from_text

    try:
        return from_text(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no number, such as 0.1 or 1/3") from None


def integer(text: str) -> int:
    if (value := fraction(text)).denominator > 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no integer")
    return int(value)


def numbers(text: str) -> list[float]:
    try:
        return [float(each) for each in text.split(",")]
    except ValueError:
        how = "write numbers with commas, as 1,0.5"
        raise argparse.ArgumentTypeError(f"{text!r} is no list of numbers: {how}") from None


def _add_options_of_run(parser: Any) -> None:
    group = parser.add_argument_group(
        "system: one of --picture, --body, or all of its parameters (then --eps is required)"
    )
    one = group.add_mutually_exclusive_group()
    one.add_argument("--picture", type=int, choices=(1, 2, 3, 4), help="figure of the paper (2)")
    one.add_argument("--body", type=Path, metavar="FILE.json", help=_JSON)
    for name, text in _PARAMETERS.items():
        kind, form = (numbers, "X,...") if name in "JI" else (float, "X")
        about = {"metavar": form, "default": argparse.SUPPRESS, "help": text}
        group.add_argument(f"--{name}", type=kind, **about)
    group = parser.add_argument_group("initial states")
    one = group.add_mutually_exclusive_group()
    many = "number of random starts (65536)"
    one.add_argument("--trajectories", type=integer, metavar="N", default=65_536, help=many)
    one.add_argument(
        "--omega0", type=numbers, action="append", metavar="X,...", help="a start; repeat for more"
    )
    one.add_argument("--initial", type=Path, metavar="FILE.npy", help="a start in each row")
    group.add_argument(
        "--extent", type=float, metavar="X", help="half-width of the box of starts (2)"
    )
    group.add_argument("--seed", type=integer, metavar="N", help="seed of the random starts (0)")
    group = parser.add_argument_group("run")
    group.add_argument("--eps", type=fraction, metavar="X", help="step size (that of the picture)")
    group.add_argument(
        "--steps", type=integer, default=1000, metavar="N", help="number of steps (1000)"
    )
    group.add_argument(
        "--method", default="auto", help="auto; for fields also order4, order6, order8 (auto)"
    )
    group.add_argument("--threads", type=integer, metavar="N", help="number of threads (all)")
    group.add_argument(
        "--save-every", type=integer, metavar="K", help="save every K-th state (only the last)"
    )
    group.add_argument("--attitude", action="store_true", help="compute the orientation, too")
    group.add_argument("-o", "--output", type=Path, metavar="FILE", help=".npz or .zarr")
    group.add_argument("--force", action="store_true", help="replace what is there")
    group.add_argument("--json", action="store_true", help="print JSON, for programs")


def run(options: argparse.Namespace) -> None:
    """Iterate a batch of trajectories and print a summary.

    The default is 65,536 random initial states, 1000 steps, and the body and step size of figure 2
    of the paper. A run into FILE.zarr is written in parts; the same command continues it.
    """
    path = options.output
    if path is not None and path.suffix not in (".npz", ".zarr"):
        options.usage_error(f"argument -o/--output: '{path}' must end in .npz or .zarr")
    if path is None and (options.attitude or options.save_every is not None):
        options.usage_error("arguments --save-every and --attitude need a file: add -o FILE")
    body, eps = _body_and_step(options)
    work = body, _starts(options, body), eps, options.steps
    import numba

    if options.threads is not None:
        with _about("--threads"):
            numba.set_num_threads(options.threads)
    settings = {name: getattr(options, name) for name in ("save_every", "method", "attitude")}
    settings["progress"] = os.isatty(2) and find_spec("tqdm") is not None
    is_stored = path is not None and path.suffix == ".zarr"
    try:
        facts = (_stored if is_stored else _held)(path, options.force, work, settings)
    except KeyboardInterrupt:
        kept = "keeps its tiles; the same command goes on" if is_stored else "was not written"
        raise KeyboardInterrupt(f": {path} {kept}" if path else "") from None
    facts |= {"threads": numba.get_num_threads()} | ({"written": str(path)} if path else {})
    print(lines_of(facts, options.json), flush=True)
    if facts["trajectories"] and not any(sf.Status[name] >= 0 for name in facts["status"]):
        raise ArithmeticError("run: all trajectories failed")


def _body_and_step(options: argparse.Namespace) -> tuple[Any, Any]:
    from .bodies.rigid import PICTURES

    given = {name: value for name, value in vars(options).items() if name in _PARAMETERS}
    if given and (options.picture or options.body):
        options.usage_error(f"argument --{min(given)}: not allowed with --picture or --body")
    if not (given or options.body):
        body, eps, _ = PICTURES[options.picture or 2]
        return body, eps if options.eps is None else options.eps
    in_3d = sf.SuslovGyrostat if "k" in given else sf.Suslov3D
    kind: Any = sf.SuslovND if {"J", "I"} & given.keys() else in_3d
    known = {} if options.body else inspect.signature(kind).parameters
    needed = [name for name, each in known.items() if each.default is each.empty]
    lacking = [f"--{name}" for name in (*needed, "eps") if getattr(options, name, None) is None]
    if lacking:
        options.usage_error(f"the following arguments are required: {', '.join(lacking)}")
    if foreign := given.keys() - known.keys():
        options.usage_error(f"argument --{min(foreign)}: not allowed with --J and --I")
    return _body_in(options.body) if options.body else kind(**given), options.eps


def _body_in(path: Path) -> Any:
    with _about(path):
        return sf.body_from_dict(json.loads(path.read_text(encoding="utf-8")))


def _starts(options: argparse.Namespace, body: Any) -> Any:
    """Return the initial states: RandomStarts, or an array, which may be a map of a file."""
    import numpy as np

    from . import checks

    path, states = options.initial, options.omega0
    if not (path or states):
        count = checks.integer("--trajectories", options.trajectories, 1)
        extent = 2.0 if options.extent is None else options.extent
        return sf.RandomStarts(count, extent, options.seed or 0)
    if (options.extent, options.seed) != (None, None):
        options.usage_error(
            "arguments --extent and --seed are for random states: leave out --initial and --omega0"
        )
    name = str(path or "--omega0")
    with _about(name):
        if path:
            try:
                states = np.asarray(np.lib.format.open_memmap(path, mode="r"))
            except (ValueError, EOFError) as error:
                text = "this is no whole file of numpy.save"
                how = f"save an array of numbers (count, {body.dimension})"
                raise ValueError(f"{text}: {how}") from error
        return checks.states(name, checks.real_array(name, states), body._labels)


def _held(path: Path | None, force: bool, work: Any, settings: Any) -> dict[str, Any]:
    """Compute a run, save it if there is a path, and return its summary."""
    from .engine.threads import CROSSOVER

    if path is not None:
        _require_new([path], force)
        if not os.access(f"{path.absolute().parent}/", os.W_OK):
            raise PermissionError(f"{path}: nothing can be written there: choose another folder")
    body, starts, eps, steps = work
    if isinstance(starts, sf.RandomStarts):
        starts = starts.states(starts.shape[0], dimension=body.dimension)
    settings = settings | {"on_singular": "ignore"}
    few = min(steps, CROSSOVER // max(1, len(starts)) + 1)
    sf.iterate(body, starts, eps, few, **settings | {"progress": None})  # compiles, starts threads
    begin = time.perf_counter()
    found = sf.iterate(body, starts, eps, steps, **settings)
    seconds = time.perf_counter() - begin
    failed = found.status < 0
    computed = (failed * found.failed_at + ~failed * steps).sum()
    rate = {"seconds": seconds, "steps_per_second": float(computed) / seconds}
    facts = facts_of(found, starts) | rate
    if path is not None:
        found.save(path, overwrite=force)
    return facts


def _stored(path: Path, force: bool, work: Any, settings: Any) -> dict[str, Any]:
    """Compute what a store lacks of a run, and return its summary."""
    if force and path.exists():
        sf.open_ensemble(path)  # an error, unless it is the store of a run
        shutil.rmtree(path)
    begin = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sf.PoleWarning)  # statuses tell of poles
            sf.ensemble(*work, store=path, **settings)
    except KeyboardInterrupt:
        if "zarr" in sys.modules:
            from .runs import access

            access.run(access.settle(1.0))
        raise
    return facts_in(path) | {"seconds": time.perf_counter() - begin}


def _require_new(paths: Sequence[Path], force: bool) -> None:
    for path in [] if force else filter(Path.exists, paths):
        raise FileExistsError(f"{path} exists: choose a new name, or add --force to replace it")


def info(options: argparse.Namespace) -> int:
    """Print summaries of saved runs, with the largest relative change of a conserved quantity."""
    failed = 0
    for path in options.file:
        try:
            facts = {"file": str(path), **facts_in(path)}
        except Exception as error:
            _tell(_text_of(error, path))
            failed = 1
        else:
            print(lines_of(facts, options.json), flush=True)
    return failed


def plot(options: argparse.Namespace) -> None:
    """Draw a saved run, or saved crossings, as PNG, SVG or PDF."""
    _require_new([options.output], options.force)
    found = result_in(options.file)
    from .runs.plot import plt

    with _about(options.output):
        found.plot().figure.savefig(options.output, dpi=150)
        plt.close()
    print(options.output, flush=True)


def report(options: argparse.Namespace) -> None:
    """Report evidence for or against the integrability of a Kahan map.

    Decimals of the file and of --eps are taken as they are written, 0.1 as 1/10; without --eps
    the formulas are those of any step size. Needs python-flint.
    """
    from .integrability import report as report_of

    def show(found: Any) -> None:
        print(json.dumps(found.to_dict()) if options.json else repr(found), flush=True)

    # With a limit the search runs in another process, so that Ctrl-C takes effect at once.
    limit = _NO_LIMIT if options.time_limit is None else options.time_limit
    try:
        body = _body_in(options.body)
        show(report_of(body, options.eps, options.degree, time_limit=limit, decimals=True))
    except KeyboardInterrupt as error:
        if hasattr(error, "report"):  # what was found so far
            show(error.report)
        raise


def pictures(options: argparse.Namespace) -> None:
    """Draw the four figures of the paper. The gallery of the documentation has others."""
    from .bodies.rigid import PICTURES
    from .plots.phase import plot_phase
    from .runs.plot import plt

    paths = [options.output / f"picture{number}.png" for number in PICTURES]
    _require_new(paths, options.force)
    options.output.mkdir(parents=True, exist_ok=True)
    for path, picture in zip(paths, PICTURES.values(), strict=True):
        plot_phase(*picture).figure.savefig(path, dpi=150)
        plt.close()
    print(*paths, sep="\n", flush=True)


def explore(options: argparse.Namespace) -> None:
    """Vary a body, a step size and an initial state on a page in the browser, until Ctrl-C."""
    import threading
    import webbrowser

    from .plots.explore.server import Server

    with _about(f"--port {options.port}"):
        server = Server(options.port)
    with suppress(KeyboardInterrupt), server:
        print(server.url, flush=True)
        if not options.no_browser:  # it may block
            threading.Thread(target=webbrowser.open, args=[server.url], daemon=True).start()
        server.serve_forever(poll_interval=0.1)


def warm_up(options: argparse.Namespace) -> None:
    """Compile all kernels in advance: later processes read them from the cache on disk."""
    from .warm_up import call_all, where_code_is_kept

    call_all()
    print(where_code_is_kept())
