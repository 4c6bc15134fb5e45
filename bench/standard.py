"""Solve the problems of `standard_problems` by `flow` and by SciPy, and write a table for the docs.

`python bench/standard.py` writes `results/standard.json` and `results/standard.md`. Each problem is
solved once from its start at four tolerances. The error at the last time is divided by the error
that the tolerance allows: rtol times the largest modulus that the component has had, as is the
default of `flow`, or atol + rtol abs(y). References have 113 bits (`peers/quadruple.c`) if this
takes at most MINUTES; else they are published end values, or come from DOP853 at 1e-13 for
problems that are not stiff, else from Radau at 1e-11 or, where Radau takes long, from LSODA at
1e-12: these are not compared at the last tolerance. `--references` computes them again. This
package compiles its right-hand sides, and gcc compiles those for SciPy. SciPy's solvers take
derivatives by differences.
"""

import argparse
import ctypes
import datetime
import itertools
import json
import math
import subprocess
import tempfile
import time
import warnings
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import cpuinfo
import numba
import numpy as np
import results
from peers.motions import FUNCTIONS, lines_of
from scipy.integrate import DOP853, Radau, odeint
from standard_problems import PROBLEMS
from tables import caption, figure

from suslov_fast import Field, flow

RTOL = 1e-4, 1e-6, 1e-9, 1e-12
FOLDER = results.BENCH / "results"
MINUTES, MOST = 1, 32  # for a reference in 113 bits, and its most variables
EXACT = "113 bits"
PATIENCE = 2.0  # seconds for a solver of SciPy, 20 times as many for a reference
EXPLICIT = "PLEI", "RING", "BEAM"  # other references that DOP853 reaches
TINY = 2.0**-20  # of the largest component: smaller ones have no relative digits by default


def field_of(problem):
    """Return the `Field` of a problem, with the time as its last component if f depends on it."""
    D, f = problem.D, problem.f
    if problem.has_time:
        return Field(lambda z: (*f(z[D], z[:D], np), 1.0), D + 1)
    return Field(lambda y: f(y, np), D)


def lines_in_c(problem, kind):
    """Return lines of C that read t and x, and write the rates to `out`; `kind` is a type."""
    names = ["t", *(f"x{i}" for i in range(problem.D))]
    lines, found = lines_of(lambda z: problem.rates(z[0], z[1:], FUNCTIONS), names)
    text = [f"{kind} x{i} = x[{i}];" for i in range(problem.D)]
    text += [f"{kind} {result} = {value};" for result, value in lines]
    return text + [f"out[{i}] = {result};" for i, result in enumerate(found)]


def right_hand_side(problem, folder):
    """Return f(t, y) for SciPy, compiled by gcc."""
    text = ["#include <math.h>", "void rates(double t, const double *x, double *out) {"]
    text += [*lines_in_c(problem, "double"), "}"]
    source, library = Path(folder, f"{id(problem)}.c"), Path(folder, f"{id(problem)}.so")
    source.write_text("\n".join(text))
    command = ["gcc", "-O1", "-march=native", "-shared", "-fPIC", source, "-o", library, "-lm"]
    subprocess.run(command, check=True)
    rates = ctypes.CDLL(str(library)).rates
    rates.argtypes, rates.restype = [ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p], None

    @numba.njit
    def right(t, x):
        x, out = np.ascontiguousarray(x), np.empty(len(x))
        rates(t, x.ctypes.data, out.ctypes.data)
        return out

    right(0.0, np.array(problem.start))
    return right


def parts_of(problem):
    """Yield the stretches of time without jumps; a stretch ends just before the jump."""
    ends = [0.0, *problem.breaks, problem.time]
    for k, (a, b) in enumerate(itertools.pairwise(ends)):
        yield (math.nextafter(a, math.inf) if k else a), b


def by_solver(kind, problem, right, rtol, atol, patience):
    """Return the end and the number of steps of a class of SciPy, None if it takes long."""
    y, steps, end = np.array(problem.start), 0, time.process_time() + patience
    for a, b in parts_of(problem):
        solver = kind(right, a, y, b, rtol=rtol, atol=atol)
        while solver.status == "running":
            solver.step()
            steps += 1
            if time.process_time() > end:
                return None
        if solver.status == "failed":
            return None
        y = solver.y
    return y, steps


