"""The command `suslov-fast`."""

import contextlib
import errno
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import parse_qs, urlsplit

import matplotlib.pyplot as plt
import numpy as np
import pytest
from systems import lorenz

import suslov_fast as sf
from suslov_fast.command.main import main

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
            code = main([word for word in line.split(" ") if word])
        except SystemExit as stopped:  # of argparse
            code = stopped.code
    return SimpleNamespace(code=code, out=output.getvalue(), err=errors.getvalue())


def succeed(line):
    """Run a command that must succeed without messages, and return its output."""
    done = run(line)
    assert (done.code, done.err) == (0, "")
    return done.out


def facts_of(line):
    return json.loads(succeed(line))


def start(line, **pipes):
    return subprocess.Popen([*COMMAND, *line.split()], stderr=subprocess.PIPE, text=True, **pipes)


def test_help():
    """It needs no kernels, nor does the message of a usage error."""
    assert succeed("-V") == f"suslov-fast {sf.__version__}\n"
    text = succeed("--help")
    assert succeed("") == text
    for name in ("run", "info", "plot", "report", "figures", "explore", "warm-up"):
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
    facts = facts_of(line)
    assert facts["status"] == {"OK": 1, "SUPERCRITICAL": 1, "SINGULAR": 1}
    assert facts["steps_per_second"] * facts["seconds"] == pytest.approx(20 + 1 + 20)
    assert 0 < facts["drift"]["first_integral"] < 1e-12
    done = run(f"{UNIT} --omega0 1,-3")
    assert (done.code, done.err) == (1, "suslov-fast: run: all trajectories failed\n")
    assert '"status": {"SINGULAR": 1}' in done.out
    assert json.loads(done.out)["drift"] == {}


@pytest.mark.parametrize("suffix", ["npz", "zarr"])
def test_run_and_info(suffix):
    name = f"result.{suffix}"
    facts = facts_of(f"run --trajectories 1e2 --steps 2e1 --save-every 10 -o {name}")
    expected = {"trajectories": 100, "steps": 20, "written": name, "status": {"OK": 100}}
    assert {**facts, **expected} == facts
    found = [json.loads(line) for line in succeed(f"info {name} {name}").splitlines()]
    assert [{**facts, "file": name, **each} for each in found] == [{**facts, "file": name}] * 2
    mixed = run(f"info {name} missing.npz {name} text.txt")
    assert (mixed.code, mixed.out) == (1, succeed(f"info {name} {name}"))
    assert [line.split(":")[1] for line in mixed.err.splitlines()] == [" missing.npz", " text.txt"]


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
    assert sf.load("o.npz") == expected
    assert (facts["body"], facts["eps"]) == (expected.body.to_dict(), expected.eps)
    assert "status" in succeed("info o.npz")
    succeed(f"run {options} --steps 4 -o o.zarr")
    stored = sf.open_ensemble("o.zarr")
    for name in (expected.body.variable, "final"):
        np.testing.assert_array_equal(stored[name], getattr(expected, name))


def pendulum():
    return sf.Field.from_function(lambda x, a: (x[1], -a * np.sin(x[0])), "q p", a=[1.0, 2.0])


def test_a_motion_is_flow():
    Path("b.json").write_text(json.dumps(pendulum().to_dict()))
    line = "run --body b.json --time 5 --points 11 --rtol 1e-6 --atol 1e-8 --trajectories 3"
    facts = facts_of(f"{line} -o m.npz")
    family = sf.Field.from_dict(pendulum().to_dict() | {"parameters": {"a": [[1.0], [2.0]]}})
    states = sf.RandomStarts(3, 2.0).states(3, dimension=2)
    expected = sf.flow(family, states, time=np.linspace(0, 5, 11), rtol=1e-6, atol=1e-8)
    assert sf.load("m.npz") == expected
    assert facts["steps"] == expected.steps.sum() > 0
    assert (facts["trajectories"], facts["time"], facts["saved_states"]) == (6, 5, 11)
    assert facts["status"] == {"OK": 6}
    found = facts_of("info m.npz")
    assert {**facts, **found} == facts | {"file": "m.npz"}
    points = sf.crossings(pendulum(), [1.0, 0.5], surface=lambda x: x[..., 0], time=9.0)
    points.save("c.npz")
    assert sf.load("c.npz") == points
    assert facts_of("info c.npz")["crossings"] == len(points)
    for words, start in (
        ("plot m.npz time q -o m.png", b"\x89PNG"),
        ("plot c.npz -o c.pdf", b"%PDF"),
        ("plot m.npz -o c.pdf --force", b"%PDF"),
    ):
        path = words.partition("-o ")[2].split()[0]
        assert succeed(words) == f"{path}\n"
        assert Path(path).read_bytes().startswith(start)
    assert not plt.get_fignums()
    assert facts_of(f"{line} -o m.zarr")["status"] == {"OK": 6}
    np.testing.assert_array_equal(sf.open_ensemble("m.zarr").x, expected.x)
    assert facts_of("info m.zarr")["status"] == {"OK": 6}


