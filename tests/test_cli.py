"""The command line."""

import contextlib
import inspect
import io
import json
import os
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from test_trajectories import assert_same_run

import suslov_fast as sf
from suslov_fast._cli import main
from suslov_fast._cli.flags import COMMANDS, body_classes

posix = pytest.mark.skipif(os.name != "posix", reason="POSIX signals, links and terminals")
COMMAND = [sys.executable, "-m", "suslov_fast"]
load = sf.Trajectories.load


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def run(line):
    """Run the command in this process, where all modules and kernels are loaded."""
    output, errors = io.StringIO(), io.StringIO()
    redirected = contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors)
    with redirected[0], redirected[1], pytest.raises(SystemExit) as stopped:
        main(line.split())
    return SimpleNamespace(code=stopped.value.code, out=output.getvalue(), err=errors.getvalue())


def succeed(line):
    """Run a command that must succeed without messages, and return its output."""
    done = run(line)
    assert (done.code, done.err) == (0, "")
    return done.out


def facts_of(line):
    return json.loads(succeed(f"{line} --json"))


def summary(text):
    """Return the rows of a summary: the text of each by its name."""
    lines = [(line[:16].strip(), line[16:].strip()) for line in text.splitlines()]
    return {name: [row for other, row in lines if other == name] for name, _ in lines}


def start(line, **pipes):
    return subprocess.Popen([*COMMAND, *line.split()], stderr=subprocess.PIPE, text=True, **pipes)


def test_help_needs_no_kernels():
    code = "import sys, atexit, suslov_fast._cli as c; atexit.register(lambda: print(*sys.modules))"
    command = [sys.executable, "-c", f"{code}; c.main(['run', '--help'])"]
    printed = subprocess.check_output(command, text=True)
    assert "--save-every" in printed
    assert not {"numba", "scipy", "matplotlib"} & set(printed.split())


def test_help():
    assert succeed("") == succeed("--help")
    assert succeed("-V") == succeed("--version") == f"suslov-fast {sf.__version__}\n"
    text = " ".join(succeed("--help").split())
    for name, command in COMMANDS.items():
        assert command.text.partition(".")[0] in text
        assert f"usage: suslov-fast {name} " in succeed(f"{name} --help")
    text = succeed("run --help")
    assert all(f" --{name} " in text for kind in body_classes() for name in kind._names())


@pytest.mark.compiled
def test_quick_start():
    with start("run", stdout=subprocess.PIPE) as process:
        output, errors = process.communicate()
    assert (process.returncode, errors) == (0, ""), "no progress bar without a terminal"
    expected = {
        "body": ["I1 = 4, I2 = 3, I13 = -0.4, I23 = -0.2"], "step size": ["eps = 0.2"],
        "trajectories": ["65,536"], "steps": ["1,000"], "status": ["65,536 OK: finished"],
    }  # fmt: skip
    rows = summary(output)
    assert {**rows, **expected} == rows
    assert rows.keys() - expected == {"drift of F", "threads", "wall time", "speed"}
    assert 0 < float(rows["drift of F"][0].removesuffix(", largest relative")) < 1e-12
    assert os.listdir() == []


@pytest.mark.parametrize(
    ("options", "unit"),
    [
        ("", "steps"), ("--save-every 10 -o o.npz", "equivalent steps"),
        ("--method canonical", "steps"),
        ("--save-every 10 --J 1,1,1 --I .4,-.7,.5 --eps .4 -o o.npz", "equivalent steps"),
    ],
)  # fmt: skip
def test_rates(options, unit):
    """The rate is that of steps; those that no method takes are called equivalent."""
    line = f"run --trajectories 50 --steps 30 {options}"
    facts = facts_of(line)
    rate = facts[f"{unit.replace(' ', '_')}_per_second"]
    assert rate * facts["seconds"] == pytest.approx(50 * 30)
    [speed] = summary(succeed(line.replace("o.npz", "p.npz")))["speed"]
    assert speed.partition(",")[0].split(" ", 1)[1] == f"{unit}/s"
    assert ("closed form" in speed) == (unit != "steps")