def by_lsoda(problem, right, rtol, atol):
    y, steps = np.array(problem.start), 0
    for a, b in parts_of(problem):
        options = {"tfirst": True, "full_output": True, "mxstep": 10**6, "tcrit": [b]}
        states, found = odeint(right, y, [a, b], rtol=rtol, atol=atol, **options)
        if found["message"] != "Integration successful.":
            return None
        y, steps = states[-1], steps + int(found["nst"][0])
    return y, steps


def by_flow(problem, field, rtol, times):
    """Return states of the variables and the number of steps, None if the solution ends."""
    start, atol = [*problem.start], None
    if problem.size is not None:
        atol = [rtol * problem.size] * problem.D + [0.0] * problem.has_time
    motion = flow(field, start + [0.0] * problem.has_time, time=times, rtol=rtol, atol=atol)
    return (motion.states[:, : problem.D], int(motion.steps)) if motion.ok.all() else None


def scale_of(problem, field):
    """Return the largest modulus of each component, at many times and the start."""
    times = problem.time * np.union1d(np.geomspace(1e-9, 1, 300), np.linspace(0, 1, 301))
    with warnings.catch_warnings(action="ignore"):
        motion = flow(field, [*problem.start] + [0.0] * problem.has_time, time=times, rtol=1e-6)
    return np.nanmax(abs(motion.states[:, : problem.D]), axis=0)


def allowed(problem, scale, rtol, y):
    """Return the errors that a tolerance allows at a state."""
    if problem.size is not None:
        return rtol * (problem.size + abs(y))
    return rtol * np.maximum(scale, TINY * scale.max())


def peer_atol(problem, scale, rtol):
    """Return atol for SciPy: that of `flow`, or a thousandth of what `flow` has by default."""
    if problem.size is not None:
        return rtol * problem.size
    return 1e-3 * rtol * np.maximum(scale, TINY * scale.max())


def in_quadruple(problem, folder):
    """Return the end by `peers/quadruple.c`, None if it takes long."""
    if problem.D > MOST or problem.breaks:
        return None
    D, path = problem.D, results.BENCH / "peers" / "quadruple.c"
    text = [f"#define D {D + 1}", "static void rates(const Q *x, Q *out) {", f"Q t = x[{D}];"]
    text += [*lines_in_c(problem, "Q"), f"out[{D}] = 1;", "}"]
    source, program = Path(folder, "quadruple.c"), Path(folder, "quadruple")
    source.write_text(path.read_text().replace("\nRATES\n", "\n".join(text)))
    subprocess.run(["gcc", "-O2", source, "-o", program, "-lquadmath"], check=True)
    start = map(repr, (problem.time, *map(float, problem.start), 0.0))
    options = {"capture_output": True, "text": True, "timeout": 60 * MINUTES}
    try:
        done = subprocess.run([program, *start], check=True, **options)
    except (subprocess.TimeoutExpired, subprocess.CalledProcessError):
        return None
    return [*map(float, done.stdout.split())]


def reference(problem, right, scale, folder):
    """Return the end, and where it comes from."""
    if (found := in_quadruple(problem, folder)) is not None:
        return found, EXACT
    if problem.known is not None:
        return [*problem.known], "published"
    size = problem.size if problem.size is not None else 1e-3 * scale
    size = np.maximum(size, 1e-300)
    is_explicit = problem.group == "DETEST" or problem.name in EXPLICIT
    kind, rtol = (DOP853, 1e-13) if is_explicit else (Radau, 1e-11)
    found = by_solver(kind, problem, right, rtol, rtol * size, 20 * PATIENCE)
    if found is not None:
        return found[0].tolist(), kind.__name__
    found = by_lsoda(problem, right, 1e-12, 1e-12 * size)
    return (None, "none") if found is None else (found[0].tolist(), "LSODA")


def timed(call):
    """Return what a call returns and its seconds of processor time, the least of several."""
    found, least, begin, count = None, math.inf, time.process_time(), 0
    while True:
        start = time.process_time()
        found = call()
        least, count = min(least, time.process_time() - start), count + 1
        is_long = time.process_time() - begin > min(0.2, 20 * least)
        if found is None or (is_long and (count > 1 or least > 1.0)):  # a first call may import
            return found, least


