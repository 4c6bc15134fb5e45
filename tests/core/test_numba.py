"""Kernels: compiled, interpreted, parallel, with and without a cache.

A small package with a copy of `core` compiles fast.
"""

import re
import shutil
from pathlib import Path

import children
import numba
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast.core.numba import decorators
from suslov_fast.core.suslov import steps as steps_3d

pytestmark = pytest.mark.compiled

FILES = {
    "__init__.py": "",
    "core/__init__.py": "",
    "core/small.py": """
from .decorators import for_users

@for_users
def change(x):
    return 2.0 * x
""",
    "core/loops.py": """
from .intrinsics import select
from .decorators import kernel, share
from .small import change

@kernel
def double(part, parts, arrays, numbers, out):
    begin, end = share(out.size, part, parts)
    for i in range(begin, end):
        doubled, other = change(arrays[0][i]), arrays[1][i + numbers[1]]
        out[i] = select(arrays[0][i] > numbers[0][0], doubled, other)
""",
}
CALL = """
import sys
sys.path.insert(0, sys.argv[1])
from package.core import decorators as options, loops
import numpy as np
options.WARM_UP = -1.0  # nothing runs as Python
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
    else:
        out = [loops.change(2.0)]
    print("result", name, *out)
"""
RESULTS = {
    "serial": "serial -1.0 2.0 4.0",
    "parallel": "parallel -1.0 2.0 4.0",
    "change": "change 4.0",
}
NAMES = r"small\.change|loops\.double|decorators\._start"
LOADED = rf"data loaded from .*/(?:{NAMES})_"


@pytest.fixture
def folder(tmp_path):
    core, source = tmp_path / "package" / "core", Path(decorators.__file__).parent
    shutil.copytree(source, core, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(source.parent / "cached.py", core.parent)
    for name, text in FILES.items():
        (tmp_path / "package" / name).write_text(text)
    return tmp_path


def call(folder, *names, code=CALL, **environment):
    """Check the results of functions in a new process; return how many files it loaded."""
    environment = {"NUMBA_CACHE_DIR": "", "NUMBA_DEBUG_CACHE": "1"} | environment
    output = children.run(code, folder, *names, PYTHONWARNINGS="error", **environment)
    lines = [line.partition("result ")[2] for line in output.splitlines() if "result " in line]
    assert lines == [RESULTS[name] for name in names]
    events = re.findall(r"data (loaded|saved) \w+ '(.*)'", output)
    for n, (how, path) in enumerate(events):  # else code was refused, and compiled again
        assert how == "loaded" or ("loaded", path) not in events[:n]
    return len(re.findall(LOADED, output))


def cached(folder, name="*"):
    pattern = f"*loops.{name}_*.nb?" if name != "*" else "*.nb?"
    return sorted((folder / "package" / "core" / "__pycache__").glob(pattern))


@pytest.mark.slow
def test_settings_of_numba(folder):
    """Interpreted, and with checks of bounds, the results are the same, and nothing is cached."""
    for variable in ("NUMBA_DISABLE_JIT", "NUMBA_BOUNDSCHECK"):
        assert call(folder, *RESULTS, **{variable: "1"}) == 0
        assert cached(folder) == []
        done = children.attempt(CALL, folder, "beyond", NUMBA_CACHE_DIR="", **{variable: "1"})
        assert done.returncode == 1
        assert "IndexError" in done.stderr


@pytest.mark.slow
def test_later_processes_compile_edited_and_damaged_functions_only(folder):
    assert call(folder, *RESULTS) == 0
    assert call(folder, *RESULTS) == 3
    for content in (b"garbage", b"", b"\x80"):
        files = cached(folder, "double")
        assert len(files) >= 2
        for path in files:
            path.write_bytes(content)
        before = cached(folder)
        assert call(folder, *RESULTS) == 2
        assert call(folder, *RESULTS) == 3
    small = folder / "package" / "core" / "small.py"
    small.write_text(small.read_text().replace("2.0", "2.0 * 1.0"))
    assert call(folder, *RESULTS) == 0
    after = cached(folder)
    assert len(after) == len(before)  # files of the earlier source are deleted
    assert not set(after) & set(before)


@pytest.mark.slow
def test_without_a_writable_folder(folder):
    """Each process compiles for itself, as in a read-only installation."""
    blocked = folder / "package" / "core" / "__pycache__"
    blocked.write_text("not a folder")
    places = {"HOME": str(blocked), "XDG_CACHE_HOME": str(blocked), "LOCALAPPDATA": str(blocked)}
    assert call(folder, *RESULTS, PYTHONDONTWRITEBYTECODE="1", **places) == 0
    assert blocked.read_text() == "not a folder"


def test_the_folder_of_the_files_of_a_function(body, monkeypatch):
    monkeypatch.setattr(decorators, "WARM_UP", -1.0)  # compile, whatever ran before
    sf.iterate(body, [1.0, 0.5], 0.2, 1)
    assert list(Path(steps_3d.steps.compiled.stats.cache_path).glob("*steps.steps_*.nbi"))


# Names of Numba that are not public, and where they are. Numba itself needs them: they are hidden
# from the package alone.
PRIVATE = {
    "_cache": "numba.core.dispatcher.Dispatcher",
    "FunctionCache": "numba.core.caching",
}
HIDE = """
import sys, numba
from numba.core import ccallback, dispatcher

def hide(place, name):
    if isinstance(place, type(sys)):
        return delattr(place, name)
    get, put = place.__getattribute__, place.__setattr__
    def check(asked):
        if asked == name and sys._getframe(2).f_globals["__name__"].startswith("package."):
            raise AttributeError(name)
    place.__getattribute__ = lambda self, asked: check(asked) or get(self, asked)
    place.__setattr__ = lambda self, asked, value: check(asked) or put(self, asked, value)
"""


@pytest.mark.slow
def test_without_private_names_of_numba(folder):
    """What takes the place of these names is slower, and gives the same results."""
    hidden = "\n".join(f"hide({place}, {name!r})" for name, place in PRIVATE.items())
    code = f"{HIDE}\n{hidden}\n{CALL}"
    for _ in range(2):  # with an empty cache, and with what the first process wrote
        output = children.run(code, folder, *RESULTS, NUMBA_CACHE_DIR="")
        lines = [text.partition("result ")[2] for text in output.splitlines() if "result" in text]
        assert lines == [*RESULTS.values()]


def test_an_error_of_compiling_names_a_numba_that_was_not_tested(monkeypatch):
    """What a newer one breaks ends in its own words, of no use to who installed the package."""

    @decorators.kernel
    def broken(part, parts, numbers):
        numbers[0] += "1"

    def call():
        broken.serial(np.zeros(1))

    with pytest.raises(numba.TypingError):
        call()
    monkeypatch.setattr(numba, "__version__", "99.7.0rc1")
    last = f"{decorators.TESTED[0]}.{decorators.TESTED[1]}"
    words = rf"numba 99\.7\.0rc1; .* tested with is {last}: pip install 'numba<0\.\d+'$"
    with pytest.raises(RuntimeError, match=words) as found:
        call()
    assert isinstance(found.value.__cause__, numba.TypingError)
