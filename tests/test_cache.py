"""Compiled code: of loops alone; on disk: fast in a second process, never stale, never fatal."""

import os
import shutil
from pathlib import Path

import children
import damage
import pytest

import suslov_fast
from suslov_fast._core import cache, pipeline

pytestmark = pytest.mark.compiled

CORE = Path(cache.__file__).parent

# A core whose loops compile fast, around the modules that keep what is compiled.
FORMULAS = """
from ..staged import formula

@formula
def double(x):
    return 2.0 * x

@formula
def half(x):
    return 0.5 * x

@formula
def square(x):
    return x * x

@formula
def more(x):
    return x + 1.0
"""
LOOPS = """
from numba import prange
from ..formulas import small
from ..jit import Loop
from ..staged import apart, formula

def filled_with(name, function):
    @formula
    def value(x):
        %s
        return x

    @apart
    def fill(x, out):
        for i in range(x.size):
            out[i] = value(x[i])

    def loop(x, out):
        for row in prange(x.shape[0]):
            fill(x[row], out[row])

    loop.__name__ = name
    return Loop(loop)

names = ("double", "half", "square", "more")
loops = {name: filled_with(name, getattr(small, name)) for name in names}
""" % ("x = function(x); " * 40)
# Loops of one name, told apart only by what their part holds.
NAMESAKES = """
from numba import prange
from ..formulas import small
from ..jit import Loop
from ..staged import staged

def filled_with(function):
    @staged
    def fill(x, out):
        for i in range(x.size):
            out[i] = function(x[i])

    def loop(x, out):
        for row in prange(x.shape[0]):
            fill(x[row], out[row])

    return Loop(loop)

loops = {name: filled_with(getattr(small, name)) for name in ("half", "more")}
"""
CALL = """
import sys
folder, *names = sys.argv[1:]
sys.path.insert(0, folder)
import core.cpu.loops as module
import numpy as np
assert module.__file__.startswith(folder)
x = np.arange(1.0, 7.0).reshape(2, 3)
for name in names:
    module.loops[name].serial(x, out := np.zeros_like(x))
    print("result", name, *out.ravel())
print("compiler imported:", "numba.np.arraymath" in sys.modules)
"""
# Before the call: names of all that becomes machine code. After it: a function of another package.
WATCH = """
from numba.core import codegen

def watched(self, module, add=codegen.JITCPUCodegen._add_module):
    print("result", module.name)
    return add(self, module)

codegen.JITCPUCodegen._add_module = watched
"""
MORE = """
import gc
import numba

module.loops["half"].parallel(x, out)
print("result half", *out.ravel(), gc.isenabled())

@numba.njit(parallel=True)
def another(x):
    total = 0.0
    for i in numba.prange(x.size):
        total += max(x[i], 1.5)
    return total

print("result", another(x.ravel()))
"""
# Empty settings are none: the cache is that beside the source, and Python keeps its own, so that
# the first process compiles modules, and others read them.
SETTINGS = {"NUMBA_CACHE_DIR": "", "PYTHONDONTWRITEBYTECODE": "", "NUMBA_DEBUG_CACHE": "1"}
NAMES = ["double", "half", "square", "more"]


@pytest.fixture
def core(tmp_path):
    """The folder of a small core."""
    folder = tmp_path / "small" / "core"
    for name, text in (("formulas/small", FORMULAS), ("cpu/loops", LOOPS)):
        (path := folder / f"{name}.py").parent.mkdir(parents=True)
        path.write_text(text)
    for name in ("jit.py", "pipeline.py", "cache.py", "staged.py", "stand_ins.py"):
        shutil.copy(CORE / name, folder)
    return folder


def command(core, names):
    return CALL, core.parent, *names


def call(core, *names, **environment):
    """What loops give, and what the cache says, in another process."""
    output = children.run(*command(core, names), **SETTINGS | environment)
    return results_of(output), output


def results_of(output):
    return [line for line in output.splitlines() if line.startswith("result")]


def files(folder):
    return sorted(folder.rglob("*.nbc"))


