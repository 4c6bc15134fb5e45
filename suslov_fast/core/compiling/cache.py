"""The cache of compiled functions on disk: which files are those of a function, and where they are.

Numba checks a file of its cache only against its own version and the source file of one function.
Here the name of a function contains a digest of all sources of the package that are compiled, and
the key of a function of others a digest of all that it names, so that every edit makes new files.
The folder must be as trusted as the code.
"""

import functools
import hashlib
import importlib.resources
from contextlib import contextmanager, suppress
from pathlib import Path
from types import CodeType, ModuleType

import numpy as np

# Private names of Numba: without them each process compiles for itself.
try:
    from numba.core import caching
    from numba.core.caching import FunctionCache
except ImportError:
    caching = FunctionCache = None

_PACKAGE = __package__.partition(".")[0]


def _hash(content):
    return hashlib.sha256(content).hexdigest()[:12]


# --------------------------------------------------------------------------- sources of the package
@functools.cache
def _digest():
    package = importlib.resources.files(_PACKAGE)  # a folder, or a part of an archive
    files = [package.joinpath("compiled.py"), *_sources(package.joinpath("core"))]
    return _hash(b"".join(path.read_bytes() for path in files if path.is_file()))


def _sources(folder):
    """Yield the Python files in a folder and in those in it, in the order of their names."""
    for path in sorted(folder.iterdir(), key=lambda path: path.name) if folder.is_dir() else []:
        if path.is_dir():
            yield from _sources(path)
        elif path.name.endswith(".py"):
            yield path


@functools.cache
def _delete_stale_files(folder):
    for path in Path(folder).glob(f"*_{'[0-9a-f]' * len(_digest())}-*.nb?"):
        if _digest() not in path.name:
            path.unlink(missing_ok=True)


# ------------------------------------------------------------------------------ functions of others
def is_foreign(py_function):
    """True for functions of others, and for those that the package makes from them."""
    return not _is_known(py_function) or py_function.__closure__ is not None


def _is_known(thing):
    """True for what `_digest` has read, and for packages that Numba knows by their names."""
    module = getattr(thing, "__module__", None) or getattr(thing, "__name__", "")
    return module.partition(".")[0] in (_PACKAGE, "numba", "numpy", "math")


def _digest_of(py_function):
    """Return a digest of a function, and of all functions and numbers that it names, in any file.

    Names have their values of the moment, those that the compiler would take.
    """
    return _hash("\n".join(_described(py_function, {})).encode())


def _described(thing, seen):
    """Yield texts that differ where code that uses a thing may differ."""
    function = getattr(thing, "py_func", thing)
    if isinstance(thing, (tuple, list, frozenset)):
        yield f"{type(thing).__name__} {len(thing)}"
        for each in sorted(thing, key=repr) if isinstance(thing, frozenset) else thing:
            yield from _described(each, seen)
    elif isinstance(thing, np.ndarray):
        yield f"{thing.dtype} {thing.shape} {_hash(thing.tobytes())}"
    elif not hasattr(function, "__code__"):
        fields = getattr(thing, "_fields", "")  # of the class of a named tuple
        yield repr(thing) if np.isscalar(thing) else f"{type(thing).__name__} {fields}"
    elif function in seen:
        yield f"{seen[function]}"
    elif not seen or is_foreign(function):
        seen[function] = len(seen)
        yield repr(sorted(getattr(thing, "targetoptions", {}).items(), key=repr))
        cells = [cell.cell_contents for cell in function.__closure__ or ()]
        for each in (*cells, *(function.__defaults__ or ())):
            yield from _described(each, seen)
        yield from _described_code(function.__code__, function.__globals__, seen)


def _described_code(code, module, seen):
    yield f"{code.co_code.hex()} {code.co_names} {code.co_varnames} {code.co_freevars}"
    for each in code.co_consts:
        of_code = isinstance(each, CodeType)
        yield from _described_code(each, module, seen) if of_code else _described(each, seen)
    yield from _described_names(code.co_names, module, seen)


