"""The command `suslov-fast`."""

import contextlib
import errno
import io
import json
import os
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from pathlib import Path
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast.command import summary
from suslov_fast.command.main import main, main as command, warm_up

posix = pytest.mark.skipif(os.name != "posix", reason="POSIX signals, links and devices")
COMMAND = [sys.executable, "-m", "suslov_fast"]


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def run(line):
    """Run the command in this process, where all modules and kernels are loaded."""
    output, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        try:
            code = main(line.split())
        except SystemExit as stopped:  # of argparse
            code = stopped.code
    return SimpleNamespace(code=code, out=output.getvalue(), err=errors.getvalue())


def succeed(line):
    """Run a command that must succeed without messages, and return its output."""
    done = run(line)
    assert (done.code, done.err) == (0, "")
    return done.out


def facts_of(line):
    return json.loads(succeed(f"{line} --json"))


def start(line, **pipes):
    return subprocess.Popen([*COMMAND, *line.split()], stderr=subprocess.PIPE, text=True, **pipes)


def test_help():
    """It needs no kernels, nor does the message of a usage error."""
    assert succeed("-V") == f"suslov-fast {sf.__version__}\n"
    text = succeed("--help")
    for name in ("run", "info", "plot", "report", "pictures", "explore", "warm-up"):
        assert f"    {name} " in text
        assert f"usage: suslov-fast {name} " in succeed(f"{name} --help")
    code = "import sys, suslov_fast.command.main as c, atexit as a"
    for words in (["run", "--help"], ["run", "--stpes", "3"]):
        calls = f"a.register(lambda: print(*sys.modules)); c.main({words})"
        command = [sys.executable, "-c", f"{code}; {calls}"]
        done = subprocess.run(command, capture_output=True, text=True)
        assert "--save-every" in done.stdout + done.stderr
        assert not {"numba", "numpy", "matplotlib"} & set(done.stdout.split())


BODY = sf.Suslov3D(4, 1, -0.5, -0.3)
UNIT = "run --I1 1 --I2 1 --I13 1 --I23 0 --eps 1 --steps 20"


def test_failures_are_counted():
    """The rate is that of the steps computed; it is an error that no trajectory is left."""
    line = f"{UNIT} --omega0 .3,.1 --omega0 1,-3 --omega0 .5,-40"
    text, facts = succeed(line), facts_of(line)
    for status in sf.Status.OK, sf.Status.SUPERCRITICAL, sf.Status.SINGULAR:
        assert f"1 {status.name}: {status.message}" in text
    assert facts["steps_per_second"] * facts["seconds"] == pytest.approx(20 + 1 + 20)
    assert 0 < facts["drift"]["first_integral"] < 1e-12
    done = run(f"{UNIT} --omega0 1,-3")
    assert (done.code, done.err) == (1, "suslov-fast: run: all trajectories failed\n")
    assert "1 SINGULAR" in done.out
    assert "drift" not in done.out


@pytest.mark.parametrize("suffix", ["npz", "zarr"])
def test_run_and_info(suffix):
    name = f"result.{suffix}"
    facts = facts_of(f"run --trajectories 1e2 --steps 2e1 --save-every 10 -o {name}")
    expected = {"trajectories": 100, "steps": 20, "written": name, "status": {"OK": 100}}
    assert {**facts, **expected} == facts
    found = [json.loads(line) for line in succeed(f"info {name} {name} --json").splitlines()]
    assert [{**facts, "file": name, **each} for each in found] == [{**facts, "file": name}] * 2
    mixed = run(f"info {name} missing.npz {name} text.txt")
    assert (mixed.code, mixed.out) == (1, succeed(f"info {name} {name}"))
    assert [line.split(":")[1] for line in mixed.err.splitlines()] == [" missing.npz", " text.txt"]


@pytest.mark.filterwarnings("default")
def test_a_warning_is_one_line():
    line = "run --I1 4 --I2 1 --I13 -.5 --I23 -.3 --I3 50 --eps .1 --omega0 1,2 --steps 2"
    done = run(line)
    assert done.code == 0
    assert done.err.startswith("suslov-fast: warning: no body has I3 = 50")
    assert done.err.count("\n") == 1


