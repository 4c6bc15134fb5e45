"""The cache of compiled functions on disk: the names of the files of a function, and their folder.

Numba checks a file of its cache only against its own version and the source file of one function.
Here the name of a function contains a digest of all sources of the package that are compiled, so
that every edit makes new files. The folder must be as trusted as the code.
"""

import functools
import hashlib
from contextlib import suppress
from pathlib import Path

# Private names of Numba: without them each process compiles for itself.
try:
    from numba.core import caching
    from numba.core.caching import FunctionCache
except ImportError:
    caching = FunctionCache = None


@functools.cache
def _digest():
    core = Path(__file__).parents[1]
    files = [*core.parent.glob("compiled.py"), *sorted(core.rglob("*.py"))]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:12]


@functools.cache
def _delete_stale_files(folder):
    for path in Path(folder).glob(f"*_{'[0-9a-f]' * len(_digest())}-*.nb?"):
        if _digest() not in path.name:
            path.unlink(missing_ok=True)


@functools.cache
def _locators():
    """Return the classes that Numba asks for a cache folder, NUMBA_CACHE_DIR first."""
    usual = caching.CompileResultCacheImpl._locator_classes
    [named] = [each for each in usual if each.__name__.lstrip("_") == "UserProvidedCacheLocator"]

    class Named(named):
        def ensure_cache_path(self):
            with suppress(OSError):  # a read-only folder, as in a container
                super().ensure_cache_path()

    return [Named, *usual]


def _files_of(py_function):
    """Return the reader and writer of a function's cache files; RuntimeError without a folder."""

    class Files(FunctionCache):
        """Cache files of a function. If a file cannot be read or written, the process compiles."""

        class _impl_class(caching.CompileResultCacheImpl):
            _locator_classes = _locators()

        def load_overload(self, signature, target_context):
            # Errors of any class, because unpickling a damaged file may raise anything. Then the
            # process compiles.
            with suppress(Exception):
                code = super().load_overload(signature, target_context)
                # Two processes that write at once may exchange the code of two signatures.
                return code if code and tuple(code.signature.args) == tuple(signature) else None
            with suppress(OSError):
                self.flush()  # empties the index, which may be damaged: `save_overload` reads it
            return None

        def save_overload(self, signature, data):
            with suppress(Exception):  # any error: of pickle, of a full disk, of a damaged index
                super().save_overload(signature, data)
                _delete_stale_files(self.cache_path)

    return Files(py_function)


def use_cache(compiled, py_function):
    """Give a compiled function its cache files, with the digest of all sources in their names."""
    py_function.__qualname__ += f"_{_digest()}"
    if FunctionCache is not None and hasattr(compiled, "_cache"):
        with suppress(RuntimeError, TypeError, AttributeError, ValueError):  # no folder to write to
            compiled._cache = _files_of(py_function)


def is_kept(compiled, kinds):
    """Return True if the cache files of a function contain code for arguments of types `kinds`."""
    with suppress(Exception):  # any error: of unpickling, or a newer Numba lacks these names
        files = compiled._cache
        key = files._index_key(kinds, compiled.targetctx.codegen())
        return key in files._cache_file._load_index()
    return False
