"""Compare two revisions in one run; exit status 1 if the second is slower than allowed.

`python bench/compare.py REV_A [REV_B]` checks out both revisions (a folder is used as it is; the
default of REV_B is this working tree). One process per revision runs the cases of this working
tree, in turns A B, B A, and so on: the speed of a machine varies over seconds, so that only ratios
from one run are meaningful. A case is too slow if both the median of the ratios B / A and the ratio
of the minima exceed the limit of the case, or `--threshold` for all cases. A case that fails in A
is not compared; a case that fails in B alone counts as too slow. Finally, whole processes of each
revision are timed, in multiples of `import numba`. `--quick` runs one case for each limit (2 to 4
minutes, mostly for compiling both revisions).
"""

import argparse
import compileall
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import processes

BENCH = Path(__file__).parent
TURN = 0.02  # minimum seconds per turn


def serve():
    """Run the cases requested on standard input, in the process of one revision."""
    import numba
    from cases import CASES

    import suslov_fast

    print(json.dumps(suslov_fast.__path__[0]), flush=True)
    current = None
    for line in sys.stdin:
        index, calls, tiny = json.loads(line)
        try:
            if calls == 0:
                case, current = CASES[index], None  # frees the memory of the previous case
                threads = 1 if case.threads == "one" else numba.config.NUMBA_NUM_THREADS
                numba.set_num_threads(threads)
                current = case.make(min if tiny else lambda large, _: large, threads)
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

    def __init__(self, tree, folder):
        path = os.pathsep.join([str(tree), str(BENCH)])
        environment = os.environ | {"PYTHONPATH": path, "NUMBA_CACHE_DIR": str(folder)}
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

    def close(self):
        self.process.communicate()


def in_order(k):
    """Order of the revisions in turn k: A B, B A, ..."""
    return (0, 1) if k % 2 == 0 else (1, 0)


def turns(workers, index, rounds, tiny):
    """Measure seconds per call of a case in turns; return lists for A and B, or errors."""
    for worker in workers:
        worker.send(index, 0, tiny)  # both compile at once
    first = [worker.receive() for worker in workers]
    if any(isinstance(each, str) for each in first):
        return first
    calls = max(1, round(TURN / max(first)))
    found = [[], []]
    for k in range(rounds):
        for which in in_order(k):
            workers[which].send(index, calls, tiny)
            found[which].append(workers[which].receive())
    return found


def ratios(a, b):
    """Return the median of the ratios B / A of all turns, and the ratio of the minima."""
    return median(y / x for x, y in zip(a, b, strict=True)), min(b) / min(a)


def compare_cases(trees, folder, rounds, chosen, threshold, tiny):
    """Print the times of the chosen cases; return the names of those that are too slow."""
    too_slow = []
    with contextlib.ExitStack() as stack:
        workers = [Worker(tree, folder / f"cache-{k}") for k, tree in enumerate(trees)]
        for worker in workers:
            stack.callback(worker.close)
        print(f"{'case':44}{'A':>11}{'B':>11} ns  medians  minima  at most", flush=True)
        for index, case in chosen:
            found = turns(workers, index, rounds, tiny)
            if isinstance(found[0], str) or isinstance(found[1], str):
                print(f"{case.name:44}" + "; ".join(str(each) for each in found), flush=True)
                too_slow += [case.name] * isinstance(found[0], float)
                continue
            ratio, minima = ratios(*found)
            at_most = threshold or case.at_most
            late = min(ratio, minima) > at_most
            too_slow += [case.name] * late
            times = "".join(f"{1e9 * median(each):11.4g}" for each in found)
            verdict = f"{ratio:8.2f}{minima:8.2f}{at_most:9.4g}{'  SLOWER' * late}"
            print(f"{case.name:44}{times}   {verdict}", flush=True)
    return too_slow