def lotka():
    f = lambda x: (x[0] * (1 - x[1]), x[1] * (x[0] - 1))  # noqa: E731
    return sf.QuadraticField.from_function(f, 2)


# What is passed to `iterate`, beside these.
DEFAULTS = {
    "body": sf.Suslov3D(4, 3, -0.4, -0.2), "omega0": sf.RandomStarts(65_536, 2.0), "eps": 0.2,
    "steps": 4, "save_every": None,
}  # fmt: skip
STARTS = [[0.3, 0.1], [1.0, -3.0], [0.5, -40.0]]
RUNS = {
    "": {},
    "--figure 4 --eps -1/4": {"body": sf.Suslov3D(3, 3, -0.2, -0.2), "eps": -0.25},
    "--I1 4 --I2 1 --I13 -.5 --I23 -3e-1 --eps -1e-3": {
        "body": sf.Suslov3D(4, 1, -0.5, -0.3), "eps": -1e-3,
    },
    "--I1 4 --I2 1 --I13 -.5 --I23 0 --I3 4 --k -.5 --eps 1": {
        "body": sf.SuslovGyrostat(4, 1, -0.5, 0, -0.5, 4), "eps": 1.0,
    },
    "--J 5,6,7 --I -0.4,-0.7,5e-1 --eps 1 --method gauss": {
        "body": sf.SuslovND([5, 6, 7], [-0.4, -0.7, 0.5]), "eps": 1.0, "method": "gauss",
    },
    "--body b.json --eps 1 --trajectories 300": {
        "body": lotka(), "eps": 1.0, "omega0": sf.RandomStarts(300, 2.0),
    },
    "--omega0 -1,.5 --omega0 2,-3": {"omega0": [[-1.0, 0.5], [2.0, -3.0]]},
    "--trajectories 3 --extent 0.5 --seed 4": {"omega0": sf.RandomStarts(3, 0.5, 4)},
    "--initial s.npy --figure 1 --threads 1 --save-every 2 --attitude": {
        "body": sf.Suslov3D(4, 1, -0.5, -0.3), "omega0": STARTS, "save_every": 2, "attitude": True,
    },
}  # fmt: skip


@pytest.mark.compiled  # 65,536 trajectories are the default
@pytest.mark.sampled(3)
@pytest.mark.parametrize("options", RUNS)
def test_run_is_iterate(options):
    Path("b.json").write_text(json.dumps(lotka().to_dict()))
    np.save("s.npy", STARTS)
    given = DEFAULTS | RUNS[options]
    body, omega0 = given.pop("body"), given.pop("omega0")
    expected = sf.iterate(body, omega0, **given, on_singular="ignore")
    facts = facts_of(f"run {options} --steps 4 -o o.npz")
    assert sf.Trajectories.load("o.npz") == expected
    assert (facts["body"], facts["eps"]) == (expected.body.to_dict(), expected.eps)
    assert "status" in succeed("info o.npz")
    succeed(f"run {options} --steps 4 -o o.zarr")
    stored = sf.open_ensemble("o.zarr")
    for name in (expected.map.variable, "final"):
        np.testing.assert_array_equal(stored[name], getattr(expected, name))


@pytest.mark.parametrize("suffix", ["npz", "zarr"])
def test_summaries_show_formulas_and_all_digits(suffix):
    """A field is its equations; a method is shown where there are others."""

    def f(x, a):
        return x[1], -a * x[0] - x[0] ** 2

    Path("b.json").write_text(json.dumps(sf.QuadraticField.from_function(f, 2, a=0.125).to_dict()))
    line = f"run --body b.json --eps 1/128 --trajectories 9 --steps 3 -o r.{suffix} --extent 0.1"
    for text in (succeed(line), succeed(f"info r.{suffix}")):
        assert "QuadraticField(x1' = x2, x2' = -x1^2 - 1/8*x1)" in text
        assert "a = 0.125" in text or "a                0.125\n" in text
        assert "eps              0.0078125\n" in text
        assert "quadratic" not in text.replace("of a quadratic field", "")
        assert "method           auto\n" in text
    line = f"run --J 5,6,7 --I -.4,-.7,.123456789 --eps 1 --trajectories 9 --steps 3 -o n.{suffix}"
    assert "method           auto\n" in succeed(line)
    assert "0.123456789" in succeed(f"info n.{suffix}")


