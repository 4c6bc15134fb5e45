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

import numpy as np
import pytest

REQUIRED = "numba", "llvmlite", "numpy", "scipy"
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with the packages."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("bare")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, check=True, capture_output=True, cwd=ROOT)
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
            capture_output=True, text=True, cwd=tmp_path,
        )  # fmt: skip
        assert "Traceback" not in done.stderr, done.stderr[-2000:]
        return done.returncode, done.stdout + done.stderr

    return run


def test_nothing_else_is_reachable(place):
    code = "import sys, numba, suslov_fast; print(suslov_fast.__file__); import matplotlib"
    done = subprocess.run(
        [sys.executable, "-S", "-P", "-c", code],
        env=os.environ | {"PYTHONPATH": str(place)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stdout.startswith(str(place))
    assert "No module named 'matplotlib'" in done.stderr


def test_run_and_info(command, tmp_path):
    status, _ = command("run", "--trajectories", "5", "--steps", "20", "-o", "run.npz")
    assert status == 0
    assert np.load(tmp_path / "run.npz", allow_pickle=False)
    status, text = command("info", "run.npz")
    assert status == 0
    assert "5" in text


@pytest.mark.parametrize(
    ("extra", "arguments"),
    [
        ("plots", ["plot", "run.npz", "-o", "run.png"]),
        ("plots", ["figures", "-o", "figures"]),
        ("algebra", ["report", "--body", "field.json"]),
        ("large", ["run", "--trajectories", "5", "--steps", "20", "-o", "run.zarr"]),
    ],
)
def test_commands_that_need_an_extra_name_it(command, tmp_path, extra, arguments):
    field = '{"class": "QuadraticField", "equations": ["x2", "-x1*x2"], "names": ["x1", "x2"]}'
    (tmp_path / "field.json").write_text(field)
    command("run", "--trajectories", "5", "--steps", "20", "-o", "run.npz")
    status, text = command(*arguments)
    assert status not in (0, -11)
    assert f"[{extra}]" in text


WARM_UP = """
from suslov_fast.command import main as command, warm_up
warm_up.MANY, (first, *_) = 2, warm_up.MAPS
warm_up.MAPS = {first: warm_up.MAPS[first]}
command.main(["warm-up"])
"""


def test_warm_up(place):
    """For one map, interpreted: which functions are called counts here, and not what compiles."""
    done = subprocess.run(
        [sys.executable, "-S", "-P", "-c", WARM_UP],
        env=os.environ | {"PYTHONPATH": str(place), "NUMBA_DISABLE_JIT": "1"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.startswith("nothing is kept")


def test_explore(place, tmp_path):
    """It serves the page until it is interrupted."""
    with subprocess.Popen(
        [sys.executable, "-S", "-P", "-u", "-m", "suslov_fast", "explore", "--no-browser"],
        env=os.environ | {"PYTHONPATH": str(place)}, stdout=subprocess.PIPE, text=True,
        cwd=tmp_path,
    ) as process:  # fmt: skip
        try:
            assert "http://" in process.stdout.readline()
        finally:
            process.terminate()
