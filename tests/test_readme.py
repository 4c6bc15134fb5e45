"""All code blocks of the README run, and print the output in their comments."""

import math
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from test_docs import run

from suslov_fast._cli import main, pictures
from suslov_fast._engine import threads

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(.*?)\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


def blocks(language):
    return [code for name, code in BLOCKS if name == language]


@pytest.mark.compiled
def test_python_blocks(tmp_path, monkeypatch):
    """Run each block alone, as a reader would; serially, since parallel loops compile slowly."""
    monkeypatch.setattr(threads, "CROSSOVER", math.inf)
    monkeypatch.chdir(tmp_path)
    assert len(blocks("python")) == 3
    for code in blocks("python"):
        expected = re.findall(r"print\(.*\) +# (.*)", code)
        assert run(code, "README.md", {}).splitlines() == expected


@pytest.mark.compiled
def test_shell_blocks(tmp_path, monkeypatch):
    """Run the commands in this process, with one picture, as test_cli.py draws all."""
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(pictures, "DRAWINGS", {"picture4": pictures.DRAWINGS["picture4"]})
    for line in "".join(blocks("sh")).splitlines():
        command, *arguments = shlex.split(line)
        with pytest.raises(SystemExit) as stopped:
            main(arguments)
        assert (command, stopped.value.code) == ("suslov-fast", 0), line
    subprocess.run([Path(sys.executable).with_name("suslov-fast"), "--version"], check=True)
    assert np.load(tmp_path / "orbits.npz")["omega"].shape == (6, 1000, 2)
    assert (tmp_path / "pictures" / "picture4.png").exists()


def test_length():
    assert README.count("\n") <= 150
    assert {name for name, _ in BLOCKS} == {"python", "sh", "sh setup", "text"}


def test_setup_lines_are_the_ones_that_ci_runs():
    (setup,) = blocks("sh setup")
    first, second = setup.splitlines()
    assert first.endswith(".venv/bin/suslov-fast run")
    assert second.endswith(".venv/bin/pytest -n 2 --dist loadfile")
    assert "sh setup" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


def test_the_summary_has_the_lines_that_the_command_prints():
    command = [sys.executable, "-m", "suslov_fast", "run", "--trajectories", "5", "--steps", "5"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    (shown,) = blocks("text")
    heads = [[line[:16] for line in text.splitlines()] for text in (done.stdout, shown)]
    assert heads[0] == heads[1]
