"""Commands where the wheel and what it requires are installed, and nothing else.

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

import children
import pytest

REQUIRED = "numba", "llvmlite", "numpy", "scipy"


def test_commands_where_only_the_requirements_are_installed(tmp_path):
    pytest.importorskip("hatchling")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(build, check=True, capture_output=True, cwd=children.ROOT, timeout=300)
    [wheel] = tmp_path.glob("*.whl")
    packages = tmp_path / "packages"
    zipfile.ZipFile(wheel).extractall(packages)
    [metadata] = packages.glob("*.dist-info/METADATA")
    required = re.findall(r"^Requires-Dist: (\w+)[^;\n]*$", metadata.read_text(), re.MULTILINE)
    assert {*required} == {*REQUIRED} - {"llvmlite"}
    for name in REQUIRED:
        [found] = importlib.util.find_spec(name).submodule_search_locations
        for path in (Path(found), Path(f"{found}.libs")):
            if path.exists():
                (packages / path.name).symlink_to(path)
    for line, is_done, printed in (
        ("run --trajectories 5 --steps 20", True, "steps_per_second"),
        ("figures -o figures", False, "[plots]"),
    ):
        done = subprocess.run(
            [sys.executable, "-S", "-P", "-m", "suslov_fast", *line.split()], check=False,
            env=os.environ | {"PYTHONPATH": str(packages)}, stdin=subprocess.DEVNULL,
            capture_output=True, text=True, cwd=tmp_path, timeout=300,
        )  # fmt: skip
        assert (done.returncode == 0) == is_done
        assert done.returncode >= 0  # no signal
        assert printed in done.stdout + done.stderr
        assert "Traceback" not in done.stderr