@pytest.mark.parametrize("suffix", [".npz", ".zarr"])
def test_run_and_info(suffix):
    name = f"result{suffix}"
    facts = facts_of(f"run --trajectories 1e2 --steps 2e1 --save-every 10 -o {name}")
    saved = sf.open_ensemble(name) if suffix == ".zarr" else load(name)
    assert saved.omega.shape == (3, 100, 2)
    expected = {"trajectories": 100, "saved_states": 3, "written": name, "status": {"OK": 100}}
    expected["body"] = sf.Suslov3D(4, 3, -0.4, -0.2).to_dict()
    assert {**facts, **expected} == facts
    found = [json.loads(line) for line in succeed(f"info {name} {name} --json").splitlines()]
    assert [{**facts, "file": name, **each} for each in found] == [{**facts, "file": name}] * 2
    texts = succeed(f"info {name} {name}").split("\n\n")
    assert [summary(text)["file"] for text in texts] == [[name]] * 2
    mixed = run(f"info {name} missing.npz {name}")
    assert (mixed.code, mixed.out) == (1, succeed(f"info {name} {name}"))
    assert mixed.err == "suslov-fast: missing.npz: No such file or directory\n"


@pytest.mark.filterwarnings("default")
def test_a_warning_is_one_line():
    done = run("run --picture 1 --I3 50 --omega0 1,2 --steps 2")
    assert done.code == 0
    assert done.err.startswith("suslov-fast: warning: I3: expected")
    assert done.err.count("\n") == 1


def test_info(rng, monkeypatch):
    """Drifts are relative to state 0; runs without a known first integral have two energies."""
    from suslov_fast._cli import summary as module

    monkeypatch.setattr(module, "_COMPARED", 10)
    batch = sf.Suslov3D([[4.0], [3.0], [2.0]], 1, -0.5, -0.3)
    nd, starts = sf.SuslovND([1.0, 2.0, 3.0], [0.4, -0.7, 0.5]), rng.normal(size=(7, 3))
    for orbits, drifts in (
        (sf.iterate(batch, [1.0, 0.5], [0.1, 0.2], 30, save_every=7), {"F": sf.first_integral}),
        (sf.iterate(nd, starts, 0.3, 11, save_every=2), {"E_mod": sf.modified_energy}),
        (sf.iterate(nd, starts, 0.1, 9, save_every=None), {}),
    ):
        orbits.save("o.npz", overwrite=True)
        states = np.concatenate([orbits.omega, orbits.final[None]])
        values = {name: f(orbits.body, states, orbits.eps) for name, f in drifts.items()}
        if "E_mod" in drifts:
            values["E"] = sf.energy(nd, states)
        expected = {name: abs(each / each[0] - 1).max() for name, each in values.items()}
        assert (facts_of("info o.npz")["drift"] or {}) == expected


def test_run_is_iterate():
    starts = [[0.3, 0.1], [1.0, -3.0], [0.5, -40.0]]
    np.save("starts.npy", starts)
    line = "run --I1 1 --I2 1 --I13 1 --I23 0 --eps 1 --steps 20 --initial starts.npy"
    statuses = [sf.Status.OK, sf.Status.SUPERCRITICAL, sf.Status.SINGULAR]
    printed = summary(succeed(f"{line} --save-every 5 --method canonical -o o.npz"))
    assert printed["status"] == [f"1 {each.name}: {each.message}" for each in statuses]
    settings = {"method": "canonical", "save_every": 5, "on_singular": "ignore"}
    again = sf.iterate(sf.Suslov3D(1, 1, 1, 0), starts, 1, 20, **settings)
    assert_same_run(load("o.npz"), again, resume=False)


