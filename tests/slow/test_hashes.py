"""Results have the stored bits on several types of CPU, compiled and interpreted."""

import json
import os
from pathlib import Path

import children
import pytest
from llvmlite import binding

SCRIPT = Path(__file__).with_name("hashes.py")
KEPT = json.loads(SCRIPT.with_suffix(".json").read_text(encoding="utf-8"))

# Types of CPU, from generic x86-64 on, and the features that a processor needs to run their code.
TYPES = {
    "generic": [],
    "haswell": ["avx2", "bmi2", "fma", "lzcnt", "movbe"],
    "skylake-avx512": ["avx512bw", "avx512cd", "avx512dq", "avx512vl", "adx", "clwb", "movbe"],
    "znver2": ["avx2", "bmi2", "clwb", "fma", "movbe", "sse4a"],
}


def hashes(**environment):
    places = [str(SCRIPT.parents[1]), os.environ.get("PYTHONPATH", "")]
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, places))
    return json.loads(children.run(SCRIPT, timeout=1800, **environment))


def differing(found):
    return sorted(name for name in KEPT.keys() | found.keys() if KEPT.get(name) != found.get(name))


def test_on_this_machine():
    assert differing(hashes()) == []


def test_interpreted():
    assert differing(hashes(NUMBA_DISABLE_JIT="1")) == []


@pytest.mark.compiled
@pytest.mark.parametrize("cpu", TYPES)
def test_types_of_cpu(cpu, tmp_path):
    if not binding.get_process_triple().startswith("x86_64"):
        pytest.skip("not a processor of this family")
    here = binding.get_host_cpu_features()
    if missing := [feature for feature in TYPES[cpu] if not here.get(feature)]:
        pytest.skip(f"this processor lacks {', '.join(missing)}")
    settings = {"NUMBA_CPU_NAME": cpu, "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": str(tmp_path)}
    assert differing(hashes(**settings)) == []
