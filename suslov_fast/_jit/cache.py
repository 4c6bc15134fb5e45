"""Numba's cache on disk, safe against stale and unreadable files.

Numba checks a cache file only against the source file of its kernel. Here the name of a kernel
contains a digest of all sources that kernels are compiled from, so every edit or upgrade makes a
new file. A cache folder must be as trusted as the code itself.
"""

import functools
import hashlib
from contextlib import suppress
from pathlib import Path

import llvmlite
import numba
import numpy as np

_PACKAGE = Path(__file__).parent.parent
_DIGITS = 12
_ROOMS = ("_jit", "_formulas", "_kernels")


@functools.cache
def digest_of_sources():
    """Digest of the sources of all kernels and of the libraries that compile them."""
    digest = hashlib.sha256()
    for version in (numba.__version__, llvmlite.__version__, np.__version__):
        digest.update(version.encode())
    for room in _ROOMS:
        for path in sorted((_PACKAGE / room).glob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:_DIGITS]


def enable_cache(function, compile_with):
    """Compile a function on its first call, with Numba's cache if a cache folder exists."""
    name = function.__name__
    function.__qualname__ = f"{name}_{digest_of_sources()}"
    compiled = compile_with(function)
    with suppress(RuntimeError):  # no writable folder: each process compiles
        compiled.enable_caching()
        _tolerate_unusable_files(compiled, name)
    return compiled


def _tolerate_unusable_files(compiled, name):
    """Recompile if a cache file cannot be read; continue if none can be written."""
    cache = getattr(compiled, "_cache", None)
    if not all(hasattr(cache, method) for method in ("load_overload", "save_overload")):
        return  # a Numba with another cache class
    load, save = cache.load_overload, cache.save_overload

    def load_overload(signature, target_context):
        try:
            return load(signature, target_context)
        except Exception:
            return None

    def save_overload(signature, data):
        with suppress(Exception):
            save(signature, data)
            current = compiled.py_func.__qualname__
            for path in Path(cache.cache_path).glob(f"*.{name}_{'?' * _DIGITS}-*"):
                if f".{current}-" not in path.name:  # of an earlier source
                    path.unlink()

    cache.load_overload, cache.save_overload = load_overload, save_overload
