"""The command `suslov-fast`: what its subcommands do, and how it reports errors."""

import argparse
import json
import os
import shutil
import sys
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import suslov_fast as sf

from .options import parsed
from .summary import facts_in, facts_of
from .system import about, body_and_step, body_of, text_of

# Imports of modules that import Numba are in functions, because Numba would delay `--help`.

_NO_LIMIT = 1e9  # seconds, longer than any search
LONG = 10.0  # seconds after which a run says beforehand how long it takes
_FEW = 64  # trajectories of a motion from which that is estimated
_ENDINGS = ".png", ".svg", ".pdf"
# Options of runs of a map, and of the motion.
_OF_STEPS = "eps", "steps", "method", "save_every", "attitude"
_OF_TIMES = "points", "rtol", "atol"


def main(words: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit status; errors are one line on stderr."""
    options = None
    try:
        commands = run, info, plot, report, figures, explore, warm_up
        options = parsed(sys.argv[1:] if words is None else words, commands)
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: _tell(f"warning: {message}")
            return int(options.function(options) or 0)
    except KeyboardInterrupt as error:
        _tell(f"interrupted{error}")
        return 130  # as shells do after Ctrl-C
    except BrokenPipeError:  # nobody reads the output
        return 141
    except Exception as error:
        text = text_of(error)
        name = text.partition(" must ")[0]
        _tell(f"--{name.replace('_', '-')}{text[len(name) :]}" if hasattr(options, name) else text)
        return 1
    finally:
        try:
            if sys.stdout is not None:  # as in programs without a console
                sys.stdout.flush()
        except OSError:  # without this, Python tries again at exit and prints an error
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _tell(text: str) -> None:
    """Print a message as one line on stderr."""
    print("suslov-fast:", " ".join(text.split()), file=sys.stderr, flush=True)


def run(options: argparse.Namespace) -> None:
    """Compute a batch of trajectories of a map, or of the motion, and print a summary, in JSON.

    By default it takes 1000 steps from 65,536 random states, with the body and the step size of
    figure 2 of the paper. A run into FILE.zarr is written in parts; if it is interrupted, the same
    command continues it. With --time it solves the equations of motion, as `flow` does.
    """
    path = options.output
    if path is not None and path.suffix not in (".npz", ".zarr"):
        how = "load(path).to_dataframe() of suslov_fast makes tables"
        options.usage_error(f"argument -o/--output: '{path}' must end in .npz or .zarr; {how}")
    is_motion = options.time is not None
    for name in _OF_STEPS if is_motion else _OF_TIMES:
        if getattr(options, name) is not None and getattr(options, name) is not False:
            how = "not allowed with" if is_motion else "needs"
            options.usage_error(f"argument --{name.replace('_', '-')}: {how} --time")
    if path is None and (options.attitude or options.save_every is not None):
        options.usage_error("arguments --save-every and --attitude need a file: add -o FILE")
    import numpy as np

    from .. import checks
    from ..runs.iterate import checked_counts

    body, eps = body_and_step(options, needs_step=not is_motion)
    starts = _starts(options, body)
    if body.shape and isinstance(starts, sf.RandomStarts):  # each member with all states
        body = body._part(len(body.shape) - 1, np.arange(body.shape[-1])[:, np.newaxis])
    import numba

    if options.threads is not None:
        from ..engine.threads import thread_count

        numba.set_num_threads(thread_count(options.threads))
    is_stored = path is not None and path.suffix == ".zarr"
    compute: Any = _in_store if is_stored else _in_memory
    names = ("rtol", "atol") if is_motion else ("save_every", "method", "attitude")
    settings = {name: getattr(options, name) for name in names}
    settings = {name: value for name, value in settings.items() if value is not None}
    settings["progress"] = os.isatty(2) and find_spec("tqdm") is not None
    if is_motion:
        points = checks.integer("points", 101 if options.points is None else options.points, 1)
        settings["time"] = np.linspace(0.0, checks.real_number("time", options.time), points)
        if len(settings.get("atol", ())) == 1:
            [settings["atol"]] = settings["atol"]
    steps = 1000 if options.steps is None else options.steps
    checked_counts(steps, options.save_every)
    work = (body, starts) if is_motion else (body, starts, eps, steps)
    try:
        facts = compute(path, options.force, work, settings)
    except KeyboardInterrupt:
        kept = "keeps its tiles; the same command goes on" if is_stored else "was not written"
        raise KeyboardInterrupt(f": {path} {kept}" if path else "") from None
    facts["threads"] = numba.get_num_threads()
    print(json.dumps(facts), flush=True)
    if facts["trajectories"] and not any(sf.Status[name] >= 0 for name in facts["status"]):
        raise ArithmeticError("run: all trajectories failed")


def _starts(options: argparse.Namespace, body: Any) -> Any:
    """Return the initial states: RandomStarts, or an array, memory-mapped if from a file."""
    import numpy as np

    from .. import checks

    path, states = options.initial, options.omega0
    if not (path or states):
        count = checks.integer("--trajectories", options.trajectories, 1)
        low, high, extent, seed = options.low, options.high, options.extent, options.seed or 0
        if low is None and high is None:
            return sf.RandomStarts(count, 2.0 if extent is None else extent, seed)
        if low is None or high is None or extent is not None:
            options.usage_error("arguments --low and --high belong together, without --extent")
        low, high = (ends[0] if len(ends) == 1 else ends for ends in (low, high))
        return sf.RandomStarts(count, seed=seed, low=low, high=high)
    if (options.extent, options.seed, options.low, options.high) != (None,) * 4:
        options.usage_error(
            "arguments --extent, --low, --high and --seed are for random states: leave out "
            "--initial and --omega0"
        )
    name = str(path or "--omega0")
    with about(name):
        if path:
            try:
                states = np.asarray(np.lib.format.open_memmap(path, mode="r"))
            except (ValueError, EOFError) as error:
                text = "not a complete file of numpy.save"
                how = f"save an array of numbers of shape (count, {body.dimension})"
                raise ValueError(f"{text}: {how}") from error
        elif wrong := next((row for row in states if len(row) != body.dimension), None):
            example, given = (
                ",".join(f"{x:g}" for x in row) for row in ([1.0] * body.dimension, wrong)
            )
            raise ValueError(
                f"--omega0 must be {body.dimension} numbers, such as {example}, not {given}"
            )
        return checks.states(name, checks.real_array(name, states), body.labels)


def _in_memory(path: Path | None, force: bool, work: Any, settings: Any) -> dict[str, Any]:
    """Compute a run in memory, save it if there is a path, and return its summary."""
    _check_writable(path, force)
    body, starts, *others = work
    if isinstance(starts, sf.RandomStarts):
        starts = starts.states(starts.shape[0], dimension=body.dimension)
    compute: Any = _along_map if others else _motion
    result, facts = compute(body, starts, *others, settings)
    if path is not None:
        result.save(path, overwrite=force)
        facts["written"] = str(path)
    return facts


def _along_map(body: Any, starts: Any, eps: Any, steps: int, settings: Any) -> tuple[Any, Any]:
    """Return a run of a map, and its summary."""
    from ..engine.threads import CROSSOVER

    settings = {"save_every": None, "on_singular": "ignore", **settings}
    few = min(max(1, steps), CROSSOVER // max(1, len(starts)) + 1)
    short = settings | {"progress": None}
    _tell_if_long(lambda steps: sf.iterate(body, starts, eps, steps, **short), few, steps)
    seconds, result = _seconds(partial(sf.iterate, body, starts, eps, steps, **settings))
    failed = result.status < 0
    computed = (failed * result.failed_at + ~failed * steps).sum()
    rate = {"seconds": seconds, "steps_per_second": float(computed) / seconds}
    return result, facts_of(result, starts) | rate


def _motion(body: Any, starts: Any, settings: Any) -> tuple[Any, Any]:
    """Return a motion, and its summary."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sf.PoleWarning)  # the summary counts them
        short = settings | {"progress": None}
        few = min(_FEW, len(starts))
        if few < len(starts):
            _tell_if_long(lambda count: sf.flow(body, starts[:count], **short), few, len(starts))
        seconds, result = _seconds(partial(sf.flow, body, starts, **settings))
    return result, facts_of(result) | {"seconds": seconds}


def _seconds(function: Callable[[], Any]) -> tuple[float, Any]:
    """Return how long a call takes, and its result."""
    begin = time.perf_counter()
    result = function()
    return time.perf_counter() - begin, result


def _tell_if_long(call: Callable[[int], Any], part: int, whole: int) -> None:
    """Compute a part, which compiles and starts the threads, and say if the whole takes long."""
    call(part)
    while (seconds := _seconds(partial(call, part))[0]) < LONG / 100 and part < whole:
        part = min(whole, 4 * part)
    if seconds * whole / part > LONG:  # it may have compiled only then
        seconds = min(seconds, _seconds(partial(call, part))[0])
    seconds *= whole / part
    if seconds > LONG:
        units = (86_400, "days"), (3_600, "hours"), (60, "minutes")
        size, unit = next((each for each in units if seconds >= 2 * each[0]), (1, "seconds"))
        _tell(f"this takes about {seconds / size:.0f} {unit}; Ctrl-C ends it")


def _check_writable(path: Path | None, force: bool) -> None:
    """Raise an error if a file cannot be written."""
    if path is not None:
        _require_new([path], force)
        if path.is_dir():
            raise IsADirectoryError(f"{path} is a folder: choose the name of a file")
        if not os.access(f"{path.absolute().parent}/", os.W_OK):
            folder = path.absolute().parent
            how = "choose another folder" if folder.exists() else f"make the folder {folder}"
            raise PermissionError(f"{path}: nothing can be written there: {how}")


def _in_store(path: Path, force: bool, work: Any, settings: Any) -> dict[str, Any]:
    """Compute the missing tiles of a run in a store, and return its summary."""
    if force and path.exists():
        sf.open_ensemble(path)  # raises an error unless it is the store of a run
        try:
            shutil.rmtree(path)
        except OSError as error:  # whose name is that of an entry in the store
            raise OSError(error.errno, f"not replaced: {error.strerror}", str(path)) from error
    seconds, _ = _seconds(partial(sf.ensemble, *work, store=path, **settings))
    return facts_in(path) | {"seconds": seconds, "written": str(path)}


def _require_new(paths: Sequence[Path], force: bool) -> None:
    """Raise an error if a file exists, unless it may be replaced."""
    for path in [] if force else filter(Path.exists, paths):
        raise FileExistsError(f"{path} exists: choose a new name, or add --force to replace it")


def info(options: argparse.Namespace) -> int:
    """Print a JSON object for each saved run, with the largest relative drift of an integral."""
    failed = 0
    for path in options.file:
        try:
            facts = {"file": str(path), **facts_in(path)}
        except Exception as error:
            _tell(text_of(error, path))
            failed = 1
        else:
            print(json.dumps(facts), flush=True)
    return failed


def plot(options: argparse.Namespace) -> None:
    """Draw a saved run, or saved crossings, as PNG, SVG or PDF."""
    if options.output.suffix.lower() not in _ENDINGS:
        ends = "must end in .png, .svg or .pdf"
        options.usage_error(f"argument -o/--output: '{options.output}' {ends}")
    _check_writable(options.output, options.force)
    from ..runs.drawing import plt
    from ..runs.files.storage import load

    result = load(options.file)
    if len(result) == 1:
        _tell("the file holds one state of each trajectory: --save-every of run keeps more")
    figure = result.plot(*options.names).figure
    with about(options.output):
        figure.savefig(options.output, dpi=150)
        plt.close()
    print(options.output, flush=True)


def report(options: argparse.Namespace) -> None:
    """Report what a Kahan map conserves: integrals, measures, growth of degrees.

    Decimals are read as they are written, 0.1 as 1/10. Without --eps, eps stays symbolic, and
    formulas hold for every step size. Needs python-flint.
    """
    from ..integrability import report as report_of

    def show(result: Any) -> None:
        print(json.dumps(result.to_dict()) if options.json else repr(result), flush=True)

    # Always with a limit: the search then runs in another process, and Ctrl-C ends it at once.
    limit = _NO_LIMIT if options.time_limit is None else options.time_limit
    try:
        body, eps = body_and_step(options, needs_step=False)
        if isinstance(body, sf.Field):
            options.usage_error("the right-hand sides must be polynomials of degree 2 at most")
        show(report_of(body, eps, options.degree, time_limit=limit))
    except KeyboardInterrupt as error:
        if hasattr(error, "report"):  # results so far
            show(error.report)
        raise


def figures(options: argparse.Namespace) -> None:
    """Draw the four figures of the paper as PNG. The gallery of the documentation has others."""
    if options.output.suffix:
        how = "a folder, of figure1.png to figure4.png"
        options.usage_error(f"argument -o/--output: '{options.output}' must be {how}")
    from ..bodies.rigid import FIGURES
    from ..plots.phase import plot_phase
    from ..runs.drawing import plt

    paths = [options.output / f"figure{number}.png" for number in FIGURES]
    _require_new(paths, options.force)
    options.output.mkdir(parents=True, exist_ok=True)
    for path, figure in zip(paths, FIGURES.values(), strict=True):
        plot_phase(*figure).figure.savefig(path, dpi=150)
        plt.close()
    print(*paths, sep="\n", flush=True)


def explore(options: argparse.Namespace) -> None:
    """Vary a field or a body, a step size and starts on a page in the browser, until Ctrl-C."""
    import webbrowser

    from ..plots.explore.server import Page

    if not 0 <= options.port < 2**16:
        options.usage_error(f"argument --port: {options.port} is not from 0 to 65535")
    body = body_of(options)
    page = Page("") if body is None else sf.explore(body)
    with about(f"--port {options.port}"):
        server = page.serve(options.port)
    url = page.address(server)
    with suppress(KeyboardInterrupt), server:
        print(url, flush=True)
        if not options.no_browser:  # in a thread, because opening a browser may block
            threading.Thread(target=webbrowser.open, args=[url], daemon=True).start()
        server.serve_forever(poll_interval=0.1)


def warm_up(options: argparse.Namespace) -> None:
    """Compile everything in advance, so that later processes read it from disk."""
    from .warm_up import call_all, where_code_is_kept

    call_all()
    print(where_code_is_kept())
