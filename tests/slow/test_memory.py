"""Exhausted memory raises MemoryError: no other error, and no states that were not computed."""

import sys
from pathlib import Path

import children
import pytest

pytestmark = [
    pytest.mark.compiled,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits the address space"),
]
SCRIPT = Path(__file__).with_name("scarce.py")
# The problems in scarce.py.
PROBLEMS = (
    "3D, all states", "3D, last states", "3D, closed form", "3D, as printed",
    "n = 9, all states", "n = 201, elimination", "n = 201",
)  # fmt: skip


@pytest.mark.parametrize("layer", [None, *children.LAYERS])
@pytest.mark.parametrize("problem", PROBLEMS)
def test_scarce_memory(problem, layer):
    threads, settings = (2, children.layer(layer)) if layer else (1, {})
    # Freed memory is returned or overwritten, and so never shows the states of the last run.
    settings |= {
        "MALLOC_MMAP_THRESHOLD_": "65536",
        "MALLOC_PERTURB_": "170",
        "MALLOC_ARENA_MAX": "1",
    }
    output = children.run(SCRIPT, problem, threads, **settings)
    done, refused = map(int, output.split())
    assert done > 1
    assert refused > 1
