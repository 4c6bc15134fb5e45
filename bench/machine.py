"""What the figures belong to: the processor and the versions, and nothing that names a host."""

import importlib.metadata
import os
import platform
from pathlib import Path

import gcc

PACKAGES = ["Numba", "NumPy", "SciPy", "heyoka", "JAX", "numbalsoda", "pynamicalsys"]


def describe():
    """Processor, cores and versions."""
    import numba
    from llvmlite import binding

    import suslov_fast

    versions = {"Python": platform.python_version(), "suslov_fast": suslov_fast.__version__}
    for package in PACKAGES:
        try:
            versions[package] = importlib.metadata.version(package.lower())
        except importlib.metadata.PackageNotFoundError:
            continue
    versions["LLVM"] = ".".join(map(str, binding.llvm_version_info))
    if gcc.version():
        versions["gcc"] = gcc.version()
    compiled_for = f", compiled for {gcc.PROCESSOR}" if gcc.PROCESSOR else ""
    return {
        "processor": processor() + compiled_for,
        "cores": os.cpu_count(),
        "threads": int(numba.config.NUMBA_NUM_THREADS),
        "system": platform.system(),
        "versions": versions,
    }


def processor():
    """The name of the processor, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()
