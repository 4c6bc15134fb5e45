"""Steps have the stored bits on several types of CPU.

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
    assert differing(all_hashes()) == []


# They repeat the steps of order 4.
REPEATED = "Kahan, order 6", "Kahan, order 8"


@pytest.mark.compiled
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="another family")
def test_a_cpu_without_extensions(tmp_path):
    """It has neither wide registers nor fused operations; fields are compiled as users do."""
    settings = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", "SUSLOV_FAST_OPT": "2"}
    found, compiled = hashes(60, *REPEATED, **settings, NUMBA_CACHE_DIR=str(tmp_path))
    assert differing(found, REPEATED) == []
    assert any("steps" in name for name in compiled)
    # Texts of errors, which take seconds.
    assert [name for name in compiled if "shape_context" in name or "unicode" in name] == []


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    if "--write" in sys.argv:
        KEPT.write_text(json.dumps(all_hashes(), indent=1) + "\n", encoding="utf-8")
    else:
        steps, *left_out = sys.argv[1:] or [60]
        with event.install_recorder("numba:run_pass") as passes:
            found = all_hashes(int(steps), tuple(left_out))
        names = {f"{each.data['module']}.{each.data['qualname']}" for _, each in passes.buffer}
        print(json.dumps({"hashes": found, "compiled": sorted(names)}, indent=1))
