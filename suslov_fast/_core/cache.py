"""Compiled code on disk: never stale, never damaged, and never from a folder that others fill.

Numba keeps an index beside its files and believes both. Here each build has one file, named after
what it was compiled for, that begins with a digest over its content and over all that the content
depends on. A file that does not fit its digest is compiled anew.
"""

import functools
import hashlib
import os
import pickle
import stat
import sys
from contextlib import suppress
from pathlib import Path

import llvmlite
import numba
import numpy as np
from numba import config
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.runtime import rtsys

_DIGEST = hashlib.sha256
_DIGEST_SIZE = 32
_CORE = Path(__file__).parent
# All files of the core as they were imported; they may be others when a loop is compiled.
SOURCES = {str(path): path.read_bytes() for path in sorted(_CORE.rglob("*.py"))}


def _source_stamp():
    """What compiled code depends on, beside the signature and the type of CPU.

    All files of the core count: Numba looks at that of the compiled function alone.
    """
    versions = (sys.version, numba.__version__, llvmlite.__version__, np.__version__)
    options = (config.BOUNDSCHECK, config.OPT, config.LOOP_VECTORIZE, config.SLP_VECTORIZE)
    digest = _DIGEST(repr((versions, options)).encode())
    for source in SOURCES.values():
        digest.update(source)
    return digest.hexdigest()


_SOURCE_STAMP = _source_stamp()


@functools.cache
def trusted(folder):
    """Whether nobody plants code there who could not change what runs anyway.

    A folder within that named by NUMBA_CACHE_DIR is the user's own choice.
    """
    path = Path(os.path.abspath(folder))
    chosen = config.CACHE_DIR and Path(os.path.abspath(config.CACHE_DIR)) in path.parents
    if os.name != "posix" or chosen:
        return True
    ours = _CORE.stat()
    owners = {0, os.geteuid(), ours.st_uid, os.stat(sys.executable).st_uid}
    groups = {os.getegid()} | ({ours.st_gid} if ours.st_mode & stat.S_IWGRP else set())
    for way in (path, path.resolve()):
        for place in (way, *way.parents):
            found = place.stat()
            open_to_others = found.st_mode & stat.S_IWOTH or (
                found.st_mode & stat.S_IWGRP and found.st_gid not in groups
            )
            # Nobody replaces what is another's in a sticky folder, such as /tmp.
            sticky = place != way and found.st_mode & stat.S_ISVTX
            if found.st_uid not in owners or (open_to_others and not sticky):
                return False
    return True


def _only_if_trusted(locator):
    """The same way to find a folder, for folders that may be trusted."""

    class Trusted(locator):
        @classmethod
        def from_function(cls, py_func, py_file):
            found = super().from_function(py_func, py_file)
            if found is None:
                return None
            found.ensure_cache_path()
            return found if trusted(found.get_cache_path()) else None

    return Trusted


class _Places(CompileResultCacheImpl):
    """Where Numba looks for a folder: NUMBA_CACHE_DIR, beside the source, the user's cache."""

    _locator_classes = tuple(map(_only_if_trusted, CompileResultCacheImpl._locator_classes))


class _Files(IndexDataCacheFile):
    """The files of one function, one for each key (signature, type of CPU, bytecode)."""

    def save(self, key, data):
        payload = self._dump(data)
        path = self._path(key)
        with self._open_for_write(path) as file:
            file.write(self._digest(key, payload) + payload)
        self._log("saved to", path)

    def load(self, key):
        path = self._path(key)
        try:
            content = Path(path).read_bytes()
        except FileNotFoundError:
            return None
        digest, payload = content[:_DIGEST_SIZE], content[_DIGEST_SIZE:]
        if digest != self._digest(key, payload):
            return None
        self._log("loaded from", path)
        return pickle.loads(payload)

    def flush(self):
        for path in Path(self._cache_path).glob(self._name("*")):
            path.unlink(missing_ok=True)

    def _path(self, key):
        # The name does not tell the source: an edit replaces files, and adds none.
        return self._data_path(self._name(_DIGEST(repr(key).encode()).hexdigest()[:16]))

    def _name(self, which):
        return f"{self._index_name.removesuffix('.nbi')}.{which}.nbc"

    def _digest(self, key, payload):
        return _DIGEST(f"{self._source_stamp} {key!r} ".encode() + payload).digest()

    @staticmethod
    def _log(what, path):
        if config.DEBUG_CACHE:
            print(f"[cache] data {what} {path!r}")


def _held_by(function):
    """The names of what a closure holds, and of what that holds: staged parts are named alike."""
    cells = getattr(function, "__closure__", None) or ()
    held = [cell.cell_contents for cell in cells]
    return tuple(
        (getattr(each, "__qualname__", None) or repr(each), *_held_by(each)) for each in held
    )


class KernelCache(FunctionCache):
    """Numba's cache, with checked files in trusted folders, and never fatal."""

    _impl_class = _Places

    def __init__(self, function):
        super().__init__(function)
        stamp = f"{_SOURCE_STAMP} {self._impl.locator.get_source_stamp()}"
        self._cache_file = _Files(self._cache_path, self._impl.filename_base, stamp)

    def _index_key(self, sig, codegen):
        # Numba pickles what a closure holds, and the bytes depend on whether Python had compiled
        # the module before. The source is in the stamp, so that names are enough.
        return sig, codegen.magic_tuple(), _held_by(self._py_func)

    def load_overload(self, sig, target_context):
        try:
            # Numba's own way imports all that it compiles with, which takes far longer.
            rtsys.initialize(target_context)
            return self._load_overload(sig, target_context)
        except Exception:  # a file that cannot be read: compile again
            return None

    def save_overload(self, sig, data):
        with suppress(Exception):  # a full or read-only disk: the code is in memory all the same
            super().save_overload(sig, data)
