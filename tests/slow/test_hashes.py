"""Steps and motions have the stored bits on several types of CPU.

    PYTHONPATH=tests python tests/slow/test_hashes.py            print the hashes
    PYTHONPATH=tests python tests/slow/test_hashes.py --write    store them in hashes.json

The positions of NaN and 0 count, but not their signs, which differ between processors, nor the
payload of NaN.
"""

import hashlib
import json
import os
import platform
import sys
import warnings
from pathlib import Path

import children
import numpy as np
import pytest
from numba.core import event
from promises import OPTIONS, hard

import suslov_fast as sf

HERE = Path(__file__)
KEPT = HERE.with_name("hashes.json")


def digest(values):
    found = hashlib.sha256()
    for array in map(np.array, values):
        if array.dtype.kind == "f":
            array[np.isnan(array)] = np.nan
            array += 0.0
        found.update(f"{array.shape} {array.dtype.str}".encode() + array.tobytes())
    return found.hexdigest()[:16]


def short(numbers):
    """Round to 24 bits: the last bits of powers and random numbers depend on the processor, too."""
    mantissa, exponent = np.frexp(numbers)
    return np.ldexp(np.round(np.ldexp(mantissa, 24)), exponent - 24)


def problem(body, omega, eps):
    parts = dict(body._parts)
    for name, value in parts.items():
        if np.asarray(value).dtype.kind == "f":
            parts[name] = short(value)
    return body._with_parts(parts), short(omega), short(eps)


def all_hashes(steps=60, left_out=()):
    found = {}
    for kind, options in OPTIONS:
        if kind.startswith(tuple(left_out)):
            continue
        body, omega, *eps = problem(*hard(np.random.default_rng(1), kind))
        given = body, omega, *eps * (not isinstance(body, sf.Map))
        for save_every in (1, None):
            run = sf.iterate(*given, steps, save_every=save_every, on_singular="ignore", **options)
            turns = [] if run.attitude is None else [run.attitude]
            values = run.states, run.final, run.status, run.failed_at, *turns
            found[f"{kind}, {options}, {save_every}"] = digest(values)
    return found


def motions():
    """Return motions of each kind by name: calls whose results have the same bits everywhere."""
    lorenz = sf.Field(
        lambda x: (10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 * x[2] / 3), 3
    )
    pol = sf.Field(lambda x, m: (x[1], m * (1 - x[0] ** 2) * x[1] - x[0]), 2, m=[1.0, 10.0, 1000.0])
    block = sf.Field(lambda x: (x[1], 1.5 * np.sin(x[2]) - x[0] - np.sign(x[1]), 1.0), 3)
    forced = sf.Field(lambda t, y, k: (y[1], -k * y[0] + np.cos(2 * t)), 2, k=[1.0, 2.0])
    spiral = sf.Field(
        lambda z, k: ((1j * k - 0.1 * abs(z[0]) ** 2) * z[0],), "z", complex=True, k=1
    )
    well = sf.Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 - np.cos(x[0]), "q p")
    pendulum = sf.Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[1], "x y", constraints=lambda q, v: q @ q - 1
    )
    ball = sf.Field(lambda x: (x[1], -9.81), "y v")
    bounce = sf.Event("y", to=("y", "-0.8*v"), direction="down")
    T = np.linspace(0, 20, 9)
    yield "plain", sf.flow(lorenz, [[1, 1, 20], [-2, 1, 20]], time=T, rtol=1e-7)
    yield "stiff, a family", sf.flow(pol, [2, 0], time=T, atol=[1e-9, 1e-7])
    yield "derivatives", sf.flow(pol[:2], [2, 0], time=T, derivatives="x0 m", atol=[1e-9, 1e-7])
    yield "sliding, derivatives", sf.flow(block, [1, 0.5, 0], time=T, derivatives="x0")
    yield "rest", sf.flow(ball, [1, 0], time=T, events=bounce)
    yield "time, a family", sf.flow(forced, [1, 0], time=T, t0=[[0.0], [1.0]], derivatives="k")
    yield "complex", sf.flow(spiral, [1 + 1j], time=T, derivatives="x0")
    yield "an integral", sf.flow(well.conserving(), [2, 0], time=T)
    yield "constraints", sf.flow(pendulum, [0.6, -0.8, 0, 0], time=T)


def motion_hashes():
    """Return hashes of motions, of their derivatives and events, and of exponents."""
    found = {}
    for name, run in motions():
        derivatives = [*run.derivatives.values()]
        events = [] if run.events is None else [run.events.time, run.events.states]
        found[f"motion, {name}"] = digest([run.states, run.steps, *derivatives, *events])
    damped = sf.Field(lambda x: (x[1], -x[0] - 0.1 * x[1], -50 * x[2]), 3)
    found["exponents"] = digest([sf.lyapunov_exponents(damped, [1, 0, 1], time=40.0)])
    return found


def hashes(*arguments, **environment):
    """Return the hashes, and the names of what was compiled, of another process."""
    tests = HERE.parents[1]
    places = [str(tests), str(tests / "package"), os.environ.get("PYTHONPATH", "")]
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, places))
    found = json.loads(children.run(HERE, *arguments, timeout=540, **environment))
    return found["hashes"], found["compiled"]


def differing(found, left_out=()):
    kept = json.loads(KEPT.read_text(encoding="utf-8"))
    names = {name for name in kept if not name.startswith(tuple(left_out))} | found.keys()
    return sorted(name for name in names if kept.get(name) != found.get(name))


@pytest.mark.filterwarnings("ignore")  # as in other processes
def test_on_this_machine():
    assert differing(all_hashes() | motion_hashes()) == []


# They repeat the steps of order 4.
REPEATED = "Kahan, order 6", "Kahan, order 8"


@pytest.mark.compiled
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="another family")
def test_a_cpu_without_extensions(tmp_path):
    """It has neither wide registers nor fused operations; fields are compiled as users do."""
    settings = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", "SUSLOV_FAST_OPT": "2"}
    found, compiled = hashes(60, *REPEATED, **settings, NUMBA_CACHE_DIR=str(tmp_path))
    assert differing(found, (*REPEATED, "motion", "exponents")) == []
    assert any("steps" in name for name in compiled)
    # Texts of errors, which take seconds.
    assert [name for name in compiled if "shape_context" in name or "unicode" in name] == []


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    if "--write" in sys.argv:
        found = all_hashes() | motion_hashes()
        KEPT.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    else:
        steps, *left_out = sys.argv[1:] or [60]
        with event.install_recorder("numba:run_pass") as passes:
            found = all_hashes(int(steps), tuple(left_out))
        names = {f"{each.data['module']}.{each.data['qualname']}" for _, each in passes.buffer}
        print(json.dumps({"hashes": found, "compiled": sorted(names)}, indent=1))
