"""Compare two revisions of the package in one run; exit status 1 if the second is slower.

`python bench/compare.py REV_A REV_B` checks both out beside the repository (`.` is the working
tree) and runs the benchmarks of the working tree against each in turn, several rounds, the order
changing from round to round. The best time of each benchmark counts. What looks slower than the
threshold is measured again, in up to twice as many rounds, before it is called so. What takes long
is measured in the first round alone. A benchmark that runs with A and fails with B counts as
slower; one that A cannot run has nothing to be compared with. `revision.py` adapts to version 0.1.
"""

import argparse
import contextlib
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from measuring import BENCH, run_pytest
from results import Whose, load

ROOT = BENCH.parent


def resolve(revision):
    """The commit that a revision names; `.` stays."""
    if revision == ".":
        return "."
    command = ["git", "-C", str(ROOT), "rev-parse", "--verify", "--quiet", f"{revision}^{{commit}}"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"compare.py: no such revision: {revision}")
    return done.stdout.strip()


@contextlib.contextmanager
def checked_out(commit, folder):
    """A folder with the package of that commit; gone afterwards, also after Ctrl-C."""
    if commit == ".":
        yield ROOT
        return
    git = ["git", "-C", str(ROOT), "worktree"]
    try:
        subprocess.run([*git, "add", "--quiet", "--detach", str(folder), commit], check=True)
        yield folder
    finally:
        subprocess.run([*git, "remove", "--force", str(folder)], check=False)


def measure(label, tree, folder, *options, names=None):
    """One round with the package of `tree`: seconds by benchmark, of all or of those names."""
    target = Path(folder) / "round.json"
    target.unlink(missing_ok=True)
    tests = [str(BENCH / name) for name in (names or [""])]
    done = run_pytest(
        target,
        tests,
        *options,
        env={"PYTHONPATH": str(tree)},
        cwd=folder,  # pytest would import the package from a checkout that it is run in
        capture_output=True,
        text=True,
    )
    found = re.search(r"^suslov_fast \S+ from (.*)$", done.stdout, re.MULTILINE)
    if not found or Path(found[1]).resolve() != (Path(tree) / "suslov_fast").resolve():
        raise SystemExit(f"compare.py: {label} did not import its package:\n{done.stdout[-3000:]}")
    if not target.exists():
        raise SystemExit(f"compare.py: no benchmark ran with {label}:\n{done.stdout[-3000:]}")
    failed = re.findall(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE)
    print(f"  {label}: {found[0]}", *(f"\n    fails: {name}" for name in failed), flush=True)
    rows = load(target).rows
    return {row.name: 1 / row.rate for row in rows if row.whose is Whose.OURS}


def keep_best(best, times):
    """Lower the best times to those of another round."""
    for name, seconds in times.items():
        best[name] = min(seconds, best.get(name, seconds))


def slower(best_a, best_b, threshold):
    """Names of benchmarks that take more than `threshold` times as long with B, or fail there."""
    return sorted(
        name for name, a in best_a.items() if best_b.get(name, float("inf")) > threshold * a
    )


def table(best_a, best_b, threshold):
    """Times per unit of work, their ratio, and what is slower, in plain text."""
    names = sorted(best_a.keys() | best_b.keys())
    width = max(map(len, names), default=0)
    lines = [f"{'benchmark':{width}}  {'A':>10}  {'B':>10}  {'B / A':>6}"]
    late = set(slower(best_a, best_b, threshold))
    for name in names:
        a, b = best_a.get(name), best_b.get(name)
        ratio = f"{b / a:6.3f}" if a and b else "     -"
        times = "  ".join(f"{each * 1e9:10.4g}" if each else f"{'fails':>10}" for each in (a, b))
        lines.append(f"{name:{width}}  {times}  {ratio}{'  SLOWER' * (name in late)}")
    return "\n".join(
        [*lines, "Nanoseconds for each unit of work: step, state, jump, call, process."]
    )


def compare(trees, rounds, threshold, select, folder):
    """Best times with A and with B, after so many rounds, and more for what looks slower."""
    best = {"A": {}, "B": {}}
    names, chosen = None, ["-k", select] if select else []
    for k in range(3 * rounds):
        marked = ["-m", "not other and not once" if k else "not other"]
        if k >= rounds:
            names = [name for name in slower(best["A"], best["B"], threshold) if name in best["B"]]
            if not names:
                break
            marked, chosen = [], []
            print(f"again: {len(names)}", flush=True)
        for label in "AB" if k % 2 == 0 else "BA":
            found = measure(label, trees[label], folder, *marked, *chosen, names=names)
            keep_best(best[label], found)
    return best["A"], best["B"]


def main():
    """Compare, print, and tell by the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("revisions", nargs=2, metavar="REV", help="a revision, or . as it is here")
    parser.add_argument("--threshold", type=float, default=1.1, help="B / A that is slower (1.1)")
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("-k", dest="select", help="only benchmarks that match, as for pytest")
    options = parser.parse_args()
    commits = [resolve(revision) for revision in options.revisions]
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        trees = {}
        for label, revision, commit in zip("AB", options.revisions, commits, strict=True):
            trees[label] = stack.enter_context(checked_out(commit, Path(folder) / label))
            print(f"{label}: {revision}" + (f" = {commit[:10]}" if commit != "." else ""))
        a, b = compare(trees, options.rounds, options.threshold, options.select, folder)
    print(table(a, b, options.threshold))
    late = slower(a, b, options.threshold)
    both = len(a.keys() & b.keys())
    print(f"{len(late)} of {both} slower than {options.threshold:g} times A")
    return 1 if late else 0


if __name__ == "__main__":
    sys.exit(main())