def compare_processes(trees, folder, rounds, quick):
    """Print times of processes in multiples of `import numba`; return those that are too slow."""
    times = {}

    def measure(which, key, label, code, at_most, cache=None):
        seconds = processes.run(code, trees[which], cache)
        times.setdefault((key, label, at_most), ([], []))[which].append(seconds)

    for tree in trees:  # installed packages have bytecode
        compileall.compile_dir(Path(tree) / "suslov_fast", quiet=2)
    for k in range(rounds):
        for key, (label, code, at_most) in processes.IMPORTS.items():
            for which in in_order(k):
                measure(which, key, label, code, at_most)
    for k in range(1 if quick else 2):
        for key, (label, call) in processes.CALLS.items():
            for which in in_order(k) if not (quick and key == "exact") else ():
                cache, code = folder / f"{which}-{key}-{k}", processes.IMPORT + call
                measure(which, f"{key}-first", f"{label}, first", code, processes.FIRST, cache)
                for _ in range(2):
                    measure(which, f"{key}-again", f"{label}, again", code, processes.SECOND, cache)
    return report_processes(times)


def report_processes(times):
    """Print minima in seconds and in multiples of `import numba`; return the slow ones."""
    best = {key: (label, at_most, *map(min, both)) for (key, label, at_most), both in times.items()}
    too_slow = []
    print(f"\n{'process':44}{'A':>11}{'B':>11} s, x numba: A       B  at most")
    for key, (label, at_most, a, b) in best.items():
        of_a, of_b = a / best["import-numba"][2], b / best["import-numba"][3]
        late = at_most is not None and of_b > at_most
        too_slow += [key] * late
        allowed = f"{at_most or '':>9}{'  SLOWER' * late}"
        print(f"{label:44}{a:11.3g}{b:11.3g}   {of_a:11.2f}{of_b:8.2f}{allowed}", flush=True)
    return too_slow


@contextlib.contextmanager
def checked_out(revision, folder):
    """Yield the folder `revision`, or a folder with that revision of the package."""
    if (Path(revision) / "suslov_fast").is_dir():
        yield Path(revision).resolve()
        return
    git = ["git", "-C", str(BENCH.parent), "worktree"]
    command = [*git, "add", "--quiet", "--detach", str(folder), revision]
    if subprocess.run(command, capture_output=True).returncode:
        raise SystemExit(f"compare.py: no such revision or folder with the package: {revision}")
    try:
        yield folder
    finally:
        subprocess.run([*git, "remove", "--force", str(folder)], check=False)


def main(arguments=None):
    """Compare, print, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("a", metavar="REV", help="a revision, or a folder")
    parser.add_argument("b", metavar="REV", nargs="?", default=BENCH.parent, help="(this tree)")
    parser.add_argument("--quick", action="store_true", help="one case for each allowance")
    parser.add_argument("--rounds", type=int, help="turns of each case (9; quick: 5)")
    parser.add_argument("--threshold", type=float, help="what B / A may be, for all cases")
    parser.add_argument("-k", dest="select", default="", help="only cases with this in their name")
    parser.add_argument("--no-processes", action="store_true", help="only cases")
    parser.add_argument("--tiny", action="store_true", help="tiny problems, to try this script")
    options = parser.parse_args(arguments)
    from cases import CASES

    chosen = [
        (index, case)
        for index, case in enumerate(CASES)
        if options.select in case.name and (case.quick or not options.quick)
    ]
    rounds = options.rounds or (5 if options.quick else 9)
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        trees = []
        for label, revision in (("A", options.a), ("B", options.b)):
            trees.append(stack.enter_context(checked_out(revision, folder / label)))
            print(f"{label}: {revision}", flush=True)
        too_slow = compare_cases(trees, folder, rounds, chosen, options.threshold, options.tiny)
        if not options.no_processes:
            too_slow += compare_processes(trees, folder, min(rounds, 3), options.quick)
    print(f"\n{len(too_slow)} slower than allowed" + "".join(f"\n  {name}" for name in too_slow))
    return 1 if too_slow else 0


if __name__ == "__main__":
    serve() if sys.argv[1:] == ["--work"] else sys.exit(main())
