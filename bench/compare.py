"""Compare two revisions in one run; exit status 1 if the second is slower than allowed, 2 if a case
fails in one of them or nothing was compared.

`python bench/compare.py REV_A [REV_B]` extracts both revisions (a folder is used as it is; the
default of REV_B is this working tree). One process per revision runs the cases of this working
tree, in turns A B, B A, and so on: the speed of a machine varies over seconds, so that only ratios
from one run are meaningful. A case is too slow if the median of the ratios B / A and the ratio of
the minima exceed `--threshold`, and exceed it again in longer turns. Cases that fail in one of the
revisions are listed; if a revision lacks a name, only the cases that use the name fail.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from statistics import median

BENCH = Path(__file__).parent
TURN, TURNS = 0.05, 7  # seconds of a turn, at least, and number of turns
AGAIN = 4  # times as long are the turns of a case that seemed too slow
NOW = {}  # in the process of one revision: its case and its clock


def begin(tree):
    """Use the package of a folder in this process."""
    # Threads that wait for work would take processor time from the other process.
    os.environ |= {"PYTHONPATH": str(tree), "OMP_WAIT_POLICY": "passive"}
    sys.path[:0] = [str(tree), str(BENCH)]


def prepare(name, module, part, cpu):
    """Make a case, a `part`-th of its size, compile it, and return the seconds of a call."""
    import numba
    import work
    from cases import of

    NOW.clear()  # frees the memory of the previous case
    case = of(module)[name]
    numba.set_num_threads(1 if case.one_thread else int(numba.config.NUMBA_NUM_THREADS))
    NOW["clock"] = work.cpu_seconds if cpu else case.clock
    NOW["call"] = case.make(lambda full, small: max(full // part, min(full, small))).call
    if not case.is_slow:
        NOW["call"]()
    return seconds(1)


def seconds(calls):
    """Seconds per call."""
    start = NOW["clock"]()
    for _ in range(calls):
        NOW["call"]()
    return (NOW["clock"]() - start) / calls


class Failed(Exception):
    """What a case raised, by the revision."""


def ask(workers, *call):
    """Call a function in the processes of some revisions at once, and return what it returns."""
    found, errors = {}, {}
    for which, worker in workers.items():
        try:
            found[which] = worker.submit(*call)
        except BrokenExecutor as error:  # the process died in an earlier call
            errors[which] = error
    errors |= {which: each.exception() for which, each in found.items() if each.exception()}
    if errors:
        raise Failed(errors)
    return [each.result() for each in found.values()]


def turns(workers, longest, turn):
    """Measure seconds per call of the case in turns; return lists for A and B."""
    found, calls = {"A": [], "B": []}, max(1, round(turn / max(longest, 1e-6)))
    for k in range(TURNS if longest < 1 else 1):
        for which in "AB" if k % 2 == 0 else "BA":
            found[which] += ask({which: workers[which]}, seconds, calls)
    return found.values()


def ratios(a, b):
    """Median of the ratios B / A of all turns, and ratio of the minima."""
    return median(y / x for x, y in zip(a, b, strict=True)), min(b) / min(a)


def compare(workers, chosen, options):
    """Print the times of cases; return names of slow and of failed cases, and the number compared.

    `chosen` maps names of cases to their modules.
    """
    too_slow, failed, compared = [], {"A": [], "B": []}, 0
    part = 4 if options.quick else 1
    print(f"{'case':32}{'A':>11}{'B':>11} ns  medians  minima", flush=True)
    for name, module in chosen.items():
        try:
            longest = max(ask(workers, prepare, name, module, part, options.cpu))
            a, b = turns(workers, longest, TURN)
            if min(ratios(a, b)) > options.threshold:  # which may be noise
                a, b = turns(workers, longest, AGAIN * TURN)
        except Failed as errors:
            for which, error in errors.args[0].items():
                print(f"{name:32}fails in {which}: {type(error).__name__}: {error}", flush=True)
                failed[which].append(name)
            continue
        compared += 1
        of_medians, of_minima = ratios(a, b)
        numbers = f"{1e9 * median(a):11.4g}{1e9 * median(b):11.4g}"
        is_slower = min(of_medians, of_minima) > options.threshold
        mark = "  SLOWER" if is_slower else ""
        print(f"{name:32}{numbers}   {of_medians:8.2f}{of_minima:8.2f}{mark}", flush=True)
        if is_slower:
            too_slow.append(name)
    return too_slow, failed, compared


def extracted(revision):
    """The folder `revision`, or one with the package of that revision, which later runs use too."""
    if (Path(revision) / "suslov_fast").is_dir():
        return Path(revision).resolve()
    git = ["git", "-C", str(BENCH.parent)]
    asked = [*git, "rev-parse", "--verify", f"{revision}^{{commit}}"]
    commit = subprocess.run(asked, capture_output=True, text=True).stdout.strip()
    if not commit:
        print(f"no such revision or folder with the package: {revision}", file=sys.stderr)
        raise SystemExit(2)
    folder = Path(tempfile.gettempdir()) / f"suslov_fast-{commit}"
    folder.mkdir(exist_ok=True)
    packed = subprocess.run(
        [*git, "archive", commit, "suslov_fast"], capture_output=True, check=True
    )
    subprocess.run(["tar", "-x", "-C", str(folder)], input=packed.stdout, check=True)
    return folder


def main(arguments=None):
    """Compare, print, and return the exit status."""
    from cases import of, places  # not in the processes of the revisions, before `begin`

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("a", metavar="REV", help="a revision, or a folder")
    parser.add_argument("b", metavar="REV", nargs="?", default=BENCH.parent, help="(this tree)")
    parser.add_argument("--quick", action="store_true", help="a small case of each table")
    parser.add_argument("--cpu", action="store_true", help="compare processor time")
    parser.add_argument("--threshold", type=float, default=1.2, help="what B / A may be (1.2)")
    parser.add_argument("-k", dest="select", default="", help="only cases with this in their name")
    options = parser.parse_args(arguments)
    pools = {}
    for which, revision in zip("AB", (options.a, options.b), strict=True):
        some = {"mp_context": get_context("spawn"), "initargs": [extracted(revision)]}
        pools[which] = ProcessPoolExecutor(1, initializer=begin, **some)
    is_ours = lambda name, module: of(module)[name].whose == "this package"  # noqa: E731
    chosen = {each: module for each, module in places().items() if options.select in each}
    chosen = {each: module for each, module in chosen.items() if is_ours(each, module)}
    if options.quick:
        kept = {name.partition("-")[0]: name for name in [*chosen][::-1]}.values()
        chosen = {name: module for name, module in chosen.items() if name in kept}
    too_slow, failed, compared = compare(pools, chosen, options)
    for pool in pools.values():
        pool.shutdown()
    lists = {"slower than allowed": too_slow}
    lists |= {f"failed in {which}": names for which, names in failed.items() if names}
    for what, names in lists.items():
        print("\n  ".join([f"\n{len(names)} {what}", *names]))
    if not compared:
        print("no case was compared")
    return 2 if any(failed.values()) or not compared else 1 if too_slow else 0


if __name__ == "__main__":
    sys.exit(main())
