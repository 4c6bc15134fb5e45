"""C functions for the benchmarks: compiled by gcc, called through ctypes."""

import ctypes
import functools
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

# C is compiled for the processor that Numba compiles for.
PROCESSOR = os.environ.get("NUMBA_CPU_NAME")
ARCHITECTURE = {None: "native", "generic": "x86-64"}.get(PROCESSOR, PROCESSOR)
FLAGS = ["-O3", f"-march={ARCHITECTURE}", "-fopenmp"]


@functools.cache
def library(name, *flags):
    """The C file of that name in this folder, as a library; an ImportError where there is none."""
    if shutil.which("gcc") is None:
        raise ImportError("gcc is not installed")
    with tempfile.TemporaryDirectory() as folder:
        target = str(Path(folder) / "library.so")
        source = str(Path(__file__).parent / name)
        command = ["gcc", *FLAGS, *flags, "-shared", "-fPIC", source, "-o", target, "-lm"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise ImportError(f"gcc could not compile {name}: {done.stderr.splitlines()[0]}")
        return ctypes.CDLL(target)


def pointer(array):
    """Where the numbers of a C-contiguous array of doubles are."""
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def version():
    """The version of gcc, or None without it."""
    if shutil.which("gcc") is None:
        return None
    done = subprocess.run(["gcc", "-dumpfullversion"], capture_output=True, text=True)
    return done.stdout.strip() or None
