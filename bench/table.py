"""Measure this package beside its peers, and write the tables of the README.

`python bench/table.py` prints the tables; with `--write` it also replaces those in README.md.
All rows are measured in turn, in several rounds of one run; the best round counts.
"""

import argparse
import datetime
import platform
import sys
import time
from pathlib import Path

import numba
import numpy as np
from peers import (
    c_elimination,
    c_functions,
    numba_prange,
    numpy_batch,
    numpy_solve,
    python_loop,
)
from problem import BODY, EPS, problem_nd, starts

import suslov_fast

BATCH, STEPS, ROUNDS = 65_536, 1000, 9
# What is too slow for the whole problem solves a part of it.
PARTS = {"Python, (ds2)": (64, 1000), "NumPy over the batch, (ds2)": (65_536, 20)}
BEGIN, END = "<!-- begin of the table -->", "<!-- end of the table -->"


def ours(**options):
    """Final states, by this package."""
    return lambda omega0, steps: (
        suslov_fast.iterate(BODY, omega0, EPS, steps, save_every=None, **options).final
    )


CANDIDATES = {
    '**suslov_fast**, `method="auto"`': ours(),
    '**suslov_fast**, `method="canonical"`': ours(method="canonical"),
    '**suslov_fast**, `method="ds2"`': ours(method="ds2"),
    **c_functions(),
    "Numba, `prange` over trajectories, (ds2)": numba_prange,
    "NumPy over the batch, (ds2)": numpy_batch,
    "Python, (ds2)": python_loop,
}


def reference(omega0, steps):
    """Final states in long doubles, by the parameter-free form, for the errors."""
    I1, I2, I13, I23, eps = map(np.longdouble, (*BODY.parameters, EPS))
    w1, w2 = omega0.T.astype(np.longdouble)
    a, D = I1 * I2, I13**2 * I2 + I23**2 * I1
    X = eps * (I13 * w1 + I23 * w2) / np.sqrt(2 * a)
    Y = eps * (I23 * I1 * w1 - I13 * I2 * w2) / (2 * a)
    for _ in range(steps):
        X_next = X * (1 + Y) / (1 - Y + X * X)
        X, Y = X_next, Y - X * X_next
    x, y = X * np.sqrt(2 * a) / eps, Y * 2 * a / eps
    return np.stack([(I13 * I2 * x + I23 * y) / D, (I23 * I1 * x - I13 * y) / D], axis=-1)


def measure():
    """Steps per second and the largest relative error of each candidate."""
    best = dict.fromkeys(CANDIDATES, np.inf)
    error = {}
    exact = reference(starts(BATCH)[:512], STEPS)
    for name, call in CANDIDATES.items():
        computed = call(np.ascontiguousarray(starts(BATCH)[:512]), STEPS)
        size = np.hypot(*exact.T)
        error[name] = float((np.hypot(*(computed - exact).T) / size).max())
    for _ in range(ROUNDS):
        for name, call in CANDIDATES.items():
            batch, steps = PARTS.get(name, (BATCH, STEPS))
            omega0 = starts(batch)
            call(omega0, steps)  # wakes the threads, whoever ran before
            begin = time.perf_counter()
            call(omega0, steps)
            best[name] = min(best[name], (time.perf_counter() - begin) / (batch * steps))
    return {name: (1 / best[name], error[name]) for name in CANDIDATES}


def table(results):
    """The results in Markdown, fastest first."""
    base = results.get("C, (ds2) as printed", (np.nan,))[0]
    lines = [
        BEGIN,
        f"Final states of {BATCH:,} trajectories after {STEPS} steps on "
        f"{numba.config.NUMBA_NUM_THREADS} threads. Best of {ROUNDS} interleaved rounds; the error "
        "is the largest relative one of 512 trajectories.",
        "",
        "| | 1e9 steps/s | of C as printed | error |",
        "|---|---:|---:|---:|",
    ]
    for name, (rate, error) in sorted(results.items(), key=lambda item: -item[1][0]):
        lines.append(f"| {name} | {rate / 1e9:.3g} | {rate / base:.2g} | {error:.0e} |")
    versions = (
        f"Python {platform.python_version()}, Numba {numba.__version__}, NumPy {np.__version__}"
    )
    lines += [
        "",
        f"{processor()}, {versions}, suslov_fast {suslov_fast.__version__}, "
        f"{datetime.date.today().isoformat()}. C is compiled by gcc with "
        "`-O3 -march=native -fopenmp`, vectorised over 64 trajectories.",
        END,
    ]
    return "\n".join(lines)


BEGIN_ND, END_ND = (
    "<!-- begin of the table in n dimensions -->",
    "<!-- end of the table in n dimensions -->",
)
COMPONENTS = (2, 4, 8, 16, 32, 64)
CANDIDATES_ND = {
    "**suslov_fast**, `rank2`": lambda *problem: ours_nd(*problem, "rank2"),
    "**suslov_fast**, `gauss`": lambda *problem: ours_nd(*problem, "gauss"),
    "C, elimination": c_elimination,
    "NumPy, `linalg.solve`": numpy_solve,
}


def ours_nd(body, omega0, eps, steps, method):
    """Final states in n dimensions, on one thread."""
    options = {"save_every": None, "method": method, "threads": 1}
    return suslov_fast.iterate(body, omega0, eps, steps, **options).final


def table_nd():
    """Nanoseconds per step in n dimensions, one thread."""
    rows = {name: [] for name in CANDIDATES_ND}
    for m in COMPONENTS:
        body, omega0 = problem_nd(m, 512)
        best = dict.fromkeys(CANDIDATES_ND, np.inf)
        for _ in range(ROUNDS):
            for name, call in CANDIDATES_ND.items():
                steps = max(3, 2000 // m if "rank2" in name else 4000 // m**2)
                begin = time.perf_counter()
                call(body, omega0, 0.1, steps)
                best[name] = min(best[name], (time.perf_counter() - begin) / (512 * steps))
        for name, seconds in best.items():
            rows[name].append(f"{seconds * 1e9:.3g}")
    lines = [
        BEGIN_ND,
        "In n dimensions, nanoseconds per step of one trajectory, 512 trajectories on one thread:",
        "",
        "| n - 1 = | " + " | ".join(map(str, COMPONENTS)) + " |",
        "|---|" + "---:|" * len(COMPONENTS),
        *(f"| {name} | " + " | ".join(row) + " |" for name, row in rows.items()),
        END_ND,
    ]
    return "\n".join(lines)


def processor():
    """The name of the processor, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def main():
    """Measure, print, and write if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="replace the table in README.md")
    options = parser.parse_args()
    tables = [(BEGIN, END, table(measure())), (BEGIN_ND, END_ND, table_nd())]
    readme = Path(__file__).parent.parent / "README.md"
    content = readme.read_text(encoding="utf-8")
    for begin, end, text in tables:
        print(text)
        head, rest = content.split(begin)
        _, tail = rest.split(end)
        content = head + text + tail
    if options.write:
        readme.write_text(content, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
