"""Compiled code on disk: fast in a second process, never stale, never fatal."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import damage
import pytest

import suslov_fast
from suslov_fast._core import cache

pytestmark = pytest.mark.compiled

# The energy is what compiles fastest.
STEP = """
import sys; sys.path.insert(0, {folder!r})
import suslov_fast, numpy as np
assert suslov_fast.__file__.startswith({folder!r})
body = suslov_fast.Suslov3D(4, 1, -0.5, -0.3)
print(suslov_fast.energy(body, [1.0, 0.5]).tolist())
"""


@pytest.fixture
def copy(tmp_path):
    """A copy of the installed package, without its caches."""
    folder = tmp_path / "copy"
    source = Path(suslov_fast.__file__).parent
    shutil.copytree(source, folder / "suslov_fast", ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def run(folder, **environment):
    kept = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", STEP.format(folder=str(folder))],
        env=kept | environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def compiled_files(folder):
    return sorted(path.name for path in folder.rglob("*.nbc"))


def test_what_is_called_is_kept(copy):
    first, _ = run(copy)
    kept = compiled_files(copy)
    assert any("energy" in name for name in kept)
    again, log = run(copy, NUMBA_DEBUG_CACHE="1")
    assert first in again
    assert "data loaded" in again + log
    assert "data saved" not in again + log
    assert compiled_files(copy) == kept


def test_an_edit_of_any_module_counts(copy):
    """The formula is not in the file of the loop that is cached."""
    before, _ = run(copy)
    edited = copy / "suslov_fast" / "_core" / "formulas" / "integrals.py"
    source = edited.read_text()
    stat = edited.stat()
    changed = source.replace("return 0.5 * I1", "return 0.25 * I1")
    assert changed != source
    edited.write_text(changed)
    os.utime(edited, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    for stale in copy.rglob("integrals*.pyc"):
        stale.unlink()  # Python's own cache looks at the time and size alone
    after, _ = run(copy)
    assert before != after
    edited.write_text(source)
    assert run(copy)[0] == before


def test_a_damaged_cache_is_replaced(copy):
    first, _ = run(copy)
    (path,) = copy.rglob("*.nbc")
    sound = path.read_bytes()
    for damaged in (b"", b"damaged", sound[:-1], sound + b"\0", sound[: len(sound) // 2]):
        path.write_bytes(damaged)
        again, _ = run(copy, NUMBA_DEBUG_CACHE="1")
        assert first in again
        assert "data loaded" not in again
        assert "data saved" in again


@pytest.mark.parametrize("seed", range(3))
def test_flipped_bits_and_zeroed_blocks(copy, seed):
    """Code with one wrong bit may crash, or worse, compute."""
    first, _ = run(copy)
    (path,) = copy.rglob("*.nbc")
    sound = path.read_bytes()
    path.write_bytes(damage.damaged(sound, seed))
    again, _ = run(copy, NUMBA_DEBUG_CACHE="1")
    assert first in again
    assert "data loaded" not in again
    assert "data saved" in again
    assert run(copy)[0] == first


def test_files_of_another_key_are_not_taken(copy):
    """Two processes may write at once, and a file may be renamed."""
    first, _ = run(copy, NUMBA_CPU_NAME="generic")
    second, _ = run(copy)
    assert first == second
    one, other = copy.rglob("*.nbc")
    one.write_bytes(other.read_bytes())
    for cpu in ({"NUMBA_CPU_NAME": "generic"}, {}):
        assert run(copy, **cpu)[0] == first


def test_no_place_for_a_cache(copy):
    """Neither the package's folder nor the user's can be written to: compile in memory."""
    first, _ = run(copy)
    for path in copy.rglob("__pycache__"):
        shutil.rmtree(path)
        path.write_text("a file in the place of the folder")
    nowhere = str(copy / "suslov_fast" / "__init__.py")
    again, _ = run(copy, HOME=nowhere, XDG_CACHE_HOME=nowhere, PYTHONDONTWRITEBYTECODE="1")
    assert again == first


def test_many_processes_at_once(copy):
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", STEP.format(folder=str(copy))],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for _ in range(4)
    ]
    results = [process.communicate(timeout=180) for process in processes]
    assert [process.returncode for process in processes] == [0] * 4, results
    assert len({output for output, _ in results}) == 1
    assert run(copy)[0] == results[0][0]


needs_modes = pytest.mark.skipif(os.name != "posix", reason="needs POSIX file modes")


@needs_modes
def test_a_folder_that_others_write_to_is_passed_by(copy, tmp_path):
    """What anyone may put there would run as code."""
    (home := tmp_path / "home").mkdir()
    beside = copy / "suslov_fast" / "_core" / "cpu" / "__pycache__"
    beside.mkdir()
    beside.chmod(0o777)
    first, _ = run(copy, HOME=str(home), XDG_CACHE_HOME=str(home))
    assert not compiled_files(beside)
    assert len(compiled_files(home)) == 1
    for folder in home.rglob("*"):
        if folder.is_dir():
            folder.chmod(0o777)
    again, _ = run(copy, HOME=str(home), XDG_CACHE_HOME=str(home), NUMBA_DEBUG_CACHE="1")
    assert first == again  # with nothing loaded or saved


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


QUANTITY = """
import sys; sys.path.insert(0, {folder!r})
import suslov_fast as sf
body = sf.Suslov3D(1, 1, 1, 0)
for name in sys.argv[1:]:
    arguments = () if name in ("energy", "vector_field") else (1.0,)
    print(name, getattr(sf, name)(body, [0.3, 0.1], *arguments).tolist())
"""


def test_what_was_compiled_apart_is_not_mixed_up(copy):
    """Kernels of one source, each compiled in a process of its own, are loaded into one process."""
    names = ["first_integral", "criticality", "modified_energy", "invariant_density"]

    def printed(*which):
        done = subprocess.run(
            [sys.executable, "-c", QUANTITY.format(folder=str(copy)), *which],
            env={k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"},
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    alone = [line for name in names for line in printed(name)]
    assert printed(*names) == alone
    assert printed(*reversed(names)) == alone[::-1]