def lorenz(rho):
    f = lambda x, rho: (10 * (x[1] - x[0]), x[0] * (rho - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2])  # noqa: E731
    return sf.QuadraticField.from_function(f, "u v w", rho=rho)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("members", [1, 38, 400])
def test_summaries_of_families(members):
    """Of large tables a store has no numbers; values of a parameter take one line."""
    family = lorenz(np.linspace(20, 30, members))
    sf.ensemble(family, np.ones(3), 1 / 128, 3, store="f.zarr")
    sf.iterate(family, np.ones(3), 1 / 128, 3).save("f.npz")
    Path("b.json").write_text(json.dumps(family.to_dict()))
    line = "run --body b.json --eps 1/128 --omega0 1,1,1 --steps 3 -o c.zarr"
    for text in (succeed("info f.zarr"), succeed("info f.npz"), succeed(line)):
        assert f"trajectories     {members}\n" in text
        assert "QuadraticField" in text
        assert max(map(len, text.splitlines())) < 120
        assert members == 1 or f"{members} values from 20 to 30" in text
        assert "linear" not in text


@pytest.mark.slow
def test_info_and_plot_of_crossings():
    points = sf.crossings(
        lorenz(28), [[1, 1, 20], [2, 1, 20]], 1 / 64, 3000, lambda x: x[..., 2] - 27
    )
    points.save("p.npz")
    facts = facts_of("info p.npz")
    expected = {"crossings": len(points), "trajectories": 2, "direction": 1, "transient": 0}
    assert {**facts, **expected, "status": {"OK": 2}, "steps": 3000} == facts
    assert "most" not in facts
    assert f"crossings        {len(points)}\n" in succeed("info p.npz")
    sf.iterate(BODY, [1.0, 0.5], 0.2, 30).save("r.npz")
    for name, suffix, start in (
        ("p", "png", b"\x89PNG"),
        ("r", "png", b"\x89PNG"),
        ("r", "pdf", b"%PDF"),
        ("p", "svg --components u,v", b"<?xml"),
        ("r", "svg --components time,1", b"<?xml"),
    ):
        suffix, _, options = suffix.partition(" ")
        assert succeed(f"plot {name}.npz -o {name}.{suffix} {options}") == f"{name}.{suffix}\n"
        assert Path(f"{name}.{suffix}").read_bytes().startswith(start)
    succeed("plot p.npz -o r.png --force")
    assert Path("r.png").read_bytes() == Path("p.png").read_bytes()
    assert not plt.get_fignums()


def test_a_family_and_a_box_of_starts(tmp_path, monkeypatch):
    """From standard input, in the encodings that editors and PowerShell write."""
    field = sf.QuadraticField.from_function(
        lambda x, a: (x[0] * (a - x[1]), x[1] * (x[0] - 1)), "prey predator", a=[1.0, 2.0, 3.0]
    )
    text = json.dumps(field.to_dict())
    options = "--eps 1/64 --steps 9 --low 0.5,1 --high 2 --trajectories 5 --method order4"
    starts = sf.RandomStarts(5, low=(0.5, 1.0), high=2.0)
    for encoding in ("utf-8", "utf-8-sig", "utf-16"):
        (tmp_path / "family.json").write_bytes(text.encode(encoding))
        output = tmp_path / f"{encoding}.npz"
        with open(tmp_path / "family.json", "rb") as file:
            wrapped = io.TextIOWrapper(file)
            monkeypatch.setattr(sys, "stdin", wrapped)
            assert main(["run", "--body", "-", *options.split(), "-o", str(output)]) == 0
        family = sf.Trajectories.load(output)
        assert family.status.shape == (3, 5)
        for k, a in enumerate([1.0, 2.0, 3.0]):
            one = sf.iterate(field.sel(a=a), starts, 1 / 64, 9, save_every=None, method="order4")
            np.testing.assert_array_equal(family.final[k], one.final)