TENSOR = np.array([[4.0, 0.2, -0.5], [0.2, 2.5, -0.3], [-0.5, -0.3, 3.0]])
ONE, OTHER = (sf.Suslov3D.from_inertia(TENSOR, axis)[0] for axis in ([1, -2, 3], [-1, 2, 3]))
BODIES = {
    "": sf.Suslov3D(4, 3, -0.4, -0.2),
    "--picture 3 --I13 2": sf.Suslov3D(4, 2, 2, -0.2),
    "--picture 4 --I3 5 --eps -0.25": sf.Suslov3D(3, 3, -0.2, -0.2, 5),
    "--I1 4 --I2 1 --I13 -.5 --I23 -3e-1 --eps -1e-3": sf.Suslov3D(4, 1, -0.5, -0.3),
    "--inertia 4,2.5,3,0,-0.5,-0.3 --eps 1": sf.Suslov3D(4, 2.5, -0.5, -0.3, 3),
    "--inertia 4,2.5,3,.2,-.5,-.3 --axis 1,-2,3 --eps 1": ONE,
    "--inertia tensor.npy --axis -1,2,3 --eps 1": OTHER,
    "--mass-tensor mass.csv --eps 1": sf.SuslovND([5, 6, 7], [0.4, -0.7, 0.5]),
    "--body b.json --k 0.25 --eps 1": sf.SuslovGyrostat(4, 2, -0.5, -0.3, 0.25, 3),
    "--picture 1 --k 0.5": sf.SuslovGyrostat(4, 1, -0.5, -0.3, 0.5),
    "--J 5,6,7 --I -0.4,-0.7,5e-1 --eps 1": sf.SuslovND([5, 6, 7], [-0.4, -0.7, 0.5]),
}


@pytest.mark.parametrize("options", BODIES)
def test_bodies(options):
    np.save("tensor.npy", TENSOR)
    mass = np.diag([1.0, 2.0, 3.0, 4.0])
    mass[:3, 3] = mass[3, :3] = [0.4, -0.7, 0.5]
    np.savetxt("mass.csv", mass, delimiter=",")
    Path("b.json").write_text(json.dumps(sf.Suslov3D(4, 2, -0.5, -0.3, 3).to_dict()))
    facts = facts_of(f"run {options} --trajectories 5 --steps 4 -o o.npz")
    assert load("o.npz").body == BODIES[options]
    default = "0.02" if "3" in options else "0.2"
    assert facts["eps"] == float(options.split()[-1] if "--eps" in options else default)
    assert (facts["rotation"] is None) == ("--axis" not in options)
    if "--axis" in options:
        axis = np.array([float(each) for each in options.split()[3].split(",")])
        turned = np.array(facts["rotation"]) @ axis
        assert turned == pytest.approx([0, 0, np.linalg.norm(axis)], abs=1e-14)


STARTS = {
    "--omega0 1.0,0.5": [[1.0, 0.5]],
    "--omega0 -1,.5 --omega0 2,-3": [[-1.0, 0.5], [2.0, -3.0]],
    "--trajectories 3 --extent 0.5 --seed 4": sf.RandomStarts(3, 0.5, 4).states(3),
    "--initial s.npy": [[0.3, 0.1], [1.0, 0.25]],
    "--initial head.csv": [[0.3, 0.1], [1.0, 0.25]],
    "--initial savetxt.csv": [[0.3, 0.1], [1.0, 0.25]],
}


@pytest.mark.parametrize("options", STARTS)
def test_starts(options):
    np.save("s.npy", [[0.3, 0.1], [1.0, 0.25]])
    heads = {"head": "\ufeffomega1, Omega 2\n", "savetxt": "# Omega1,Omega2\n"}
    for name, head in heads.items():
        Path(f"{name}.csv").write_text(f"{head}0.3,0.1\n1.0, 2.5e-1\n\n", encoding="utf-8")
    succeed(f"run {options} --steps 0 -o o.npz")
    np.testing.assert_array_equal(load("o.npz").final, STARTS[options])


