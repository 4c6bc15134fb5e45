"""The command `suslov-fast`: what it computes and writes, and how it refuses."""

import json
import re
import subprocess
import sys
import time
from pathlib import Path

import children
import matplotlib.pyplot as plt
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast import command, waiting
from suslov_fast.command import main


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def call(line, capsys):
    """Run a command that must succeed without messages, and return its output."""
    code = main(line.split())
    out, err = capsys.readouterr()
    assert (code, err) == (0, "")
    return out


def test_help_needs_no_packages():
    code = "import atexit, sys; atexit.register(lambda: print(*sys.modules))"
    code += "; from suslov_fast.command import main; main(sys.argv[1:])"
    for line in ("--help", "run --help", "run --stpes 3"):
        done = children.attempt(code, *line.split())
        assert "usage: suslov-fast" in done.stdout or "use --steps" in done.stderr
        assert not {"numba", "numpy", "matplotlib"} & {*done.stdout.split()}
    command = [sys.executable, "-m", "suslov_fast", "-V"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.stdout == f"suslov-fast {sf.__version__}\n"


def test_a_run_of_a_body(capsys):
    facts = json.loads(call("run --trajectories 5 --steps 4e1 --save-every 10 -o a.npz", capsys))
    body, eps = sf.Suslov3D.figure(2)
    states = np.random.default_rng(0).uniform(-2.0, 2.0, (5, 2))
    assert sf.load("a.npz") == sf.iterate(body, states, eps, 40, save_every=10)
    assert (facts["trajectories"], facts["failed"], facts["written"]) == (5, 0, "a.npz")
    assert facts["steps_per_second"] * facts["seconds"] == pytest.approx(200)
    call("run --body 4,1,-.5,-.3,.7 --x0 -1,.5 --eps -1/8 --steps 9 -o a.npz --force", capsys)
    body = sf.Suslov3D(4, 1, -0.5, -0.3, 0.7)
    assert sf.load("a.npz") == sf.iterate(body, [-1.0, 0.5], -0.125, 9, save_every=None)


def test_a_run_at_a_terminal(capsys, monkeypatch):
    """The same facts as text; a rate never contains compilation."""
    line = "run --trajectories 5 --steps 40"
    facts = json.loads(call(line, capsys))
    assert facts["steps"] == 200
    assert 0 < facts["relative_change_of_F"] < 1e-14
    assert 0 < facts["relative_difference_from_theorem_1"] < 1e-14
    assert facts["steps_per_second_one_thread"] > 0
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    assert json.loads(call(f"{line} --json", capsys)).keys() == facts.keys()
    text = call(line, capsys)
    assert "5 orbits of Kahan's map, 200 steps in all, of length 0.2\n" in text
    for name in ("one thread: ", "Lemma 1: ", "Theorem 1: ", "next:"):
        assert f"\n{name}" in text
    assert re.search(r"change is [1-9]e-1[5-7]\n", text)
    monkeypatch.setattr(command, "_AGAIN", 0.0)
    assert "only one call was made" in call(line, capsys)
    facts = json.loads(call(f"{line} --json", capsys))
    assert (facts["seconds"], facts["steps_per_second"]) == (None, None)
    assert "time 2, " in call("run --time 2 --x0 1,0.5", capsys)
    one = call("run --steps 9 --x0 1,0.5", capsys)
    assert one.startswith("1 orbit of Kahan's map, 9 steps")
    assert "picture:     suslov-fast figures" in one
    assert "picture:     suslov-fast plot a.npz" in call("run --x0 1,0.5 -o a.npz", capsys)
    with_rotor = json.loads(call("run --json --body 4,1,0,0.1,1 --x0 1,1 --eps 1/8", capsys))
    assert not {"relative_change_of_F"} & {*with_rotor}


def test_a_line_at_the_terminal_while_it_compiles(capsys, monkeypatch):
    """From some time on; it says how far the call is as soon as the call says so, and goes."""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(waiting, "_FIRST", 0.01)
    monkeypatch.setattr(waiting, "_PAUSE", 0.01)
    shown, err = waiting.Waiting(), ""
    with shown:
        while "compiling" not in err:
            err += capsys.readouterr().err
        shown.report(3, 4)
        while "75 %" not in err:
            err += capsys.readouterr().err
    err += capsys.readouterr().err
    assert err.endswith("\r\x1b[K")
    assert {line.count("#") for line in re.findall(r"computing.*75", err)} == {18}
    monkeypatch.setattr(sys.stderr, "isatty", lambda: False)
    with waiting.Waiting() as shown:
        time.sleep(0.05)
    assert capsys.readouterr().err == ""


def test_a_run_of_equations(capsys):
    """They have Kahan's map if they are quadratic, and solutions in any case."""
    lotka = "--equations x'=x*(a-y);dy/dt=y*(x-1/2);a=2 --x0 1,0.5"
    call(f"run {lotka} --eps 1/64 --steps 8 -o map.npz", capsys)
    field = sf.Field(lambda x: (x[0] * (2 - x[1]), x[1] * (x[0] - 0.5)), "x y")
    found = sf.iterate(field, [1.0, 0.5], 1 / 64, 8).final
    np.testing.assert_array_equal(sf.load("map.npz").final, found)
    line = "run --equations x'=v;v'=-sin(x) --x0 1,0 --x0 2,0 --time 5 --points 6 --rtol 1e-6"
    facts = json.loads(call(f"{line} -o run.npz", capsys))
    pendulum = sf.Field(lambda x: (x[1], -np.sin(x[0])), "x v")
    found = sf.flow(pendulum, [[1.0, 0.0], [2.0, 0.0]], time=np.arange(6.0), rtol=1e-6)
    np.testing.assert_array_equal(sf.load("run.npz").states, found.states)
    assert facts["trajectories"] == 2
    assert call("plot run.npz time v", capsys) == "run.png\n"
    assert call("plot run.npz x v -o run.pdf", capsys) == "run.pdf\n"
    assert Path("run.png").read_bytes().startswith(b"\x89PNG")
    assert Path("run.pdf").read_bytes().startswith(b"%PDF")
    assert not plt.get_fignums()


def test_the_figures_of_the_paper(capsys):
    names = call("figures -o figures", capsys).splitlines()
    assert names == [f"figures/figure{k}.png" for k in (1, 2, 3, 4)]
    assert all(Path(name).read_bytes().startswith(b"\x89PNG") for name in names)


@pytest.mark.filterwarnings("default")
def test_a_run_that_fails_altogether(capsys):
    assert main("run --equations x'=x*x --x0 1 --time 3".split()) == 1
    out, err = capsys.readouterr()
    assert json.loads(out)["failed"] == 1
    assert "t = 1" in err


def test_a_report(capsys):
    found = call("report --figure 1 --eps 0.2 --degree 2", capsys)
    square = "25*Omega1^2 + 30*Omega1*Omega2 + 9*Omega2^2"
    assert f": (4*Omega1^2 + Omega2^2)/({square} + 40000)" in found
    text = call("report --equations x'=y**2;y'=-x --eps 1/3 --degree 3", capsys)
    assert ": (y - 54)*(x + 6*y + 162)*(x - 6*y - 162)/(y + 18)" in text


# A command line, and what the one line on stderr names. The status is 2, and nothing is computed.
MISTAKES = json.loads((children.HERE / "data" / "mistakes.json").read_text("utf-8"))


@pytest.mark.parametrize(("line", "named"), MISTAKES.items())
def test_mistakes(line, named, monkeypatch, capsys):
    Path("folder.npz").mkdir()
    for name in ("good.npz", "figure1.png"):
        Path(name).write_text("precious")
    before = sorted(Path().rglob("*"))
    for name in ("maps.batch.BatchRun.to", "motions.solution.to_tolerance"):
        monkeypatch.setattr(f"suslov_fast.{name}", None)
    try:
        code = main(line.split())
    except SystemExit as stopped:  # of argparse
        code = stopped.code
    out, err = capsys.readouterr()
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert named in err
    assert sorted(Path().rglob("*")) == before
    assert Path("good.npz").read_text() == "precious"