def test_states_from_standard_input(monkeypatch):
    np.save("s.npy", [[1.0, 0.5], [0.2, -0.7]])
    for name in ("s.npy", os.devnull):
        with open(name, "rb") as file:
            monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(file))
            done = run("run --initial - --steps 9 -o piped.npz --force")
    assert (done.code, done.err.count("\n")) == (1, 1)
    assert done.err.startswith("suslov-fast: standard input: not a complete file of numpy.save")
    succeed("run --initial s.npy --steps 9 -o read.npz")
    assert sf.Trajectories.load("piped.npz") == sf.Trajectories.load("read.npz")


def test_a_log_shows_signs_of_life(monkeypatch):
    seen = threading.Event()
    monkeypatch.setattr(command, "_BEAT", 0.01)
    monkeypatch.setattr(command, "_tell", lambda text: seen.set())
    monkeypatch.setattr(os, "isatty", lambda _: False)
    monkeypatch.setattr(warm_up, "call_all", lambda: seen.wait(60))
    assert main(["warm-up"]) == 0
    assert seen.is_set()


def test_a_store_is_finished_or_refused():
    line = "run --trajectories 100 --steps 40 --save-every 4 -o run.zarr"
    succeed(line)
    Path("run.zarr/status/c/0").unlink()
    assert "100 PENDING: not computed yet" in succeed("info run.zarr")
    assert facts_of(line)["status"] == {"OK": 100}
    again = facts_of(line)
    assert again["complete_already"] == "run.zarr"
    assert not {"seconds", "written"} & again.keys()
    refused = run(f"{line} --eps 0.3")
    assert (refused.code, refused.err.count("\n")) == (1, 1)
    assert "eps: 0.3, the store has 0.2" in refused.err


def test_force_replaces_a_run(monkeypatch):
    for name in ("run.npz", "run.zarr"):
        for eps in (0.2, 0.3):
            line = f"run --omega0 1,2 --steps 3 --eps {eps} -o {name} --force"
            assert facts_of(line)["eps"] == eps == facts_of(f"info {name}")["eps"]

    def refuse(path):
        raise PermissionError(errno.EACCES, "Permission denied", "0")  # an entry in the store

    monkeypatch.setattr("shutil.rmtree", refuse)
    refused = run(line)
    assert refused.err == "suslov-fast: run.zarr: not replaced: Permission denied\n"


def test_long_names_in_a_summary_end_with_a_blank():
    facts = summary.facts_of(sf.iterate(BODY, [1.0, 0.5], 0.2, 3), None)
    text = summary.lines_of(facts | {"failed_after_a_pole": 42}, False)
    assert "failed after a pole 42" in text


