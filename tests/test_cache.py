"""Compiled kernels on disk: fast in a second process, never stale, never fatal."""

import shutil
from pathlib import Path

import children
import pytest

from suslov_fast import _jit

pytestmark = pytest.mark.compiled

# A package whose kernel compiles fast, around the modules that keep what is compiled.
FILES = {
    "__init__.py": "",
    "_formulas/__init__.py": "",
    "_formulas/small.py": """
from .._jit import formula

@formula
def change(x):
    return 2.0 * x
""",
    "_kernels/__init__.py": "",
    "_kernels/loops.py": """
from numba import prange
from .._formulas.small import change
from .._jit import kernel

@kernel
def loop(x, out):
    for i in prange(x.size):
        out[i] = change(x[i])
""",
}
CALL = """
import sys
sys.path.insert(0, sys.argv[1])
from core._kernels import loops
import numpy as np
assert loops.__file__.startswith(sys.argv[1])
x = np.arange(3.0)
loops.loop.serial(x, out := np.zeros(3))
print("result", *out)
"""


@pytest.fixture
def folder(tmp_path):
    shutil.copytree(Path(_jit.__file__).parent, tmp_path / "core" / "_jit")
    for name, text in FILES.items():
        path = tmp_path / "core" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    return tmp_path


def call(folder, **environment):
    """The result of the kernel, and whether it came from the cache, in a new process."""
    output = children.run(
        CALL, str(folder), NUMBA_CACHE_DIR="", NUMBA_DEBUG_CACHE="1", **environment
    )
    result = next(line for line in output.splitlines() if line.startswith("result"))
    return result, "data loaded from" in output


def cached(folder):
    return sorted((folder / "core" / "_kernels" / "__pycache__").glob("*.nb?"))


def test_a_second_process_compiles_only_what_was_edited(folder):
    assert call(folder) == ("result 0.0 2.0 4.0", False)
    assert call(folder) == ("result 0.0 2.0 4.0", True)
    before = cached(folder)
    formulas = folder / "core" / "_formulas" / "small.py"
    formulas.write_text(formulas.read_text().replace("2.0", "3.0"))
    assert call(folder) == ("result 0.0 3.0 6.0", False)
    assert call(folder) == ("result 0.0 3.0 6.0", True)
    assert len(cached(folder)) == len(before)  # those of the earlier source are gone


def test_files_that_cannot_be_read_are_compiled_anew(folder):
    call(folder)
    for damage in (lambda content: b"", lambda content: content[:-40], lambda content: b"garbage"):
        for path in cached(folder):
            path.write_bytes(damage(path.read_bytes()))
        assert call(folder) == ("result 0.0 2.0 4.0", False)


def test_without_a_folder_to_write_to(folder):
    """Each process compiles for itself, as in a read-only installation."""
    blocked = folder / "core" / "_kernels" / "__pycache__"
    blocked.write_text("not a folder")
    places = {"HOME": str(blocked), "XDG_CACHE_HOME": str(blocked), "LOCALAPPDATA": str(blocked)}
    assert call(folder, PYTHONDONTWRITEBYTECODE="1", **places) == ("result 0.0 2.0 4.0", False)
    assert blocked.read_text() == "not a folder"


def test_a_numba_whose_cache_is_organised_otherwise(folder):
    """Then its own cache is used as it is."""
    cache = folder / "core" / "_jit" / "cache.py"
    cache.write_text(cache.read_text().replace('"_cache"', '"_cache_of_another_numba"'))
    assert call(folder) == ("result 0.0 2.0 4.0", False)
    assert call(folder) == ("result 0.0 2.0 4.0", True)


LOOPS_OF_A_FACTORY = """
from numba import prange
from .._jit import Kernel, formula, inner

@formula
def twice(x):
    return 2.0 * x

@formula
def half(x):
    return 0.5 * x

def loop_of(change):
    @inner
    def part(x, out):
        for i in range(x.size):
            out[i] = change(x[i])
    return part

def whole(x, out):
    for _ in prange(1):
        part(x, out)

first = Kernel(whole, "first", part=loop_of(twice))
second = Kernel(whole, "second", part=loop_of(half))
"""
CALL_SOME = """
import sys
sys.path.insert(0, sys.argv[1])
from core._kernels import loops
import numpy as np
x = np.arange(3.0)
for name in sys.argv[2:]:
    getattr(loops, name).serial(x, out := np.zeros(3))
    print(*out)
"""


def test_loops_of_one_factory_that_two_processes_compiled(folder):
    """A third process loads both."""
    (folder / "core" / "_kernels" / "loops.py").write_text(LOOPS_OF_A_FACTORY)
    for names in (["first"], ["second"], ["first", "second"]):
        output = children.run(CALL_SOME, str(folder), *names, NUMBA_CACHE_DIR="")
    assert output.split("\n")[:2] == ["0.0 2.0 4.0", "0.0 0.5 1.0"]
