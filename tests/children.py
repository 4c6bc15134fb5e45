"""Child processes, for tests that may abort or hang, or that need other settings."""

import os
import subprocess
import sys
import textwrap
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest
from numba import config

HERE = Path(__file__).parent
ROOT = HERE.parent  # of the checkout
# The number of threads of a parallel call where there are two, else the default.
TWO_THREADS = 2 if config.NUMBA_NUM_THREADS > 1 else None

SETUP = """
import numpy as np, suslov_fast as sf
body = sf.Suslov3D(4, 1, -0.5, -0.3)
omega = np.random.default_rng(1).uniform(-2, 2, (4096, 2))
def run(**options):  # enough work for threads, and too much for NumPy
    return sf.iterate(body, omega, 0.2, 4000, save_every=None, **options).final
expected = run(threads=1)
"""


def attempt(code, *arguments, timeout=300, **environment):
    """Run a child: code, which may be indented, or the script at a path; kill it if it hangs.

    It imports the package that is installed, compiled before, and not one in the current folder.
    Numba has two threads there.
    """
    what = [code] if isinstance(code, Path) else ["-c", textwrap.dedent(code)]
    return subprocess.run(
        [sys.executable, *map(str, [*what, *arguments])],
        env=os.environ | {"NUMBA_NUM_THREADS": "2"} | environment,
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=timeout, cwd=HERE,
    )  # fmt: skip


@contextmanager
def start(code, *arguments, timeout=120, **environment):
    """Start a child whose output is read while it runs; it does not outlive the block or `timeout`.

    A read of the output of a child that hangs ends with it.
    """
    command = [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)]
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(
        command, env=os.environ | environment, text=True, cwd=HERE, **pipes
    ) as child:
        timer = threading.Timer(timeout, child.kill)
        timer.start()
        try:
            yield child
        finally:
            timer.cancel()
            child.kill()


def run(code, *arguments, **options):
    """Run a child that must succeed, and return its output."""
    done = attempt(code, *arguments, **options)
    text = f"{done.stdout[-2000:]}{done.stderr[-4000:]}"
    assert done.returncode == 0, f"ended with {done.returncode}: {text}"
    return done.stdout


def layer(name):
    """Return the environment for a threading layer of Numba; skip the test if it is missing."""
    # pip installs the TBB library in a folder that the loader does not search.
    places = [str(Path(sys.prefix) / "lib"), os.environ.get("LD_LIBRARY_PATH", "")]
    environment = {
        "NUMBA_THREADING_LAYER": name,
        "NUMBA_NUM_THREADS": "2",
        "LD_LIBRARY_PATH": os.pathsep.join(filter(None, places)),
    }
    if attempt("import numba; numba.get_num_threads()", **environment).returncode:
        pytest.skip(f"Numba has no threading layer {name} here")
    return environment