def _described_names(names, module, seen):
    """Yield texts of what a module has by these names, and modules in it."""
    for name in names:
        if name in module:
            yield name
            if not isinstance(value := module[name], ModuleType):
                yield from _described(value, seen)
            elif not _is_known(value) and (value, names) not in seen:
                seen[value, names] = len(seen)
                yield from _described_names(names, vars(value), seen)


# -------------------------------------------------------------------------------------------- files
@functools.cache
def _locators():
    """Return the classes that Numba asks for a folder: first that of NUMBA_CACHE_DIR, as it is.

    Numba takes only folders that it can write, as that of a container may not be.
    """
    usual = caching.CompileResultCacheImpl._locator_classes
    [named] = [each for each in usual if each.__name__.lstrip("_") == "UserProvidedCacheLocator"]

    class Named(named):
        def ensure_cache_path(self):
            with suppress(OSError):
                super().ensure_cache_path()

    return [Named, *usual]


@contextmanager
def named_folder():
    """Let Numba choose the files of universal functions and of C functions by `_locators`, too."""
    usual = caching.CacheImpl._locator_classes
    caching.CacheImpl._locator_classes = _locators()
    try:
        yield
    finally:
        caching.CacheImpl._locator_classes = usual


def _files_of(py_function):
    """Return what reads and writes the files of a function; RuntimeError if there is no folder."""
    of_others = is_foreign(py_function)

    class Files(FunctionCache):
        """Files of a function. If one cannot be read or written, the process compiles."""

        class _impl_class(caching.CompileResultCacheImpl):
            _locator_classes = _locators()

        def load_overload(self, signature, target_context):
            # Of any class, because unpickling what is not whole may raise anything. The process
            # then compiles.
            with suppress(Exception):
                code = super().load_overload(signature, target_context)
                # Two processes that write at once may exchange the code of two signatures.
                return code if code and tuple(code.signature.args) == tuple(signature) else None
            with suppress(OSError):
                self.flush()  # the index: `save_overload` would read it
            return None

        def save_overload(self, signature, data):
            with suppress(Exception):  # of any class: pickle, a full disk, the index of another
                super().save_overload(signature, data)
                _delete_stale_files(self.cache_path)

        def _index_key(self, signature, codegen):
            if not of_others:
                return super()._index_key(signature, codegen)
            return signature, codegen.magic_tuple(), _digest_of(py_function)

    return Files(py_function)


def use_cache(compiled, py_function):
    """Give a compiled function its files: `caching`, `FunctionCache`, `_cache`."""
    # Without a key of its own a function of others might be stale.
    if hasattr(FunctionCache, "_index_key") and hasattr(compiled, "_cache"):
        with suppress(RuntimeError, TypeError, AttributeError, ValueError):  # no folder
            compiled._cache = _files_of(py_function)


def is_kept(compiled, kinds):
    """True if the files of a function have code for arguments of these types."""
    with suppress(Exception):  # of any class: unpickling, and private names of Numba
        files = compiled._cache
        key = files._index_key(kinds, compiled.targetctx.codegen())
        return key in files._cache_file._load_index()
    return False


def has_files(py_function):
    """True if there are files of a function that Numba itself gives files."""
    with suppress(Exception), named_folder():  # of any class, as in `is_kept`
        return bool(FunctionCache(py_function)._cache_file._load_index())
    return False


def folder_of(compiled):
    """Return the folder of the files of a function, or None."""
    files = getattr(compiled, "_cache", None)
    return files.cache_path if isinstance(files, FunctionCache or ()) else None


def name_with_digest(py_function, of_all=False):
    """Give a function the name that the names of its files contain.

    With `of_all` it contains the digest of a function of others, where the key cannot.
    """
    if of_all and is_foreign(py_function):
        py_function.__qualname__ += f"_{_digest_of(py_function)}"
    py_function.__qualname__ += f"_{_digest()}"
