"""Numba's cache on disk, safe against stale and unreadable files.

Numba checks a cache file only against the source file of its kernel. Here the name of a kernel
contains a digest of all sources that kernels are compiled from and one of the versions of the
libraries, so every edit or upgrade makes a new file. A cache folder must be as trusted as the code
itself.
"""

import functools
import hashlib
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path

import numba
import numpy as np
from numba import config
from numba.core import event

_PACKAGE = Path(__file__).parent.parent
_DIGITS = 12
_COMPILED = ("_jit/*.py", "_formulas/*.py", "_kernels/*.py", "compiled.py")


@functools.cache
def digests():
    """Digests of the sources of all kernels, and of the versions of what compiles them."""
    sources = hashlib.sha256()
    for pattern in _COMPILED:
        for path in sorted(_PACKAGE.glob(pattern)):
            sources.update(path.read_bytes())
    versions = f"{numba.__version__} {version('llvmlite')} {np.__version__}".encode()
    return tuple(d.hexdigest()[:_DIGITS] for d in (sources, hashlib.sha256(versions)))


def enable_cache(function, compile_with):
    """Compile a function on its first call, with Numba's cache if a cache folder exists."""
    name = function.__qualname__
    function.__qualname__ = "_".join((name, *digests()))
    compiled = compile_with(function)
    # Numba would cache code with and without checks of bounds under one name.
    if config.BOUNDSCHECK or config.DISABLE_JIT:
        return compiled
    with suppress(RuntimeError):  # no writable folder: each process compiles
        compiled.enable_caching()
        _tolerate_unusable_files(compiled, name.translate({ord("<"): None, ord(">"): None}))
    return compiled


def _tolerate_unusable_files(compiled, name):
    """Recompile if a cache file cannot be read; continue if none can be written.

    `name` is that of the function in the names of files, without the digests.
    """
    cache = getattr(compiled, "_cache", None)
    if not all(hasattr(cache, method) for method in ("load_overload", "save_overload")):
        return  # a Numba with another cache class
    load, save = cache.load_overload, cache.save_overload

    def load_overload(signature, target_context):
        try:
            found = load(signature, target_context)
            # Two processes that write at once may exchange the code of two signatures.
            same = found is not None and tuple(found.signature.args) == tuple(signature)
            return found if same else None
        except Exception:
            with suppress(Exception):
                cache.flush()  # of the index: `save_overload` would read it
            return None

    def save_overload(signature, data):
        with suppress(Exception):
            save(signature, data)
            sources, versions = digests()
            mine = f"*.{name}_{'?' * _DIGITS}_{versions}-*"
            for path in list(Path(cache.cache_path).glob(mine)):
                if f"_{sources}_{versions}-" not in path.name:  # of an earlier source
                    path.unlink(missing_ok=True)

    cache.load_overload, cache.save_overload = load_overload, save_overload


@contextmanager
def compile_timer():
    """Yield a function that returns the time in seconds spent in Numba's compiler."""
    with event.install_listener("numba:compiler_lock", event.TimingListener()) as lock:
        yield lambda: lock.duration if lock.done else 0.0
