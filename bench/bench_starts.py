"""Processes from their start to their end: the first use ever, and that of a second process."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from results import Table, Whose

import suslov_fast

BODY_3D = "suslov_fast.Suslov3D(4, 1, -0.5, -0.3)"
BODY_ND = "suslov_fast.SuslovND([1.3, 2.1, 3.7], [0.4, -0.7, 0.5])"
IMPORTS = {
    "python": ("Python alone", "pass"),
    "import-numba": ("`import numba`", "import numba"),
    "import": ("`import suslov_fast`", "import suslov_fast"),
}
RESULTS = {
    "iterate": (
        "`iterate` in 3D",
        f"import suslov_fast; suslov_fast.iterate({BODY_3D}, [1, 0.5], 0.2, 25)",
    ),
    "iterate-nd": (
        "`iterate` in n dimensions",
        f"import suslov_fast; suslov_fast.iterate({BODY_ND}, [1, 0.5, 0.2], 0.1, 25)",
    ),
    "exact": ("`exact`", f"import suslov_fast; suslov_fast.exact({BODY_3D}, [1, 0.5], 0.2, 25)"),
}


@pytest.fixture
def process(measure, tmp_path):
    """Runs code in a process with a cache of its own; where it is only a test, with the usual."""
    # The package that is measured, wherever this process found it.
    environment = {
        "PYTHONPATH": str(Path(suslov_fast.__path__[0]).parent),
        "PYTHONDONTWRITEBYTECODE": "",  # modules are compiled, as those of installed packages are
    }

    def run(code, cache=tmp_path):
        if measure.full:
            environment["NUMBA_CACHE_DIR"] = str(cache)
        command = [sys.executable, "-c", code]
        subprocess.run(command, env=os.environ | environment, check=True)

    return run


def row(key, label):
    """What the rows of all processes have in common."""
    return {"table": Table.STARTS, "key": key, "label": label, "unit": "processes", "work": 1}


@pytest.mark.parametrize("name", IMPORTS)
def bench_import(measure, process, name):
    if not measure.full:
        pytest.skip("takes a process, and tests nothing")
    label, code = IMPORTS[name]
    whose = Whose.OURS if "suslov_fast" in code else Whose.OTHER
    measure(lambda: process(code), rounds=3, **row(name, label) | {"whose": whose})


@pytest.mark.parametrize("name", RESULTS)
def bench_second_process(measure, process, name):
    """With what the call that warms up has compiled."""
    if not measure.full and name != "iterate":
        pytest.skip("one process is test enough")
    label, code = RESULTS[name]
    measure(lambda: process(code), rounds=2, **row(f"{name}-again", f"{label}, compiled before"))


@pytest.mark.once
@pytest.mark.parametrize("name", RESULTS)
def bench_first_use(measure, process, name, tmp_path_factory):
    """With nothing compiled."""
    if not measure.full:
        pytest.skip("compiles everything, and tests no more than the second process")
    label, code = RESULTS[name]

    def empty_cache():
        return (code, tmp_path_factory.mktemp("cache")), {}

    measure(
        process, prepare=empty_cache, rounds=1, **row(f"{name}-first", f"{label}, nothing compiled")
    )