def test_equations_of_the_command_line():
    """They are a quadratic field where they are one, with exact numbers, and a field elsewhere."""
    line = "run --equations x'=x*(a-y);y'=y*(x-1/2);a=2 --omega0 1,0.5 --eps 1/64 --steps 8"
    expected = sf.QuadraticField.from_function(
        lambda x: (x[0] * (2 - x[1]), x[1] * (x[0] - 0.5)), "x y"
    )
    assert facts_of(line)["body"] == expected.to_dict()
    facts = facts_of("run --equations dv/dt=-sin(u)*(u>=-9);u'=v --omega0 0,0.5 --time 3")
    assert (facts["body"]["names"], facts["status"]) == (["v", "u"], {"OK": 1})
    on_lines = facts_of("run --equations v'=-sin(u)*(u>=-9)\nu'=v --omega0 0,0.5 --time 3")
    assert on_lines["body"] == facts["body"]
    cubic = "report --equations x'=y**2;y'=-x --eps 1/3 --degree 3"
    assert json.loads(succeed(f"{cubic} --json"))["integrals"]


def test_a_long_run_says_so_before(monkeypatch):
    monkeypatch.setattr("suslov_fast.command.main.LONG", 0.0)
    for line in ("run --trajectories 9 --steps 9", "run --trajectories 99 --time 2"):
        assert re.search(r"this takes about \d+ seconds; Ctrl-C ends it", run(line).err)


def test_a_family_and_a_box_of_starts(tmp_path):
    """From files in the encodings that editors and PowerShell write."""
    field = sf.QuadraticField.from_function(
        lambda x, a: (x[0] * (a - x[1]), x[1] * (x[0] - 1)), "prey predator", a=[1.0, 2.0, 3.0]
    )
    text = json.dumps(field.to_dict())
    options = "--eps 1/64 --steps 9 --low 0.5,1 --high 2 --trajectories 5 --method order4"
    starts = sf.RandomStarts(5, low=(0.5, 1.0), high=2.0)
    for encoding in ("utf-8", "utf-8-sig", "utf-16"):
        (tmp_path / "family.json").write_bytes(text.encode(encoding))
        succeed(f"run --body family.json {options} -o {encoding}.npz")
        family = sf.load(f"{encoding}.npz")
        assert family.status.shape == (3, 5)
        for k, a in enumerate([1.0, 2.0, 3.0]):
            one = sf.iterate(field.sel(a=a), starts, 1 / 64, 9, save_every=None, method="order4")
            np.testing.assert_array_equal(family.final[k], one.final)


def test_a_store_is_finished_or_refused():
    line = "run --trajectories 100 --steps 40 --save-every 4 -o run.zarr"
    succeed(line)
    Path("run.zarr/status/c/0").unlink()
    assert facts_of("info run.zarr")["status"] == {"PENDING": 100}
    assert facts_of(line)["status"] == {"OK": 100}
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


# Exit status, command line, and what the message on stderr names.
MISTAKES = """
2 | simulate | run
2 | Run | did you mean run?
2 | -v | -v
1 | run --steps 1e400 | --steps
2 | run --body= --eps 1 | --body
2 | run --stpes 3 | --steps
2 | run --x0 1,2 | --omega0
2 | run --rho 28 --dt 1 | --eps
2 | run --n 3 | --trajectories
2 | lyapunov | lyapunov_exponents
1 | run --equations x''=-x --time 1 | of order 1
1 | run --equations x'=y,y'=-x --time 1 | a ; between
2 | run --time 2 --dt 0.1 | --points
2 | run --system lorenz --time 1 | --equations "x' =
2 | report --hamiltonian q**2+p**2 | --equations
2 | run --omega0 1 2 | --omega0 1,0.5
2 | report x*(1-y) | --equations "x' =
2 | figures --format pdf | plot RUN.npz -o RUN.pdf
2 | run --equations x'=1 | --eps
2 | run --equations x'=1 --I1 1 | --I1
1 | run --equations x'=2x --time 1 | 2*x
1 | run --equations x'=z --time 1 | 'z'
1 | run --equations x=y --time 1 | x' = y
1 | run --equations= --time 1 | x' =
1 | run --equations x'=x;x'=1 --time 1 | x has two
2 | run --eps 1e400 | --eps
1 | report --equations x*(1-y) | x' =
2 | report --equations x'=x**3 | degree 2
2 | run good.json | good.json
2 | --steps run | --steps comes after the command
2 | figures -o a.png | a folder
2 | run -o a.csv | to_dataframe
2 | run --steps 1.5 | --steps
2 | run --steps 1e-99999999 | --steps
2 | run --omega0 1,x | --omega0
2 | run --I1 4.5 | --I2, --I13, --I23, --eps
2 | run --J 1,2 --I 1,2 --k 3 --eps 1 | --k
2 | run --I1 4 --figure 1 | --I1
2 | run --omega0 1,2 --seed 0 | --seed
2 | run --low 1 | --high
2 | run --save-every 3 | --save-every
2 | run --body field.json --eps 1 | --time
2 | run --time 3 --eps 1 | --eps
2 | report --body good.json --eps 1/0 | --eps
2 | explore --port 65536 | --port
2 | plot run.npz -o o.docx | o.docx
1 | run --omega0 1,2,3 | --omega0
1 | run --trajectories 1e12 --steps 9 | memory
1 | run --low 1 --high 0 | --low
1 | run --body missing.json --eps 1 | missing.json
1 | run --body cut.json --eps 1 | cut.json
1 | run --initial cut.npy | cut.npy
1 | run -o good.npz | good.npz exists
1 | run -o missing/o.npz | missing/o.npz
1 | run -o folder.npz --force | folder.npz
1 | plot run.npz -o missing/o.png | make the folder
1 | info foreign.npz | foreign.npz
1 | info folder.zarr | folder.zarr
1 | plot run.npz -o figure1.png | figure1.png exists
1 | plot run.npz Omega1 p -o o.png | Omega2
1 | figures | figure1.png exists
"""