def test_orientation():
    np.save("R0.npy", [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    found = []
    for option in ("--attitude", "--orientation 0,0,90", "--orientation R0.npy"):
        succeed(f"run --omega0 1,0.5 --steps 3 --save-every 1 --force -o o.npz {option}")
        found.append(load("o.npz").attitude)
    plain, vector, matrix = found
    assert (plain[0] == np.eye(3)).all()
    np.testing.assert_allclose(vector, matrix, atol=1e-15)
    np.testing.assert_allclose(matrix, matrix[0] @ plain, atol=1e-15)


# Exit status, command line, and a part of the message on stderr.
MISTAKES = """
2 | -v | expected a command, run, info, .* got -v; did you mean -V?
2 | --steps=10 -o o.npz | got --steps=10; did you mean: suslov-fast run --steps=10 -o
2 | rum | got rum; did you mean run?
2 | good.npz | did you mean: suslov-fast info good.npz
2 | run --stpes 3 | run: expected one of its options, got --stpes; did you mean --steps?
2 | run --Steps=3 | got --Steps; did you mean --steps?
2 | run --step-size=3 | got --step-size; did you mean --eps?
2 | run --dt 3 | got --dt; suslov-fast run --help lists all
2 | animate --outptu a.gif | got --outptu; did you mean --output?
2 | run 10 | run: expected options, got '10'
2 | run --steps 10 20 | run: expected options, got '20'
2 | run --steps | argument --steps: expected one argument
2 | run --omega0 1 2 | run: expected options, got '2'; numbers of one option are separated by comm
2 | run --J 1 -2, 3 | got '-2,'; numbers of one option are separated by commas, as --omega0 1,2
2 | run --omega0 1,2 extra | run: expected options, got 'extra'
2 | run --omega0 1,2,3 | --omega0: expected the 2 numbers Omega1,Omega2, got 3
2 | run --omega0 1,x | --omega0: expected finite numbers separated by commas .* got '1,x'
2 | run --omega0 nan,1 | --omega0: expected finite numbers .* got 'nan,1'
2 | run --I1 4.5 | of Suslov3D, missing: --I2 --I13 --I23; .* --picture 2 --I1 4.5
2 | run --J 1,2 | of SuslovND, missing: --I
2 | run --I1 -3 | argument --I1: expected a positive number, got '-3'
2 | run --I1 4kg | argument --I1: expected a positive number, got '4kg'
2 | run --I1 4,3 --I2 1 --I13 1 --I23 1 --eps 1 | --I1: expected a positive number, got '4,3'
2 | run --I1 4 --I2 1 --I13 1 --I23 1 | expected a step size with a body of your own, got none; wri
2 | run --picture 1 --J 4,5 | or --J --I or .* got --I1 --I2 --I13 --I23 --J
2 | run --body field.json --eps 1 --k 3 | argument --k: expected none beside a QuadraticField
2 | run --steps -1 | --steps: expected an integer of at least 0 and below 2**62, got '-1'
1 | run --steps 1000000000 --save-every 1 -o o.npz | o.npz: expected a disk with space
1 | run --trajectories 1e12 --steps 9 | in memory, .* -o FILE.zarr writes a run of
2 | run --threads 100000 | argument --threads: expected at most .* got 100000
2 | run --eps inf | argument --eps: expected a finite number, got 'inf'
2 | run --extent 0 | argument --extent: expected a positive number, got '0'
2 | run --method rk4 | method: expected one of 'auto', 'canonical', 'ds2', got 'rk4'
2 | run --save-every 3 | argument --save-every: expected -o FILE with it, got none
2 | run --attitude | argument --attitude: expected -o FILE with it, got none
2 | run --chunk 5 | argument --chunk: expected -o FILE.zarr with it, got none
2 | run --sweep eps=1:2:3 -o o.npz | --sweep: expected -o FILE.zarr with it, got o.npz
2 | run --body cut.json --picture 1 | argument --picture: not allowed with argument --body
1 | run --body missing.json --eps 1 | missing.json: No such file
1 | run --body cut.json --eps 1 | cut.json: expected JSON, .* an error in line 1, column 10
1 | run --body wrong.json --eps 1 | wrong.json: I1: expected a positive moment of inertia, got -4.0
1 | run --body short.json --eps 1 | short.json: parameters: expected the names .* missing: I23
1 | run --body more.json --eps 1 | more.json: parameters: .* unknown: mass
1 | run --body list.json --eps 1 | list.json: parameters: expected a dictionary, .* got list
1 | run --body binary.json --eps 1 | binary.json: expected text in UTF-8
1 | run --initial ragged.csv | ragged.csv: line 4: expected 2 finite numbers .* got '1,2,3'
1 | run --initial short.csv | short.csv: line 3: .* got '3' without a comma
1 | run --initial tabs.csv | tabs.csv: line 1: .* got '1\\t2' without a comma
1 | run --initial semicolons.csv | line 1: .* got '1;2' without a comma
1 | run --initial nan.csv | nan.csv: line 4: expected 2 finite numbers .* got '1,nan'
1 | run --initial empty.csv | empty.csv: expected at least one row of numbers, got none
1 | run --initial swapped.csv | header: expected Omega1,Omega2 or none, got Omega2,Omega1
1 | run --initial cut.npy | cut.npy: expected a .npy file with an array of numbers, got another file
1 | run --initial text.npy | text.npy: expected a .npy file with an array of numbers, got another
2 | run --initial inf.npy -o o.zarr | omega0: expected finite real numbers, got inf at index (2, 1)
1 | run --initial names.npy | names.npy: expected real numbers, got an array of <U1
1 | run --initial three.npy | three.npy: expected the 2 columns Omega1,Omega2, got .* (4, 3)
2 | run --initial starts.txt | --initial: expected the name of a .npy or .csv file, got 'starts.txt'
2 | run --omega0 1,2 --seed 0 | expected either --omega0 or --seed, got both
2 | run --orientation 1,2 -o o.npz | --orientation: expected three numbers, got 2
2 | run --inertia 1,2,3 --eps 1 | --inertia: expected six entries Ixx,Iyy,Izz,Ixy,Ixz,Iyz or the na
2 | run --inertia 4,2,3,0,0,0 --axis 0,0,0 --eps 1 | --axis: expected 3 numbers other than 0
2 | run --axis 1,2,3 | expected --axis only with --inertia or --mass-tensor, got it alone
1 | run -o good.npz | good.npz: expected a new name, got one that exists; --force replaces it
1 | run -o missing/o.npz | missing/o.npz: expected a name in a folder that can be written to
2 | run --scheduler here -o o.zarr | run: scheduler: expected an address such as tcp://127.0.0.1
1 | run -o folder.zarr --force | a store written by ensemble, .* got other data in
2 | run -o o.zarr --sweep mass=1:2:3 | --sweep: expected one of eps, I1, I2, I13, I23, I3, got mass
2 | run -o o.zarr --sweep eps=1:2:3 --eps 1 | --sweep: expected eps given once, got it twice
2 | run -o o.zarr --sweep eps=1:2:3 --sweep eps=1:2:3 | --sweep: expected each name once
1 | run -o o.zarr --sweep eps=0:1:1e15 | fit in memory, .* fewer values of --sweep need less
1 | info missing.npz | missing.npz: No such file or directory
1 | info good.npz | good.npz: expected a .npz file that Trajectories.save wrote, got another file
1 | info foreign.npz good.npz | foreign.npz: expected a run of this package, .* good.npz: expected
1 | pictures | picture1.png: expected a new name, got one that exists; --force replaces it
2 | pictures --dpi 1e9 | --dpi: expected an integer of at least 1 and at most 2400, got '1e9'
1 | report --body cut.json --eps 1/3 | cut.json: expected JSON, .* line 1, column 10
2 | report --body good.json --eps x | argument --eps: expected a number such as 1/3
2 | explore http://127.0.0.1:1/?I1=4 | argument LINK: parameters: expected each of I1, I2
2 | explore --port 65536 | --port: expected an integer of at least 0 and at most 65535, got '65536'
"""


@pytest.fixture(scope="module")
def bad_files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bad")
    (folder / "folder.zarr").mkdir()
    (folder / "folder.zarr" / "thesis.tex").touch()
    arrays = {
        "good": np.ones((4, 2)), "inf": [[1, 2], [3, 4], [5, np.inf]], "names": [["a", "b"]],
        "three": np.ones((4, 3)),
    }  # fmt: skip
    for name, array in arrays.items():
        np.save(folder / f"{name}.npy", array)
    np.savez(folder / "foreign.npz", x=np.ones(3))
    (folder / "cut.npy").write_bytes((folder / "good.npy").read_bytes()[:100])
    (folder / "binary.json").write_bytes(bytes(range(128, 200)))
    field = sf.QuadraticField.from_function(lambda x: (x[0] * x[1], -x[0]), 2)
    body = {"body": "Suslov3D", "I1": 4, "I2": 1, "I13": 0, "I23": 1}
    texts = {
        "good.npz": "precious", "picture1.png": "precious", "starts.txt": "1,2\n",
        "swapped.csv": "Omega2,Omega1\n1,2\n", "ragged.csv": "Omega1,Omega2\n1,2\n\n1,2,3\n",
        "short.csv": "1,2\n\n3\n", "tabs.csv": "1\t2\n", "semicolons.csv": "1;2\n",
        "nan.csv": "# Omega1,Omega2\n\n1,2\n1,nan\n", "text.npy": "1,2\n", "list.json": "[4]",
        "wrong.json": json.dumps(body | {"I1": -4}), "more.json": json.dumps(body | {"mass": 3}),
        "short.json": json.dumps({name: body[name] for name in [*body][:-1]}),
        "field.json": json.dumps(field.to_dict()), "cut.json": '{"body": ', "empty.csv": "",
    }  # fmt: skip
    for name, text in texts.items():
        (folder / name).write_text(text)
    return folder


def check_error(done, status, message):
    """Check that a command printed one line, an error, and had an exit status."""
    assert (done.code, done.out) == (status, "")
    assert done.err.startswith("suslov-fast: ")
    assert all(part in done.err for part in message.split(" .* "))
    assert done.err.count("\n") == 1
    foreign = ("Traceback", "sys.exit", "pickle", "usecols", "codec", "Unable to allocate", "mmap")
    assert not any(word in done.err for word in foreign)


@posix
@pytest.mark.parametrize("mistake", MISTAKES.strip().splitlines())
def test_mistakes(bad_files, monkeypatch, mistake):
    """An error prints one line, has the right exit status, and writes no file."""
    status, line, message = map(str.strip, mistake.split("|"))
    monkeypatch.chdir(bad_files)
    before = set(os.listdir())
    check_error(run(line), int(status), message)
    assert {name for name in os.listdir() if not name.endswith(".lock")} <= before
    assert before <= set(os.listdir())
    assert Path("good.npz").read_text() == "precious"


def test_a_full_disk_is_noticed_before_the_run(monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=10_000))
    line = "run --trajectories 20 --steps 40 --save-every 2 --attitude -o o.npz"
    needed = f"{8 * 20 * 21 * (2 + 9):,}"
    check_error(run(line), 1, f"of which 10,000 bytes are free, got {needed} bytes; raise --save")
    assert os.listdir() == []
    succeed(line.replace("40", "4"))


@pytest.mark.compiled
@posix
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
@pytest.mark.sampled(1)
def test_signals_leave_nothing_behind(name):
    line = "run --method ds2 --trajectories 1 --threads 1 -o o.npz --steps"
    succeed(f"{line} 1000")  # compiles
    with start(f"{line} 10000000000000 --force") as process:
        while len(os.listdir()) == 1:
            assert process.poll() is None
            time.sleep(0.05)
        time.sleep(0.5)
        process.send_signal(getattr(signal, name))
        errors = process.communicate(timeout=60)[1]
    assert process.returncode in (130, -signal.SIGINT)  # a shell reports 130 for both
    assert errors.endswith("suslov-fast: interrupted\n")
    assert os.listdir() == ["o.npz"]
    assert load("o.npz").steps == 1000


@posix
def test_streams():
    reading, writing = os.pipe()
    os.close(reading)  # nobody reads
    with start("run --trajectories 5 --steps 5", stdout=writing) as process:
        assert (process.communicate(timeout=60)[1], process.returncode) == ("", 141)
    os.close(writing)
    full = "suslov-fast: standard output: No space left on device\n"
    line = f"'{COMMAND[0]}' -m suslov_fast run --trajectories 5 --steps 5"
    for redirection, result in {">&-": (0, ""), "2>&-": (0, ""), "> /dev/full": (1, full)}.items():
        redirected = ["sh", "-c", f"{line} {redirection}"]
        done = subprocess.run(redirected, capture_output=True, text=True, timeout=60)
        assert (done.returncode, done.stderr) == result, redirection


STORED = "run --picture 1 --trajectories 100 --steps 40 --save-every 4 -o run.zarr"


def test_a_grid_of_parameters():
    sweeps = "--sweep eps=0.1:0.4:4 --sweep I13=-0.5:0.5:3"
    facts = facts_of(f"{STORED} {sweeps} --chunk 60 --compression zstd --verify")
    assert facts["trajectories"] == 1200
    assert facts["tiles_done"] == "24 of 24"
    assert facts["status"] == {"OK": 1200}
    assert facts["drift"]["F"] < 1e-12
    dataset = sf.open_ensemble("run.zarr")
    assert dataset.omega.dims == ("n", "eps", "I13", "trajectory", "component")
    one = dataset.sel(eps=0.2, I13=0.5, method="nearest")
    orbits = sf.iterate(sf.Suslov3D(4, 1, 0.5, -0.3), one.omega.values[0], 0.2, 40, save_every=4)
    assert np.allclose(one.omega, orbits.omega, rtol=1e-12)
    assert {**facts, **facts_of("info run.zarr")} == facts
    assert summary(succeed("info run.zarr"))["tiles done"] == ["24 of 24"]


def test_a_sweep_in_n_dimensions():
    line = "run --J 1,2,4 --I .4,-.7,.5 --omega0 1,2,3 --steps 9 -o nd.zarr"
    reduced = "--reduce omega_max --reduce energy_drift"
    facts = facts_of(f"{line} --sweep eps=0.1:0.3:3 {reduced}")
    assert facts["trajectories"] == 3
    dataset = sf.open_ensemble("nd.zarr")
    assert dataset.eps.values.tolist() == [0.1, 0.2, 0.3]
    assert dataset.omega_max.shape == (3, 1, 3)
    assert facts["drift"] == {"E": float(dataset.energy_drift.max())}


def test_the_same_run_continues_and_another_is_refused():
    succeed(STORED)
    longer = STORED.replace("--steps 40", "--steps 60")
    assert facts_of(longer)["steps"] == 60
    for other, message in (
        (f"{longer} --eps 0.3", "another run, with eps 0.2 instead of 0.3"),
        (STORED, "steps: expected at least the 60 of the run in"),
    ):
        refused = run(other)
        check_error(refused, 1, message)
        assert refused.err.endswith("--force replaces it\n")
    assert facts_of(f"{longer} --eps 0.3 --force")["eps"] == 0.3


def test_warm_up_calls_all_functions(monkeypatch):
    from suslov_fast._cli import warm_up

    monkeypatch.setattr(warm_up, "_COUNTS", (3,))
    monkeypatch.setattr(warm_up, "_WARM_STEPS", 8)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sf.SingularStepWarning)
        called = {name for name, job in warm_up._jobs() if job()}
    others = tuple("plot animate ensemble open from_m from_v explore body_ fixed".split())
    functions = {name for name in dir(sf) if inspect.isfunction(getattr(sf, name))}
    assert {name for name in functions - called if not name.startswith(others)} == set()


@pytest.mark.compiled
def test_pictures():
    paths = succeed("pictures --format pdf --letters -o new/folder").split()
    assert paths == [f"new/folder/picture{k}.pdf" for k in (1, 2, 3, 4)]
    assert all(Path(path).read_bytes().startswith(b"%PDF") for path in paths)


@pytest.mark.compiled
def test_animate():
    options = "--inertia 4,2,3,0,-.5,-.3 --eps .1 --omega0 1,2 --orientation 0,0,30"
    assert succeed(f"animate {options} --steps 4 --dpi 40 -o body.gif") == "body.gif\n"
    assert Path("body.gif").read_bytes().startswith(b"GIF89a")
    assert os.listdir() == ["body.gif"]


def test_without_matplotlib(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    check_error(run("pictures"), 1, "pip install '.[plots]'")
