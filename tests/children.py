"""Child processes, for tests that may abort or hang, or that need other settings."""

import functools
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

LAYERS = ("omp", "tbb", "workqueue")

SETUP = """
import numpy as np, suslov_fast as sf
body = sf.Suslov3D(4, 1, -0.5, -0.3)
omega = np.random.default_rng(1).uniform(-2, 2, (4096, 2))
def run(**options):
    options |= {"save_every": None, "method": "canonical"}  # enough work for threads
    return sf.iterate(body, omega, 0.2, 400, **options).final
expected = run(threads=1)
"""


def start(code, *arguments, **environment):
    """Start a child that runs code, which may be indented, or the script at a path."""
    what = [code] if isinstance(code, Path) else ["-c", textwrap.dedent(code)]
    return subprocess.Popen(
        [sys.executable, *map(str, [*what, *arguments])],
        env=os.environ | environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process, timeout=300):
    """Return the output and errors of a child; kill a child that hangs, and raise."""
    try:
        return process.communicate(timeout=timeout)
    finally:
        process.kill()
        process.wait()


def run(code, *arguments, timeout=300, **environment):
    """Run a child that must succeed, and return its output."""
    process = start(code, *arguments, **environment)
    output, errors = finish(process, timeout)
    text = f"{output[-2000:]}{errors[-4000:]}"
    assert process.returncode == 0, f"ended with {process.returncode}: {text}"
    return output


def layer(name):
    """Return the environment for a threading layer of Numba; skip the test if it is missing."""
    if not _has(name):
        pytest.skip(f"Numba has no threading layer {name} here")
    return _settings(name)


def _settings(name):
    # pip installs the TBB library in a folder that the loader does not search.
    places = [str(Path(sys.prefix) / "lib"), os.environ.get("LD_LIBRARY_PATH", "")]
    return {
        "NUMBA_THREADING_LAYER": name,
        "NUMBA_NUM_THREADS": "2",
        "LD_LIBRARY_PATH": os.pathsep.join(filter(None, places)),
    }


@functools.cache
def _has(name):
    process = start("import numba; numba.get_num_threads()", **_settings(name))
    finish(process)
    return process.returncode == 0
