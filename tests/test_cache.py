"""Compiled code on disk: fast in a second process, never stale, never fatal."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import suslov_fast

pytestmark = pytest.mark.compiled

# The attitude is what compiles fastest.
STEP = """
import sys; sys.path.insert(0, {folder!r})
import suslov_fast, numpy as np
assert suslov_fast.__file__.startswith({folder!r})
body = suslov_fast.Suslov3D(4, 1, -0.5, -0.3)
print(suslov_fast.attitude(body, [[0.375, -0.625]] * 2, 0.2).tolist())
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
    assert any("reconstruct" in name for name in kept)
    again, log = run(copy, NUMBA_DEBUG_CACHE="1")
    assert first in again
    assert "data loaded" in again + log
    assert "data saved" not in again + log
    assert compiled_files(copy) == kept


def test_an_edit_of_any_module_counts(copy):
    """The formula is not in the file of the loop that is cached."""
    before, _ = run(copy)
    edited = copy / "suslov_fast" / "_core" / "formulas" / "rotation.py"
    source = edited.read_text()
    stat = edited.stat()
    changed = source.replace("half = 0.5 * eps", "half = 0.25 * eps")
    assert changed != source
    edited.write_text(changed)
    os.utime(edited, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    for stale in copy.rglob("rotation*.pyc"):
        stale.unlink()  # Python's own cache looks at the time and size alone
    after, _ = run(copy)
    assert before != after
    edited.write_text(source)
    assert run(copy)[0] == before


def test_a_damaged_cache_is_replaced(copy):
    first, _ = run(copy)
    for suffix in ("*.nbc", "*.nbi"):
        for path in copy.rglob(suffix):
            path.write_bytes(b"damaged")
        assert run(copy)[0] == first


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
