"""Compare two revisions in one run; exit status 1 if the second is slower than allowed.

`python bench/compare.py REV_A [REV_B]` extracts both revisions (a folder is used as it is; the
default of REV_B is this working tree). One process per revision runs the cases of this working
tree, in turns A B, B A, and so on: the speed of a machine varies over seconds, so that only ratios
from one run are meaningful. A case is too slow if both the median of the ratios B / A and the ratio
of the minima exceed `--threshold`, and do so again in longer turns; one that fails in a revision is
not compared.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
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


def prepare(name, part, cpu):
    """Make a case, a `part`-th of its size, compile it, and return the seconds of a call."""
    import numba
    from cases import CASES, work

    NOW.clear()  # frees the memory of the previous case
    case = next(case for case in CASES if case.name == name)
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


def turns(workers, name, options, turn):
    """Measure seconds per call of a case in turns; return lists for A and B."""
    part = 4 if options.quick else 1
    both = [worker.submit(prepare, name, part, options.cpu) for worker in workers]
    longest = max(each.result() for each in both)
    found, calls = [[], []], max(1, round(turn / max(longest, 1e-6)))
    for k in range(TURNS if longest < 1 else 1):
        for which in (0, 1) if k % 2 == 0 else (1, 0):
            found[which].append(workers[which].submit(seconds, calls).result())
    return found


def ratios(a, b):
    """Median of the ratios B / A of all turns, and ratio of the minima."""
    return median(y / x for x, y in zip(a, b, strict=True)), min(b) / min(a)


def compare(workers, chosen, options):
    """Print the times of the chosen cases; return the names of those that are too slow."""
    too_slow, threshold = [], options.threshold
    print(f"{'case':32}{'A':>11}{'B':>11} ns  medians  minima", flush=True)
    for name in chosen:
        try:
            a, b = turns(workers, name, options, TURN)
            if min(ratios(a, b)) > threshold:  # which may be noise
                a, b = turns(workers, name, options, AGAIN * TURN)
        except Exception as error:
            print(f"{name:32}{type(error).__name__}: {error}", flush=True)
            continue
        of_medians, of_minima = ratios(a, b)
        numbers = f"{1e9 * median(a):11.4g}{1e9 * median(b):11.4g}"
        is_slower = min(of_medians, of_minima) > threshold
        mark = "  SLOWER" if is_slower else ""
        print(f"{name:32}{numbers}   {of_medians:8.2f}{of_minima:8.2f}{mark}", flush=True)
        if is_slower:
            too_slow.append(name)
    return too_slow


def extracted(revision):
    """The folder `revision`, or one with the package of that revision, which later runs use too."""
    if (Path(revision) / "suslov_fast").is_dir():
        return Path(revision).resolve()
    git = ["git", "-C", str(BENCH.parent)]
    asked = [*git, "rev-parse", "--verify", f"{revision}^{{commit}}"]
    commit = subprocess.run(asked, capture_output=True, text=True).stdout.strip()
    if not commit:
        raise SystemExit(f"compare.py: no such revision or folder with the package: {revision}")
    folder = Path(tempfile.gettempdir()) / f"suslov_fast-{commit}"
    folder.mkdir(exist_ok=True)
    packed = subprocess.run([*git, "archive", commit, "suslov_fast"], capture_output=True)
    subprocess.run(["tar", "-x", "-C", str(folder)], input=packed.stdout, check=True)
    return folder


def main(arguments=None):
    """Compare, print, and return the exit status."""
    from cases import CASES  # not in the processes of the revisions, before `begin`

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("a", metavar="REV", help="a revision, or a folder")
    parser.add_argument("b", metavar="REV", nargs="?", default=BENCH.parent, help="(this tree)")
    parser.add_argument("--quick", action="store_true", help="a small case of each table")
    parser.add_argument("--cpu", action="store_true", help="compare processor time")
    parser.add_argument("--threshold", type=float, default=1.2, help="what B / A may be (1.2)")
    parser.add_argument("-k", dest="select", default="", help="only cases with this in their name")
    options = parser.parse_args(arguments)
    pools = []
    for revision in (options.a, options.b):
        some = {"mp_context": get_context("spawn"), "initargs": [extracted(revision)]}
        pools.append(ProcessPoolExecutor(1, initializer=begin, **some))
    ours = [case.name for case in CASES if case.whose == "this package"]
    chosen = [name for name in ours if options.select in name]
    if options.quick:
        chosen = list({name.partition("-")[0]: name for name in chosen[::-1]}.values())[::-1]
    too_slow = compare(pools, chosen, options)
    for pool in pools:
        pool.shutdown()
    print(f"\n{len(too_slow)} slower than allowed" + "".join(f"\n  {name}" for name in too_slow))
    return 1 if too_slow else 0


if __name__ == "__main__":
    sys.exit(main())