def measure(problem, known, folder):
    """Return the results of a problem; `known` is its stored (end, method), or None."""
    field, right = field_of(problem), right_hand_side(problem, folder)
    scale = scale_of(problem, field)
    if known is None:
        known, method = reference(problem, right, scale, folder)
    else:
        known, method = known
    record = {"group": problem.group, "name": problem.name, "D": problem.D, "end": known}
    record |= {"by": method, "rows": []}
    if known is None:
        return record
    known = np.array(known)
    for rtol in RTOL if method == EXACT else RTOL[:-1]:
        atol = peer_atol(problem, scale, rtol)
        calls = {
            "flow": partial(by_flow, problem, field, rtol, [problem.time]),
            "LSODA": partial(by_lsoda, problem, right, rtol, atol),
            "Radau": partial(by_solver, Radau, problem, right, rtol, atol, PATIENCE),
            "DOP853": partial(by_solver, DOP853, problem, right, rtol, atol, PATIENCE),
        }
        row, bound = {"rtol": rtol}, allowed(problem, scale, rtol, known)
        for name, call in calls.items():
            with warnings.catch_warnings(action="ignore"):
                call() if name == "flow" else None  # which compiles
                found, seconds = timed(call)
            if found is not None:
                y, steps = np.reshape(found[0], -1), found[1]
                row[name] = [float((abs(y - known) / bound).max()), steps, seconds]
        record["rows"].append(row)
    return record


METHODS = "flow", "LSODA", "Radau", "DOP853"


def page(content):
    """Return the text of the docs: a table for each tolerance."""
    info = SimpleNamespace(machine=content["machine_info"], date=content["datetime"])
    text = [f"Times are those of the processor, measured on {caption(info)}."]
    if exact := sum(each["by"] == EXACT for each in content["problems"]):
        text.append(f"End values of {exact} problems are computed in {EXACT}.")
    text[-1] += "\n"
    for k, rtol in enumerate(RTOL):
        if not any(len(each["rows"]) > k for each in content["problems"]):
            continue
        text.append(f"**rtol = {rtol:.0e}**".replace("e-0", "e-") + "\n")
        head = ["", "D", *(f"error: {m}" for m in METHODS), "steps: flow"]
        head += [f"ms: {m}" for m in METHODS]
        text += ["| " + " | ".join(head) + " |", "|---" + "|---:" * (len(head) - 1) + "|"]
        group = None
        for record in content["problems"]:
            if record["group"] != group:
                group = record["group"]
                text.append(f"| *{group}*" + " |" * len(head))
            row = record["rows"][k] if len(record["rows"]) > k else {}
            if not row and rtol == RTOL[-1]:
                continue
            found = [row.get(m) for m in METHODS]
            cells = [record["name"], str(record["D"])]
            errors = (None if each is None else each[0] for each in found)
            cells += ["" if e is None else figure(e, 2) if e >= 0.01 else "< 0.01" for e in errors]
            cells.append("" if found[0] is None else f"{found[0][1]:,}")
            cells += ["" if each is None else figure(1e3 * each[2], 2) for each in found]
            text.append("| " + " | ".join(cells) + " |")
        text.append("")
    return "\n".join(text)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "-k", dest="select", default="", help="only problems whose group and name begin with this"
    )
    parser.add_argument("--references", action="store_true", help="compute references again")
    options = parser.parse_args()
    stored, path = {}, FOLDER / "standard.json"
    if path.exists():
        old = json.loads(path.read_text())
        stored = {(each["group"], each["name"]): each for each in old["problems"]}
    with tempfile.TemporaryDirectory() as folder:
        for problem in PROBLEMS:
            key = problem.group, problem.name
            if not f"{problem.group}: {problem.name}".startswith(options.select):
                continue
            known = stored.get(key)
            is_kept = known is not None and (known["by"] == EXACT or problem.D > MOST)
            if options.references or not is_kept:
                known = None
            else:
                known = known["end"], known["by"]
            stored[key] = measure(problem, known, folder)
            for row in stored[key]["rows"]:
                print(*key, stored[key]["by"], json.dumps(row), flush=True)
            processor = cpuinfo.get_cpu_info().get("brand_raw", "")
            keys = [(each.group, each.name) for each in PROBLEMS]
            content = {
                "machine_info": results.machine(processor),
                "datetime": datetime.date.today().isoformat(),
                "problems": [stored[each] for each in keys if each in stored],
            }
            results.write(path, content, "problems")
            (FOLDER / "standard.md").write_text(page(content), encoding="utf-8")


if __name__ == "__main__":
    main()
