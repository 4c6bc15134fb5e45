"""Kernels and universal functions: compiled, interpreted, parallel, with and without a cache.

A small package with a copy of `core/numba.py` compiles fast.
"""

import re
import shutil
from pathlib import Path

import children
import pytest

from suslov_fast.core import numba as core_numba

pytestmark = pytest.mark.compiled

FILES = {
    "__init__.py": "",
    "core/__init__.py": "",
    "core/small.py": """
from .numba import for_users

@for_users
def change(x):
    return 2.0 * x
""",
    "core/loops.py": """
from .numba import kernel, select, share, universal
from .small import change

@kernel
def double(part, parts, arrays, numbers, out):
    begin, end = share(out.size, part, parts)
    for i in range(begin, end):
        doubled, other = change(arrays[0][i]), arrays[1][i + numbers[1]]
        out[i] = select(arrays[0][i] > numbers[0][0], doubled, other)

@universal("(),()->()")
def ratio(x, y, out):
    out[0] = change(x) / y

@universal("(),(d)->(d,d),(d)")
def outer(a, x, product, row):
    for i in range(x.size):
        row[i] = x[i] / a
        for j in range(x.size):
            product[i, j] = change(x[i]) * x[j]
""",
}
CALL = """
import sys
sys.path.insert(0, sys.argv[1])
from package.core import loops
import numpy as np
assert loops.__file__.startswith(sys.argv[1])
x = np.arange(3.0)
for name in sys.argv[2:]:
    out = np.zeros(3)
    if name in ("serial", "parallel"):
        arguments = (x, np.full(4, -1.0)), ((0.5,), 1), out
        if name == "serial":
            loops.double.serial(*arguments)
        else:
            loops.double.parallel(2, *arguments)
    elif name == "beyond":
        loops.double.serial((x, np.full(3, -1.0)), ((0.5,), 7), out)
    elif name == "change":
        out = [loops.change(2.0)]
    elif name == "ratio":
        out = loops.ratio([[1], [2]], np.arange(2.0)).ravel()
        assert loops.ratio(1.0, np.empty((0, 2))).shape == (0, 2)
    else:
        product, row = loops.outer([2.0, 4.0], x[::-1])
        assert product.shape == (2, 3, 3) and (product[0] == 2 * np.outer(x[::-1], x[::-1])).all()
        assert loops.outer(2.0, np.empty((0, 3)))[0].shape == (0, 3, 3)
        out = row.ravel()
    print("result", name, *out)
"""
RESULTS = {
    "serial": "serial -1.0 2.0 4.0",
    "parallel": "parallel -1.0 2.0 4.0",
    "change": "change 4.0",
    "ratio": "ratio inf 2.0 inf 4.0",
    "outer": "outer 1.0 0.5 0.0 0.5 0.25 0.0",
}
NAMES = r"small\.change|loops\.(?:double|ratio|outer)|numba\._start"
LOADED = rf"data loaded from .*/(?:{NAMES})_"


@pytest.fixture
def folder(tmp_path):
    for name, text in FILES.items():
        path = tmp_path / "package" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    shutil.copy(core_numba.__file__, tmp_path / "package" / "core")
    return tmp_path


def call(folder, *names, **environment):
    """Check the results of functions in a new process; return how many files it loaded."""
    environment = {"NUMBA_CACHE_DIR": "", "NUMBA_DEBUG_CACHE": "1"} | environment
    output = children.run(CALL, folder, *names, PYTHONWARNINGS="error", **environment)
    lines = [line.partition("result ")[2] for line in output.splitlines() if "result " in line]
    assert lines == [RESULTS[name] for name in names]
    return len(re.findall(LOADED, output))


def cached(folder, name="*"):
    pattern = f"*loops.{name}_*.nb?" if name != "*" else "*.nb?"
    return sorted((folder / "package" / "core" / "__pycache__").glob(pattern))


@pytest.mark.parametrize("variable", ["NUMBA_DISABLE_JIT", "NUMBA_BOUNDSCHECK"])
def test_settings_of_numba(folder, variable):
    """Interpreted, and with checks of bounds, the results are the same, and nothing is cached."""
    assert call(folder, *RESULTS) == 0
    before = cached(folder)
    assert call(folder, *RESULTS, **{variable: "1"}) == 0
    assert cached(folder) == before
    done = children.attempt(CALL, folder, "beyond", NUMBA_CACHE_DIR="", **{variable: "1"})
    assert done.returncode == 1
    assert "IndexError" in done.stderr


def test_later_processes_compile_edited_and_damaged_functions_only(folder):
    assert call(folder, *RESULTS) == 0
    assert call(folder, *RESULTS) == 5
    for path in cached(folder, "ratio")[-2:]:  # as if processes had written at once
        path.unlink()
    assert call(folder, "ratio") == 1
    damages = {"double": b"garbage", "ratio": b"", "outer": b"\x80"}
    for name, content in damages.items():
        files = cached(folder, name)
        assert len(files) >= 2
        for path in files:
            path.write_bytes(content)
    before = cached(folder)
    assert call(folder, *RESULTS) == 2
    assert call(folder, *RESULTS) == 3  # damaged universal functions are compiled again
    small = folder / "package" / "core" / "small.py"
    small.write_text(small.read_text().replace("2.0", "2.0 * 1.0"))
    assert call(folder, *RESULTS) == 0
    after = cached(folder)
    assert len(after) == len(before)  # files of the earlier source are deleted
    assert not set(after) & set(before)


def test_without_a_writable_folder(folder):
    """Each process compiles for itself, as in a read-only installation."""
    blocked = folder / "package" / "core" / "__pycache__"
    blocked.write_text("not a folder")
    places = {"HOME": str(blocked), "XDG_CACHE_HOME": str(blocked), "LOCALAPPDATA": str(blocked)}
    assert call(folder, *RESULTS, PYTHONDONTWRITEBYTECODE="1", **places) == 0
    assert blocked.read_text() == "not a folder"


@pytest.mark.slow
def test_nothing_is_compiled_after_warm_up(tmp_path):
    cache = {"NUMBA_CACHE_DIR": str(tmp_path), "timeout": 900}
    children.run("from suslov_fast.command import main; main(['warm-up'])", **cache)
    compiled, tests = set(tmp_path.rglob("*.nbc")), Path(__file__).with_name("test_promises.py")
    children.run("import pytest, sys; sys.exit(pytest.main(['-q', sys.argv[1]]))", tests, **cache)
    assert set(tmp_path.rglob("*.nbc")) == compiled