# Exit status, command line, and parts of the message on stderr.
MISTAKES = """
2 | | a command is required, such as run: run, info, plot
2 | rum | invalid choice: 'rum' .* did you mean run?
2 | run --stpes 3 | unrecognized arguments: --stpes 3; did you mean --steps?
2 | run --dt 3 | --dt 3; did you mean --eps?
2 | run --x0 1,2 | --x0 1,2; did you mean --omega0?
2 | run --overwrite | --overwrite; did you mean --force?
2 | run --i1 3 | --i1 3; did you mean --I1?
2 | run --steps 1.5 | --steps: '1.5' is not an integer
2 | run --omega0 1,x | --omega0: '1,x' is not a list of numbers
2 | run --I1 4.5 | required: --I2, --I13, --I23, --eps
2 | run --J 1,2 --I 1,2 --k 3 --eps 1 | --k
2 | run --I1 4 --figure 1 | --I1: not allowed with --figure
2 | run --omega0 1,2 --seed 0 | --seed are for random
2 | run --save-every 3 | --save-every .* add -o FILE
2 | run -o o.csv | 'o.csv' must end in .npz or .zarr
2 | report --body good.json --eps 1/0 | --eps: '1/0' is not a number, such as 0.1 or 1/3
2 | report --body good.json --eps 1e99999999 | --eps: '1e99999999' is not a number
2 | run --steps 1e-99999999 | --steps: '1e-99999999' is not an integer
1 | run --omega0 1,2,3 | --omega0 must be 2 numbers, such as 1,1, not 1,2,3
1 | run --J 1,-2 --I 1,1 --eps 1 | J must be positive, not -2
1 | run --trajectories 0 | --trajectories must .* 0
1 | run --trajectories 1e12 --steps 9 | memory
1 | run --trajectories 1e12 -o o.zarr | o.zarr: .* B are free .* : choose another disk
1 | run --threads 0 | --threads must be an integer from 1 to .* (NUMBA_NUM_THREADS), not 0
1 | run --threads 100000 | --threads must .* not 100000
1 | run --steps -1 | --steps must be the number of steps, an integer of 0 or more, not -1
1 | report --body good.json --degree 0 | --degree must be an integer, 1 or more, not 0
1 | run --body missing.json | missing.json: there is no such file in .* write it by json.dump
2 | run --body good.json | required: --eps; --eps is the step size, such as --eps 0.01
2 | run -n 9 | -n 9; did you mean --steps, or --trajectories?
2 | run --body - --initial - --eps 1 | only one can be standard input
2 | run --workers 2 | --workers 2; did you mean --threads?
2 | run good.json | good.json; did you mean --body?
2 | run --rho 28 | if rho is a parameter of the field, it is part of the file of --body
2 | run --set rho=28 | parameters are part of the file of --body
2 | run --timeout 3 | --timeout 3; a run into FILE.zarr may be interrupted
2 | report --body good.json --timeout 3 | --timeout 3; did you mean --time-limit?
2 | plot good.npz -o o.png -c x,y | -c x,y; did you mean --components?
2 | plot good.npz -o o.png x,y | x,y; did you mean --components?
2 | explore --port 65536 | argument --port: 65536 is not from 0 to 65535
2 | flow | invalid choice: 'flow' .* call suslov_fast.flow in Python
2 | simulate | invalid choice: 'simulate' .* did you mean run?
2 | run --rtol 1e-6 | call suslov_fast.flow in Python
2 | run --t-end 10 | did you mean --steps? a run ends at the time eps * steps
2 | run --integrator rk4 | did you mean --method?
2 | run --section x=1 | call suslov_fast.crossings in Python
2 | run --plot | and then suslov-fast plot run.npz -o run.png
2 | good.json | write suslov-fast run --body good.json --eps 0.01
2 | run.npz | write suslov-fast info run.npz
2 | plot run.npz | it is the figure, such as -o run.png
1 | run --body nowhere/good.json --eps 1 | nowhere/good.json: there is no folder
1 | run --body godo.json --eps 1 | godo.json: there is no such file in .* did you mean good.json?
1 | run --method order9 | --method must be 'auto', not 'order9' .* this body has the methods
1 | run --body missing.json --eps 1 | missing.json: there is no such file in .* write it by json
1 | info wrong.json | wrong.json: not the name of a saved run, such as run.npz
1 | run --body cut.json --eps 1 | cut.json: not the JSON text .* line 1 column 10
1 | run --body good.npz --eps 1 | good.npz: not the JSON text of body.to_dict
1 | run --body wrong.json --eps 1 | wrong.json: .* I1 .* -4
1 | run --initial cut.npy | cut.npy:
1 | run --initial part.npy | part.npy: not a complete file of numpy.save: .* (count, 2)
1 | run --initial nan.npy | nan.npy must be finite .* nan .* (2, 1)
1 | run -o good.npz | good.npz exists: choose a new name, or add --force
1 | run -o missing/o.npz | missing/o.npz: nothing can be written there
1 | run -o folder.zarr --force | folder.zarr
1 | info foreign.npz | foreign.npz is not a complete file .* it has no entry 'kind'
2 | --json run | --json comes after the command: suslov-fast run --json
2 | run --steps abc | argument --steps: 'abc' is not an integer, such as 1000 or 1e6
2 | run --low 1 | arguments --low and --high belong together
2 | run --low 1 --high 2 --extent 3 | belong together, without --extent
2 | run --omega0 1,2 --low 1 --high 2 | are for random states
2 | run --omega0 1 2 | write lists with commas, such as --omega0 1,0.5
1 | run --low 1 --high 0 | --low must be below --high, not 1 with --high 0: exchange them
1 | run --low 1,2,3 --high 4 | --low and high must be numbers, or one for each component
2 | run --figure one | --figure: 'one' is not an integer
2 | plot good.npz | required: -o/--output
1 | plot run.npz --components Omega1,p -o o.png | must be .* Omega2, time, such as time,Omega1, not
1 | plot missing.npz -o o.png | missing.npz: there is no such file in
1 | plot foreign.npz -o o.png | foreign.npz
1 | plot run.npz -o picture1.png | picture1.png exists: choose a new name, or add --force
2 | plot run.npz -o o.docx | 'o.docx' must end in .png, .svg or .pdf
1 | plot folder.zarr -o o.png | folder.zarr is a store, and plot takes a file of run -o FILE.npz; or
1 | info folder.zarr | folder.zarr
1 | pictures | picture1.png exists: choose a new name, or add --force
"""