def test_what_is_called_is_kept(tmp_path):
    """Of a copy of the package without its caches: the energy is what compiles fastest."""
    source = Path(suslov_fast.__file__).parent
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(source, tmp_path / "suslov_fast", ignore=ignored)
    code = """
        import sys
        sys.path.insert(0, sys.argv[1])
        import suslov_fast as sf
        assert sf.__file__.startswith(sys.argv[1])
        print("result", sf.energy(sf.Suslov3D(4, 1, -0.5, -0.3), [1.0, 0.5]).tolist())
    """
    first, again = (children.run(code, tmp_path, **SETTINGS) for _ in range(2))
    assert results_of(first) == results_of(again) == ["result 2.125"]
    (kept,) = files(tmp_path)
    assert "energy" in kept.name
    assert (first.count("data saved"), first.count("data loaded")) == (1, 0)
    assert (again.count("data saved"), again.count("data loaded")) == (0, 1)


def test_what_is_kept_runs_without_the_compiler(core):
    """What Numba compiles with takes longer to import than all else of a second process."""
    assert "compiler imported: True" in call(core, "half")[1]
    assert "compiler imported: False" in call(core, "half")[1]
    # What is not kept is compiled all the same.
    both, log = call(core, "half", "double")
    assert (len(both), log.count("data saved"), log.count("data loaded")) == (2, 1, 1)


