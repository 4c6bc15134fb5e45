"""All code blocks of the README run, and print the output in their comments."""

import math
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from test_cli import succeed
from test_docs import BLOCK, DOCS, PRINTED, blocks, run

from suslov_fast._cli import main, pictures
from suslov_fast._engine import threads

README = DOCS.parent / "README.md"


@pytest.mark.compiled
def test_blocks_in_one_folder(tmp_path, monkeypatch):
    """Run all blocks in order, as a reader does; serially, since parallel loops compile slowly.

    Each Python block is a program of its own. Commands run in this process, with one picture, as
    test_cli.py draws all.
    """
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(threads, "CROSSOVER", math.inf)
    monkeypatch.setattr(pictures, "PICTURES", {4: pictures.PICTURES[4]})
    monkeypatch.chdir(tmp_path)
    kinds = []
    for kind, code in BLOCK.findall(README.read_text(encoding="utf-8")):
        kinds.append(kind)
        if kind == "python":
            expected = [after or below for after, below in PRINTED.findall(code)]
            assert run(code, "README.md", {}).splitlines() == expected
        elif kind == "sh":
            for line in code.splitlines():
                command, *arguments = shlex.split(line)
                with pytest.raises(SystemExit) as stopped:
                    main(arguments)
                assert (command, stopped.value.code) == ("suslov-fast", 0), line
    assert kinds.count("python") >= 3
    assert "sh" in kinds
    assert np.load(tmp_path / "run.npz")["omega"].shape == (6, 1000, 2)
    assert (tmp_path / "pictures" / "picture4.png").exists()
    subprocess.run([Path(sys.executable).with_name("suslov-fast"), "--version"], check=True)


def test_length_and_set_up():
    """The lines that set up a checkout are those that CI runs."""
    text = README.read_text(encoding="utf-8")
    assert text.count("\n") <= 170
    assert {name for name, _ in BLOCK.findall(text)} == {"python", "sh", "sh setup", "text"}
    first, second = "".join(blocks(README, "sh setup")).splitlines()
    assert first.endswith(".venv/bin/suslov-fast run")
    assert second.endswith(".venv/bin/pytest -n 2 --dist loadfile")
    assert "sh setup" in (DOCS.parent / ".ci" / "run").read_text(encoding="utf-8")


def test_the_summary_has_the_lines_that_the_command_prints():
    printed, (shown,) = succeed("run --trajectories 5 --steps 5"), blocks(README, "text")
    heads = [re.findall(r"^.{1,16}", text, re.MULTILINE) for text in (printed, shown)]
    assert heads[0] == heads[1]
