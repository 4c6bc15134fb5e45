"""C functions for the benchmarks: compiled by gcc, called through ctypes."""

import ctypes
import functools
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

# gcc compiles for the processor that Numba compiles for.
PROCESSOR = os.environ.get("NUMBA_CPU_NAME")
ARCHITECTURE = {None: "native", "generic": "x86-64"}.get(PROCESSOR, PROCESSOR)
FLAGS = ["-O3", f"-march={ARCHITECTURE}", "-fopenmp", "-shared", "-fPIC"]
KINDS = {int: ctypes.c_long, float: ctypes.c_double}


@functools.cache
def _library(name, *flags):
    if shutil.which("gcc") is None:
        raise ImportError("gcc is not installed")
    with tempfile.TemporaryDirectory() as folder:
        target = str(Path(folder) / "library.so")
        command = ["gcc", *FLAGS, *flags, str(Path(__file__).parent / name), "-o", target, "-lm"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise ImportError(f"gcc could not compile {name}: {done.stderr.splitlines()[0]}")
        return ctypes.CDLL(target)


def version():
    """Version of gcc, or "none"."""
    found, command = shutil.which("gcc"), ["gcc", "-dumpfullversion"]
    return subprocess.check_output(command, text=True).strip() if found else "none"


def call(name, function, *arguments, flags=()):
    """Call a C function with arrays of doubles, integers (long) and floats; or ImportError."""
    if not hasattr(_library(name, *flags), function):
        raise ImportError(f"no {function} for this processor")
    addresses = lambda each: ctypes.c_void_p(each.ctypes.data)  # noqa: E731
    numbers = (KINDS.get(type(each), addresses)(each) for each in arguments)
    getattr(_library(name, *flags), function)(*numbers)