def test_an_edit_of_any_module_counts(core):
    """The formula is not in the file of the loop that is cached."""
    before, _ = call(core, "half")
    edited = core / "formulas" / "small.py"
    source = edited.read_text()
    stat = edited.stat()
    edited.write_text(source.replace("return 0.5 * x", "return 0.1 * x"))
    os.utime(edited, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    for stale in core.rglob("small*.pyc"):
        stale.unlink()  # Python's own cache looks at the time and size alone
    after, _ = call(core, "half")
    assert before != after
    edited.write_text(source)
    assert call(core, "half")[0] == before


def test_a_damaged_cache_is_replaced(core):
    """Code that is cut off, or has one wrong bit, may crash, or worse, compute."""
    first, _ = call(core, *NAMES)
    paths = files(core)
    assert len(paths) == len(NAMES)
    ways = [
        lambda sound: b"",
        lambda sound: b"damaged",
        lambda sound: sound[:-1],
        lambda sound: sound + b"\0",
        lambda sound: sound[: len(sound) // 2],
        *(lambda sound, seed=seed: damage.damaged(sound, seed) for seed in range(3)),
    ]
    for some in (ways[:4], ways[4:]):
        for path, damaged in zip(paths, some, strict=True):
            path.write_bytes(damaged(path.read_bytes()))
        again, log = call(core, *NAMES)
        assert again == first
        assert (log.count("data saved"), log.count("data loaded")) == (4, 0)
    again, log = call(core, *NAMES)
    assert again == first
    assert (log.count("data saved"), log.count("data loaded")) == (0, 4)


def test_files_of_another_key_are_not_taken(core):
    """Two processes may write at once, and a file may be renamed."""
    first, _ = call(core, "half", NUMBA_CPU_NAME="generic")
    assert call(core, "half")[0] == first
    one, other = files(core)
    one.write_bytes(other.read_bytes())
    told = ""
    for cpu in ({"NUMBA_CPU_NAME": "generic"}, {}):
        again, log = call(core, "half", **cpu)
        assert again == first
        told += log
    assert (told.count("data saved"), told.count("data loaded")) == (1, 1)


def test_no_place_for_a_cache(core):
    """Neither the folder of the source nor the user's can be written to: compile in memory."""
    first, _ = call(core, "half")
    for path in core.rglob("__pycache__"):
        shutil.rmtree(path)
        path.write_text("a file in the place of the folder")
    nowhere = str(core / "jit.py")
    settings = {"HOME": nowhere, "XDG_CACHE_HOME": nowhere, "PYTHONDONTWRITEBYTECODE": "1"}
    again, log = call(core, "half", **settings)
    assert again == first
    assert "data saved" not in log


def test_many_processes_at_once(core):
    at_once = [children.start(*command(core, ["half"]), NUMBA_CACHE_DIR="") for _ in range(4)]
    results = [children.finish(process) for process in at_once]
    assert [process.returncode for process in at_once] == [0] * 4, results
    first, log = call(core, "half")
    assert all(results_of(output) == first for output, _ in results)
    assert (log.count("data saved"), log.count("data loaded")) == (0, 1)


def test_what_was_compiled_apart_is_not_mixed_up(core):
    """Kernels of one source, each compiled in a process of its own, are loaded into one process."""
    alone = [line for name in ("half", "double") for line in call(core, name)[0]]
    together, log = call(core, "half", "double")
    assert together == alone
    assert (log.count("data saved"), log.count("data loaded")) == (0, 2)
    assert call(core, "double", "half")[0] == alone[::-1]


def test_loops_of_one_name_are_told_apart_by_what_their_parts_hold(core):
    (core / "cpu" / "loops.py").write_text(NAMESAKES)
    expected = {
        "half": "result half 0.5 1.0 1.5 2.0 2.5 3.0",
        "more": "result more 2.0 3.0 4.0 5.0 6.0 7.0",
    }
    for _ in range(2):
        for name, result in expected.items():
            assert call(core, name)[0] == [result]


needs_modes = pytest.mark.skipif(os.name != "posix", reason="needs POSIX file modes")


def test_only_loops_become_machine_code(core):
    """The rest of a loop is compiled as its ingredients; what others compile is not."""
    if not pipeline.KNOWN:
        pytest.skip("this Numba compiles every function whole")
    lines = results_of(children.run(WATCH + CALL + MORE, core.parent, "half", **SETTINGS))
    (half,) = call(core, "half")[0]
    expected = ["result half_serial", half, "result half_parallel", f"{half} True", "result 21.5"]
    others = [line for line in lines if line not in expected]
    assert [line for line in lines if line in expected] == expected
    # Numba's runtime; and what is none of ours is compiled as ever, whatever came before.
    assert "result nrt" in others
    assert "result another" in others
    assert not any("filled_with" in line or "half" in line for line in others)


@needs_modes
def test_a_folder_that_others_write_to_is_passed_by(core, tmp_path):
    """What anyone may put there would run as code."""
    (home := tmp_path / "home").mkdir()
    (beside := core / "cpu" / "__pycache__").mkdir()
    beside.chmod(0o777)
    settings = {"HOME": str(home), "XDG_CACHE_HOME": str(home)}
    first, _ = call(core, "half", **settings)
    assert not files(beside)
    assert len(files(home)) == 1
    for folder in home.rglob("*"):
        if folder.is_dir():
            folder.chmod(0o777)
    again, log = call(core, "half", **settings)
    assert first == again
    assert "data saved" not in log
    assert "data loaded" not in log


@needs_modes
@pytest.mark.parametrize(
    ("mode", "above", "expected"),
    [
        (0o755, 0o755, True),
        (0o700, 0o1777, True),
        (0o777, 0o755, False),
        (0o1777, 0o755, False),
        (0o755, 0o777, False),
    ],
)
def test_trust(tmp_path, mode, above, expected):
    folder = tmp_path / "above" / "folder"
    folder.mkdir(parents=True)
    folder.chmod(mode)
    folder.parent.chmod(above)
    assert cache.trusted.__wrapped__(folder) is expected
    link = tmp_path / "link"
    link.symlink_to(folder)
    assert cache.trusted.__wrapped__(link) is expected


@needs_modes
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="needs root")
def test_folders_of_other_users_and_groups(tmp_path):
    os.chown(tmp_path, 12345, -1)
    assert not cache.trusted.__wrapped__(tmp_path)
    os.chown(tmp_path, 0, 12345)
    assert cache.trusted.__wrapped__(tmp_path)
    tmp_path.chmod(0o775)
    assert not cache.trusted.__wrapped__(tmp_path)


@needs_modes
def test_a_chosen_folder_is_the_users_own_affair(tmp_path, monkeypatch):
    folder = tmp_path / "folder"
    folder.mkdir()
    folder.chmod(0o777)
    monkeypatch.setattr(cache.config, "CACHE_DIR", str(tmp_path))
    assert cache.trusted.__wrapped__(folder)
