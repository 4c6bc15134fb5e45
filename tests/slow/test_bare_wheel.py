"""Each command where the wheel and what it requires are installed, and nothing else.

The wheel is unpacked into a folder with links to the packages that it requires. Python looks there,
and not in its own site-packages.
"""

import importlib.util
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

REQUIRED = "numba", "llvmlite", "numpy", "scipy"
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with the packages."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("bare")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, check=True, capture_output=True, cwd=ROOT, timeout=300)
    [wheel] = folder.glob("*.whl")
    packages = folder / "packages"
    zipfile.ZipFile(wheel).extractall(packages)
    [metadata] = packages.glob("*.dist-info/METADATA")
    required = re.findall(r"^Requires-Dist: (\w+)[^;\n]*$", metadata.read_text(), re.MULTILINE)
    assert {*required} == {*REQUIRED} - {"llvmlite"}
    for name in REQUIRED:
        [found] = importlib.util.find_spec(name).submodule_search_locations
        for path in (Path(found), Path(f"{found}.libs")):
            if path.exists():
                (packages / path.name).symlink_to(path)
    return packages


@pytest.fixture
def command(place, tmp_path):
    """A function that runs a command and returns its exit status and output."""

    def run(*arguments):
        done = subprocess.run(
            [sys.executable, "-S", "-P", "-m", "suslov_fast", *arguments], check=False,
            env=os.environ | {"PYTHONPATH": str(place)}, stdin=subprocess.DEVNULL,
            capture_output=True, text=True, cwd=tmp_path, timeout=300,
        )  # fmt: skip
        assert "Traceback" not in done.stderr, done.stderr[-2000:]
        return done.returncode, done.stdout + done.stderr

    return run


def test_run(command):
    status, text = command("run", "--trajectories", "5", "--steps", "20")
    assert status == 0
    assert "steps_per_second" in text


def test_figures_name_their_extra(command):
    status, text = command("figures", "-o", "figures")
    assert status not in (0, -11)
    assert "[plots]" in text