@pytest.fixture(scope="module")
def bad_files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bad")
    (folder / "folder.zarr").mkdir()
    (folder / "folder.zarr" / "thesis.tex").touch()
    np.save(folder / "good.npy", np.ones((4, 2)))
    np.save(folder / "nan.npy", [[1, 2], [3, 4], [5, np.nan]])
    np.savez(folder / "foreign.npz", x=np.ones(3))
    (folder / "cut.npy").write_bytes((folder / "good.npy").read_bytes()[:100])
    (folder / "part.npy").write_bytes((folder / "good.npy").read_bytes()[:-8])
    sf.iterate(BODY, [1.0, 0.5], 0.2, 3).save(folder / "run.npz")
    body = {"body": "Suslov3D", "I1": 4, "I2": 1, "I13": 0, "I23": 1}
    texts = {"good.json": json.dumps(body), "wrong.json": json.dumps(body | {"I1": -4})}
    texts |= {"cut.json": '{"body": ', "good.npz": "precious", "picture1.png": "precious"}
    for name, text in texts.items():
        (folder / name).write_text(text)
    return folder


@posix
@pytest.mark.parametrize("mistake", MISTAKES.strip("\n").splitlines())
def test_mistakes(bad_files, monkeypatch, mistake):
    """An error has the right exit status, names what is wrong, and writes no file."""
    status, line, message = (each.strip() for each in mistake.split("|"))
    monkeypatch.chdir(bad_files)
    before = set(os.listdir())
    done = run(line)
    assert (done.code, done.out) == (int(status), "")
    last = done.err.splitlines()[-1]
    assert last.startswith("suslov-fast")
    assert all(part in last for part in message.split(" .* ")), last
    assert int(status) == 2 or done.err.count("\n") == 1
    foreign = ("Traceback", "sys.exit", "pickle=", "Errno", "mmap")
    assert not any(word in done.err for word in foreign)
    assert set(os.listdir()) == before
    assert Path("good.npz").read_text() == "precious"


def test_a_method_that_no_map_has():
    done = run("run --method order9")
    assert done.err.endswith("the methods 'order4', 'order6', 'order8'\n")


def test_a_method_of_fields_for_a_body():
    """The message has the line that makes the field of the body, and the one that runs it.

    Shells of Windows know neither && nor files of > that are UTF-8.
    """
    body = json.dumps(sf.Suslov3D(4, 1, -0.5, -0.3).to_dict())
    Path("body.json").write_text(body, "utf-16")
    for given in ("--body body.json", "--I1 4 --I2 1 --I13 -0.5 --I23 -0.3"):
        done = run(f"run {given} --eps 1/4 --method order6")
        code, then = done.err.partition(": python -c ")[2].split(", and then suslov-fast ")
        assert not {*"&>"} & {*code}
        exec(code.strip('"'))
        facts = facts_of(f"{then} --trajectories 3 --steps 3")
        assert (facts["method"], facts["eps"], facts["body"]["body"]) == (
            "order6", 0.25, "QuadraticField",
        )  # fmt: skip