@pytest.fixture(scope="module")
def bad_files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bad")
    (folder / "folder.zarr").mkdir()
    (folder / "folder.npz").mkdir()
    (folder / "folder.zarr" / "thesis.tex").touch()
    np.save(folder / "good.npy", np.ones((4, 2)))
    np.savez(folder / "foreign.npz", x=np.ones(3))
    (folder / "cut.npy").write_bytes((folder / "good.npy").read_bytes()[:100])
    sf.iterate(BODY, [1.0, 0.5], 0.2, 3).save(folder / "run.npz")
    body = {"body": "Suslov3D", "I1": 4, "I2": 1, "I13": 0, "I23": 1}
    texts = {"good.json": json.dumps(body), "cut.json": '{"body": '}
    texts |= {"good.npz": "precious", "figure1.png": "precious"}
    texts["field.json"] = json.dumps(pendulum().to_dict())
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
    assert message in last, last
    assert int(status) == 2 or done.err.count("\n") == 1
    foreign = ("Traceback", "sys.exit", "pickle=", "Errno", "mmap")
    assert not any(word in done.err for word in foreign)
    assert set(os.listdir()) == before
    assert Path("good.npz").read_text() == "precious"


@pytest.mark.compiled
@posix
@pytest.mark.slow
def test_ctrl_c():
    """A run of hours ends at once; a store keeps its tiles, and the same command goes on."""
    # Numba may lose a signal while it compiles: what follows finds the kernels compiled.
    assert run("run --trajectories 1000 --steps 1e4").code == 0
    line = "run --trajectories 1000 --steps 1e10 -o"
    for name, words in (("o.npz", "o.npz was not written"), ("o.zarr", "goes on")):
        for seconds in (2.0, 8.0, 32.0):  # until it computes
            with start(f"{line} {name}") as process:
                while not (name == "o.npz" or Path("o.zarr/zarr.json").exists()):
                    assert process.poll() is None
                    time.sleep(0.05)
                time.sleep(seconds)
                process.send_signal(signal.SIGINT)
                errors = ""
                with contextlib.suppress(subprocess.TimeoutExpired):  # lost while it compiles
                    errors = process.communicate(timeout=60)[1]
                process.kill()
            if words in errors:
                break
        assert process.returncode == 130
        # Zarr 3.1.3 tells first that it uses the old crc32c.
        assert "suslov-fast: interrupted: " in errors
        assert words in errors
    assert os.listdir() == ["o.zarr"]


def test_report():
    Path("b.json").write_text(json.dumps(lotka().to_dict()))
    assert "degree" in succeed("report --body b.json --eps 1/3 --degree 1")
    square = "25*Omega1^2 + 30*Omega1*Omega2 + 9*Omega2^2"
    lemma = f"25*(4*Omega1^2 + Omega2^2)/({square} + 40000)"
    found = facts_of("report --figure 1 --eps 0.2 --degree 2 --json")
    assert [each["formula"] for each in found["integrals"]] == [lemma]


def family():
    return sf.QuadraticField.from_function(lorenz, "x y z", rho=[10.0, 28.0])


@posix
@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("body", "file", "query"),
    [
        (family(), "field.js", {"member": ["0"]}),
        (pendulum(), "field.js", {"time": ["20.0"]}),
        (sf.Suslov3D(5, 2, -0.5, -0.3), "main.js", {"I1": ["5.0"]}),
    ],
)
def test_explore(body, file, query):
    """It serves the page of a body until Ctrl-C."""
    Path("b.json").write_text(json.dumps(body.to_dict()))
    with start("explore --no-browser --body b.json", stdout=subprocess.PIPE) as process:
        address = process.stdout.readline().strip()
        with urllib.request.urlopen(address) as page:
            assert file in page.read().decode()
        assert query.items() <= parse_qs(urlsplit(address).query).items()
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=10)[1] == ""
    assert process.returncode == 0
