"""The cache of compiled kernels: used by later processes, never stale, never fatal."""

import re
import shutil
from pathlib import Path

import children
import pytest

from suslov_fast import _jit

pytestmark = pytest.mark.compiled

# A small package with a copy of `_jit` and kernels that compile fast: loops made by one function,
# which differ in a formula of another module.
FILES = {
    "__init__.py": "",
    "_formulas/__init__.py": "",
    "_formulas/small.py": """
from .._jit import formula

@formula
def twice(x):
    return 2.0 * x

@formula
def half(x):
    return 0.5 * x

@formula
def opposite(x):
    return -x
""",
    "_kernels/__init__.py": "",
    "_kernels/loops.py": """
from .._formulas.small import half, opposite, twice
from .._jit import Kernel, inner

def loop_of(name, change):
    def fill(x, out):
        for i in range(x.size):
            out[i] = change(x[i])

    fill.__qualname__ = name + "_fill"
    return inner(fill)

def whole(part, parts, x, out):
    fill(x, out)

names = {"opposite_twice": twice, "half": half, "opposite": opposite}
kernels = {each: Kernel(whole, name, fill=loop_of(name, each)) for name, each in names.items()}
""",
}
CALL = """
import sys
sys.path.insert(0, sys.argv[1])
from core._formulas import small
from core._kernels import loops
import numpy as np
assert loops.__file__.startswith(sys.argv[1])
for name in sys.argv[2:]:
    loops.kernels[getattr(small, name)].CALLED(np.arange(3.0), out := np.zeros(3))
    print("result", name, *out)
"""
KERNELS = r"loops\.(?:twice|half|opposite|opposite_twice)|kernels\._start|kernels\._in_parts"
TWICE, HALF, OPPOSITE = "twice 0.0 2.0 4.0", "half 0.0 0.5 1.0", "opposite -0.0 -1.0 -2.0"


@pytest.fixture
def folder(tmp_path):
    shutil.copytree(Path(_jit.__file__).parent, tmp_path / "core" / "_jit")
    for name, text in FILES.items():
        path = tmp_path / "core" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    return tmp_path


def call(folder, *names, threads=1, **environment):
    """Return the results of kernels in a new process, and the number loaded from the cache.

    Inner functions, which a kernel that is compiled anew may load, are not counted.
    """
    environment = {"NUMBA_CACHE_DIR": "", "NUMBA_DEBUG_CACHE": "1"} | environment
    code = CALL.replace("CALLED(", "serial(" if threads == 1 else f"parallel({threads}, ")
    output = children.run(code, str(folder), *names, **environment)
    results = [line.partition("result ")[2] for line in output.splitlines() if "result " in line]
    return results, len(re.findall(rf"data loaded from .*/(?:{KERNELS})_[0-9a-f]+_", output))


def cached(folder):
    return sorted((folder / "core" / "_kernels" / "__pycache__").glob("*.nb?"))


def test_later_processes_compile_edited_and_damaged_kernels_only(folder):
    """A process distinguishes the cached loops that other processes compiled."""
    every = "twice", "half", "opposite"
    assert call(folder, "twice") == ([TWICE], 0)
    assert call(folder, "half", "opposite") == ([HALF, OPPOSITE], 0)
    assert call(folder, *every) == ([TWICE, HALF, OPPOSITE], 3)
    before = cached(folder)
    damages = lambda content: b"", lambda content: content[:-40], lambda content: b"garbage"
    names = "opposite_twice", "half", "opposite"  # the first begins with the name of the last
    for name, damage in zip(names, damages, strict=True):
        damaged = [path for path in before if re.search(rf"\.{name}_[0-9a-f_]+-", path.name)]
        assert len(damaged) == 2
        for path in damaged:
            path.write_bytes(damage(path.read_bytes()))
    assert call(folder, *every) == ([TWICE, HALF, OPPOSITE], 0)
    assert call(folder, *every) == ([TWICE, HALF, OPPOSITE], 3)
    formulas = folder / "core" / "_formulas" / "small.py"
    formulas.write_text(formulas.read_text().replace("2.0", "3.0"))
    assert call(folder, *every) == (["twice 0.0 3.0 6.0", HALF, OPPOSITE], 0)
    assert len(cached(folder)) == len(before)  # files of the earlier source are deleted


def test_serial_and_parallel_calls_share_a_kernel(folder):
    assert call(folder, "half", threads=2) == ([HALF], 0)
    assert call(folder, "half", "opposite") == ([HALF, OPPOSITE], 1)
    assert call(folder, "half", "opposite", threads=2) == ([HALF, OPPOSITE], 4)  # and two loops


def test_environments_keep_their_own_files(folder):
    """Those with other libraries; kernels whose indices are checked are not cached."""
    assert call(folder, "half") == ([HALF], 0)
    before = cached(folder)
    assert call(folder, "half", NUMBA_BOUNDSCHECK="1") == ([HALF], 0)
    assert cached(folder) == before
    cache = folder / "core" / "_jit" / "cache.py"
    cache.write_text(cache.read_text().replace("{numba.__version__}", "another"))
    assert call(folder, "half") == ([HALF], 0)
    assert set(cached(folder)) > set(before)


def test_without_a_writable_folder(folder):
    """Each process compiles for itself, as in a read-only installation."""
    blocked = folder / "core" / "_kernels" / "__pycache__"
    blocked.write_text("not a folder")
    places = {"HOME": str(blocked), "XDG_CACHE_HOME": str(blocked), "LOCALAPPDATA": str(blocked)}
    assert call(folder, "twice", PYTHONDONTWRITEBYTECODE="1", **places) == ([TWICE], 0)
    assert blocked.read_text() == "not a folder"


def test_numba_with_another_cache_class(folder):
    """If Numba's cache class is not the expected one, it is used unchanged."""
    cache = folder / "core" / "_jit" / "cache.py"
    cache.write_text(cache.read_text().replace('"_cache"', '"_cache_of_another_numba"'))
    assert call(folder, "twice") == ([TWICE], 0)
    assert cached(folder)


@pytest.mark.slow
def test_nothing_is_compiled_after_warm_up(tmp_path):
    cache = {"NUMBA_CACHE_DIR": str(tmp_path), "timeout": 900}
    children.run("from suslov_fast._cli import main; main(['warm-up'])", **cache)
    compiled, tests = set(tmp_path.rglob("*.nbc")), Path(__file__).with_name("test_promises.py")
    children.run("import pytest, sys; sys.exit(pytest.main(['-q', sys.argv[1]]))", tests, **cache)
    assert set(tmp_path.rglob("*.nbc")) == compiled