@pytest.mark.compiled
@posix
@pytest.mark.slow
def test_ctrl_c():
    """A run of hours ends at once; a store keeps its tiles, and the same command goes on."""
    # Numba may lose a signal while it compiles: what follows finds the kernels compiled.
    assert run("run --trajectories 1000 --steps 2").code == 0
    line = "run --trajectories 1000 --steps 1e10 -o"
    for name, words in (("o.npz", "o.npz was not written"), ("o.zarr", "goes on")):
        with start(f"{line} {name}") as process:
            while not (name == "o.npz" or Path("o.zarr/zarr.json").exists()):
                assert process.poll() is None
                time.sleep(0.05)
            time.sleep(3.0 if name == "o.npz" else 1.0)
            process.send_signal(signal.SIGINT)
            try:
                errors = process.communicate(timeout=10)[1]
            finally:
                process.kill()  # one that does not end
        assert process.returncode == 130
        # Zarr 3.1.3 tells first that it uses the old crc32c.
        assert "suslov-fast: interrupted: " in errors
        assert words in errors
    assert os.listdir() == ["o.zarr"]


@posix
@pytest.mark.slow
def test_streams():
    reading, writing = os.pipe()
    os.close(reading)  # nobody reads
    with start("run --trajectories 5 --steps 5", stdout=writing) as process:
        assert (process.communicate(timeout=60)[1], process.returncode) == ("", 141)
    os.close(writing)
    line = f"'{COMMAND[0]}' -m suslov_fast run --trajectories 5 --steps 5 > /dev/full"
    for unbuffered in ("", "1"):
        done = subprocess.run(
            ["sh", "-c", line], capture_output=True, text=True, timeout=60,
            env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (1, "suslov-fast: No space left on device\n")


def test_warm_up_says_where_code_is_kept(monkeypatch):
    for folders, words in (
        ([("/a/b/c", True), ("/a/b", True)], "compiled code is kept in /a/b"),
        ([("/a/b/c", False), ("/a/d", True)], "compiled code is kept in /a, which cannot be"),
        ([(None, False), ("/a/b", True)], "nothing is kept: no folder can be written"),
    ):
        given = iter(folders)
        monkeypatch.setattr(warm_up, "folder_of", lambda compiled, given=given: next(given))
        assert warm_up.where_code_is_kept().startswith(words)


def test_report():
    Path("b.json").write_text(json.dumps(lotka().to_dict()))
    line = "report --body b.json --eps 1/3 --degree 1"
    assert "degree" in succeed(line)
    assert facts_of(line)
    lemma = "25*(4*x1^2 + x2^2)/(25*x1^2 + 30*x1*x2 + 9*x2^2 + 40000)"
    for system in ("--figure 1", "--I1 4 --I2 1 --I13 -0.5 --I23 -0.3"):
        found = facts_of(f"report {system} --eps 0.2 --degree 2 --json")
        assert [each["formula"] for each in found["integrals"]] == [lemma]


def test_a_report_that_is_interrupted(monkeypatch):
    """Ctrl-C prints what was found so far."""
    Path("b.json").write_text(json.dumps(lotka().to_dict()))

    def stopped(*_, **__):
        error = KeyboardInterrupt()
        error.report = SimpleNamespace(to_dict=lambda: {"degrees": [2, 4]})
        raise error

    monkeypatch.setattr("suslov_fast.integrability.report", stopped)
    done = run("report --body b.json --json")
    assert (done.code, json.loads(done.out)) == (130, {"degrees": [2, 4]})
    assert done.err == "suslov-fast: interrupted\n"


@posix
def test_explore():
    with start("explore --no-browser", stdout=subprocess.PIPE) as process:
        address = process.stdout.readline().strip()
        with urllib.request.urlopen(address) as page:
            assert b"<html" in page.read()
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=10)[1] == ""
    assert process.returncode == 0
