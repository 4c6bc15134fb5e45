"""Compare two revisions in one run; exit status 1 if the second is slower than allowed.

`python bench/compare.py REV_A [REV_B]` extracts both revisions (a folder is used as it is; the
default of REV_B is this working tree). One process per revision runs the cases of this working
tree, in turns A B, B A, and so on: the speed of a machine varies over seconds, so that only ratios
from one run are meaningful. A case is too slow if both the median of the ratios B / A and the ratio
of the minima exceed `--threshold`, and do so again in four times as many turns. A case that fails
in A is not compared; a case that fails in B alone counts as too slow. `--quick` runs the first case
of each table.
"""

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import numba
from cases import CASES

import suslov_fast

BENCH = Path(__file__).parent
TURN = 0.02  # minimum seconds per turn


def serve():
    """Run the cases requested on standard input, in the process of one revision."""
    print(json.dumps(suslov_fast.__path__[0]), flush=True)
    current = None
    for line in sys.stdin:
        index, calls = json.loads(line)
        try:
            if calls == 0:
                case, current = CASES[index], None  # frees the memory of the previous case
                threads = 1 if case.threads == "one" else numba.config.NUMBA_NUM_THREADS
                numba.set_num_threads(threads)
                current = case.make(lambda full, small: full, threads)
                current.call()  # compiles
            begin = time.perf_counter()
            for _ in range(max(calls, 1)):
                current.call()
            answer = (time.perf_counter() - begin) / max(calls, 1)
        except Exception as error:
            answer = f"{type(error).__name__}: {error}"
        time.sleep(0.005)  # until the threads of this process stop spinning
        print(json.dumps(answer), flush=True)


class Worker:
    """The process of one revision."""

    def __init__(self, tree, cache):
        environment = os.environ | {"PYTHONPATH": str(tree), "NUMBA_CACHE_DIR": str(cache)}
        command = [sys.executable, str(BENCH / "compare.py"), "--work"]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self.process = subprocess.Popen(command, env=environment, **pipes)
        found = self.receive()
        if Path(found).resolve() != (Path(tree) / "suslov_fast").resolve():
            raise SystemExit(f"compare.py: expected the package of {tree}, got {found}")

    def send(self, *message):
        self.process.stdin.write(json.dumps(message) + "\n")
        self.process.stdin.flush()

    def receive(self):
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit("compare.py: a process ended early")
        return json.loads(line)


def turns(workers, index, rounds):
    """Measure seconds per call of a case in turns; return lists for A and B, or errors."""
    for worker in workers:
        worker.send(index, 0)  # both compile at once
    first = [worker.receive() for worker in workers]
    if any(isinstance(each, str) for each in first):
        return first
    calls = max(1, round(TURN / max(first)))
    found = [[], []]
    for k in range(rounds):
        for which in (0, 1) if k % 2 == 0 else (1, 0):
            workers[which].send(index, calls)
            found[which].append(workers[which].receive())
    return found


def ratios(a, b):
    """Return the median of the ratios B / A of all turns, and the ratio of the minima."""
    return median(y / x for x, y in zip(a, b, strict=True)), min(b) / min(a)


def compare(workers, chosen, rounds, threshold):
    """Print the times of the chosen cases; return the names of those that are too slow."""
    too_slow = []
    print(f"{'case':44}{'A':>11}{'B':>11} ns  medians  minima", flush=True)
    for index, case in chosen:
        for more in (1,) if case.slow else (rounds, 4 * rounds):
            found = turns(workers, index, more)
            if any(isinstance(each, (str, float)) for each in found):
                late, verdict = isinstance(found[0], float), "; ".join(map(str, found))
                break
            ratio, minima = ratios(*found)
            late = min(ratio, minima) > threshold
            times = "".join(f"{1e9 * median(each):11.4g}" for each in found)
            verdict = f"{times}   {ratio:8.2f}{minima:8.2f}"
            if not late:
                break
        too_slow += [case.name] * late
        print(f"{case.name:44}{verdict}{'  SLOWER' * late}", flush=True)
    return too_slow


def extracted(revision, folder):
    """Return the folder `revision`, or extract that revision of the package into a folder."""
    if (Path(revision) / "suslov_fast").is_dir():
        return Path(revision).resolve()
    command = ["git", "-C", str(BENCH.parent), "archive", str(revision), "suslov_fast"]
    archive = subprocess.run(command, capture_output=True)
    if archive.returncode:
        raise SystemExit(f"compare.py: no such revision or folder with the package: {revision}")
    folder.mkdir()
    subprocess.run(["tar", "-x", "-C", str(folder)], input=archive.stdout, check=True)
    return folder


def main(arguments=None):
    """Compare, print, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("a", metavar="REV", help="a revision, or a folder")
    parser.add_argument("b", metavar="REV", nargs="?", default=BENCH.parent, help="(this tree)")
    parser.add_argument("--quick", action="store_true", help="one case of each table")
    parser.add_argument("--threshold", type=float, default=1.2, help="what B / A may be (1.2)")
    parser.add_argument("-k", dest="select", default="", help="only cases with this in their name")
    options = parser.parse_args(arguments)
    chosen = [(k, case) for k, case in enumerate(CASES) if options.select in case.name]
    if options.quick:
        chosen = list({case.table: (k, case) for k, case in reversed(chosen)}.values())
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        workers = []
        for label, revision in (("A", options.a), ("B", options.b)):
            tree = extracted(revision, folder / label)
            print(f"{label}: {revision}", flush=True)
            workers.append(Worker(tree, folder / f"cache-{label}"))
            stack.callback(workers[-1].process.communicate)
        too_slow = compare(workers, chosen, 5 if options.quick else 9, options.threshold)
    print(f"\n{len(too_slow)} slower than allowed" + "".join(f"\n  {name}" for name in too_slow))
    return 1 if too_slow else 0


if __name__ == "__main__":
    serve() if sys.argv[1:] == ["--work"] else sys.exit(main())
