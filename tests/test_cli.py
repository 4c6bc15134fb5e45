"""The command line, as a newcomer meets it."""

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

import suslov_fast as sf
from suslov_fast._cli import main
from suslov_fast._cli.options import COMMANDS

posix = pytest.mark.skipif(os.name != "posix", reason="POSIX signals, links and terminals")
COMMAND = [sys.executable, "-m", "suslov_fast"]


def run(*arguments, folder="."):
    """Run the command in this process, which has imported and loaded everything."""
    output, errors = io.StringIO(), io.StringIO()
    before = os.getcwd()
    os.chdir(folder)
    try:
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
            main([str(each) for each in arguments])
    except SystemExit as stopped:
        code = stopped.code
    finally:
        os.chdir(before)
    return SimpleNamespace(code=code, out=output.getvalue(), err=errors.getvalue())


def succeed(line, *more, folder="."):
    """Run a command that succeeds in silence, and return its output."""
    done = run(*line.split(), *more, folder=folder)
    assert (done.code, done.err) == (0, "")
    return done.out


def summary(text):
    rows = {}
    for line in text.splitlines():
        rows.setdefault(line[:16].strip(), []).append(line[16:].strip())
    return rows


def in_process(*arguments, **settings):
    """Run the command in a process of its own."""
    settings = {"capture_output": True, "text": True, "timeout": 300, **settings}
    return subprocess.run([*COMMAND, *map(str, arguments)], **settings)


# ------------------------------------------------------------------ what is printed


@pytest.mark.parametrize("option", ["-V", "--version"])
def test_version(option):
    assert succeed(option) == f"suslov-fast {sf.__version__}\n"


def test_entry_point():
    text = (Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8")
    assert '[project.scripts]\nsuslov-fast = "suslov_fast._cli:main"\n' in text


def test_help():
    text = succeed("--help")
    for name, command in COMMANDS.items():
        assert command.help in text
        assert f"usage: suslov-fast {name} " in succeed(f"{name} --help")


def test_help_needs_no_kernels():
    code = "import sys, atexit, suslov_fast._cli as c; atexit.register(lambda: print(*sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", f"{code}; c.main(['run', '--help'])"], capture_output=True, text=True
    )
    assert "--save-every" in done.stdout
    assert not {"numba", "scipy", "matplotlib"} & set(done.stdout.split())


@pytest.mark.compiled
def test_quick_start(tmp_path):
    done = in_process("run", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, ""), "no bar where there is no terminal"
    rows = summary(done.stdout)
    assert list(rows) == [
        "body",
        "step size",
        "trajectories",
        "steps",
        "threads",
        "wall time",
        "speed",
        "drift of F",
        "status",
    ]
    assert rows["body"] == ["I1 = 4, I2 = 3, I13 = -0.4, I23 = -0.2"]
    assert not np.isnan(sf.Suslov3D(4, 3, -0.4, -0.2).admissible_I3()).any()
    assert [rows[name][0] for name in ("step size", "trajectories", "steps")] == [
        "eps = 0.2",
        "65,536",
        "1,000",
    ]
    assert rows["wall time"][0].endswith(" s, after compilation")
    assert " states/s, by the closed form where it is faster" in rows["speed"][0]
    assert float(rows["drift of F"][0].split(",")[0]) < 1e-12
    assert rows["status"] == ["65,536 OK: finished"]
    assert list(tmp_path.iterdir()) == []


def test_rates():
    """Steps are counted where they are taken, states elsewhere."""
    line = "run --trajectories 50 --steps 30 --save-every 10 --json --method"
    auto, canonical = (json.loads(succeed(f"{line} {each}")) for each in ("auto", "canonical"))
    assert auto["states_per_second"] * auto["seconds"] == pytest.approx(50 * 4)
    assert canonical["steps_per_second"] * canonical["seconds"] == pytest.approx(50 * 30)
    assert "steps_per_second" not in auto


@pytest.mark.parametrize("suffix", [".npz", ".nc", ".zarr"])
def test_run_and_info(tmp_path, suffix):
    for library in ("netCDF4", "zarr", "dask"):
        pytest.importorskip(library)
    name = f"result{suffix}"
    line = "run --trajectories 1e2 --steps 2e1 --save-every 10 --json --output"
    facts = json.loads(succeed(line, name, folder=tmp_path))
    saved = sf.open_ensemble(tmp_path / name) if suffix == ".zarr" else None
    saved = saved or sf.Trajectories.load(tmp_path / name)
    assert facts["trajectories"] == saved.status.size == 100
    assert facts["saved_states"] == len(saved.omega) == 3
    assert facts["written"] == name
    body = sf.Suslov3D(4, 3, -0.4, -0.2)
    F = sf.first_integral(body, np.asarray(saved.omega), 0.2)
    largest = facts["drift"]["F"]["largest"]
    assert largest == pytest.approx(abs(F / F[0] - 1).max(), abs=1e-18)
    assert facts["status"] == {"OK": 100}
    assert facts["body"] == {"type": "Suslov3D", **body.to_dict()}
    same = json.loads(succeed("info --json", name, folder=tmp_path))
    assert {**facts, **same} == facts
    rows = summary(succeed("info", name, folder=tmp_path))
    assert rows["saved states"] == ["3"]
    assert rows["method"] == ["auto"]


def test_info_on_batches_of_bodies_and_steps(tmp_path):
    body = sf.Suslov3D([[4.0], [3.0], [2.0]], 1, -0.5, -0.3)
    orbits = sf.iterate(body, [1.0, 0.5], [0.1, 0.2], 30, save_every=7)
    orbits.save(tmp_path / "sweep.npz")
    rows = summary(succeed("info sweep.npz", folder=tmp_path))
    assert rows["body"] == ["I1 = 2 ... 4 (3, 1), I2 = 1, I13 = -0.5, I23 = -0.3"]
    assert rows["step size"] == ["eps = 0.1 ... 0.2 (2,)"]
    facts = json.loads(succeed("info sweep.npz --json", folder=tmp_path))
    states = np.concatenate([orbits.omega, orbits.final[None]])
    F = sf.first_integral(body, states, orbits.eps)
    assert facts["drift"]["F"]["largest"] == abs(F / F[0] - 1).max()


def test_info_without_the_first_state(tmp_path):
    body = sf.SuslovND([1.0, 2.0, 4.0], [0.1, 0.2, 0.3])
    sf.iterate(body, np.ones((3, 3)), 0.1, 9, save_every=None).save(tmp_path / "last.npz")
    rows = summary(succeed("info last.npz", folder=tmp_path))
    assert not any(name.startswith("drift") for name in rows)
    assert rows["body"] == ["n = 4, J = [1. 2. 4.], I = [0.1 0.2 0.3]"]


@pytest.mark.parametrize("slab", [1, 10, 10**6])
def test_drift_of_energies(tmp_path, monkeypatch, rng, slab):
    """Bodies whose first integral is not known have two energies; slabs of states do not matter."""
    from suslov_fast._cli import summary as module

    monkeypatch.setattr(module, "_SLAB", slab)
    body = sf.SuslovND([1.0, 2.0, 3.0], [0.4, -0.7, 0.5])
    orbits = sf.iterate(body, rng.normal(size=(7, 3)), 0.3, 11, save_every=2)
    orbits.save(tmp_path / "o.npz")
    drift = json.loads(succeed("info --json", tmp_path / "o.npz"))["drift"]
    states = np.concatenate([orbits.omega, orbits.final[None]])
    for name, values in (
        ("E", sf.energy(body, states)),
        ("E_mod", sf.modified_energy(body, states, 0.3)),
    ):
        assert drift[name] == {"largest": abs(values / values[0] - 1).max(), "beyond_float64": 0}
    assert 0 < drift["E_mod"]["largest"] < drift["E"]["largest"]


def test_drift_beyond_float64(tmp_path):
    (tmp_path / "starts.csv").write_text("1e160,2\n1,2\n")
    body = "run --I1 1 --I2 1 --I13 0 --I23 0 --eps 1 --steps 3 --initial starts.csv"
    rows = summary(succeed(body, folder=tmp_path))
    assert rows["drift of F"] == ["0, largest relative; beyond float64: 1"]


# ------------------------------------------------------------------ bodies and starts


def test_run_is_iterate(tmp_path):
    np.save(tmp_path / "starts.npy", [[0.3, 0.1], [1.0, -3.0], [0.5, -40.0]])
    line = "run --I1 1 --I2 1 --I13 1 --I23 0 --eps 1 --steps 20 --initial starts.npy"
    rows = summary(
        succeed(f"{line} --save-every 5 --threads 1 --method canonical -o o.npz", folder=tmp_path)
    )
    assert rows["status"] == [
        f"1 {status.name}: {status.message}"
        for status in (sf.Status.OK, sf.Status.SUPERCRITICAL, sf.Status.SINGULAR)
    ]
    saved = sf.Trajectories.load(tmp_path / "o.npz")
    again = sf.iterate(
        sf.Suslov3D(1, 1, 1, 0),
        np.load(tmp_path / "starts.npy"),
        1,
        20,
        save_every=5,
        method="canonical",
        on_singular="ignore",
    )
    for name in ("omega", "n", "final", "status", "failed_at", "eps"):
        np.testing.assert_array_equal(getattr(saved, name), getattr(again, name))
    assert saved.body == again.body


TENSOR = np.array([[4.0, 0.2, -0.5], [0.2, 2.5, -0.3], [-0.5, -0.3, 3.0]])
DIAGONAL = np.array([[4.0, 0.0, -0.5], [0.0, 2.5, -0.3], [-0.5, -0.3, 3.0]])
BODIES = {
    "": sf.Suslov3D(4, 3, -0.4, -0.2),
    "--picture 1": sf.Suslov3D(4, 1, -0.5, -0.3),
    "--picture 3 --I13 2": sf.Suslov3D(4, 2, 2, -0.2),
    "--picture 4 --I3 5 --eps -0.25": sf.Suslov3D(3, 3, -0.2, -0.2, 5),
    "--I1 4 --I2 1 --I13 -.5 --I23 -3e-1 --eps -1e-3": sf.Suslov3D(4, 1, -0.5, -0.3),
    "--inertia 4,2.5,3,0,-0.5,-0.3 --eps 1": sf.Suslov3D(4, 2.5, -0.5, -0.3, 3),
    "--inertia 4,2.5,3,.2,-.5,-.3 --axis 1,-2,3 --eps 1": sf.Suslov3D.from_inertia(
        TENSOR, [1, -2, 3]
    )[0],
    "--inertia tensor.npy --axis -1,2,3 --eps 1": sf.Suslov3D.from_inertia(TENSOR, [-1, 2, 3])[0],
    "--mass-tensor mass.csv --eps 1": sf.SuslovND([5, 6, 7], [0.4, -0.7, 0.5]),
    "--J 5,6,7 --I -0.4,-0.7,5e-1 --eps 1": sf.SuslovND([5, 6, 7], [-0.4, -0.7, 0.5]),
}


@pytest.mark.parametrize("options", BODIES)
def test_bodies(tmp_path, options):
    np.save(tmp_path / "tensor.npy", TENSOR)
    mass = np.diag([1.0, 2.0, 3.0, 4.0])
    mass[:3, 3] = mass[3, :3] = [0.4, -0.7, 0.5]
    np.savetxt(tmp_path / "mass.csv", mass, delimiter=",")
    line = f"run {options} --trajectories 5 --steps 4 --json -o o.npz"
    facts = json.loads(succeed(line, folder=tmp_path))
    orbits = sf.Trajectories.load(tmp_path / "o.npz")
    assert orbits.body == BODIES[options]
    assert orbits.status.shape == (5,)
    if "--eps" in options:
        assert facts["eps"] == float(options.split()[-1])
    else:
        assert facts["eps"] == (0.02 if "3" in options else 0.2)
    if "--axis" in options:
        axis = np.array([float(each) for each in options.split()[3].split(",")])
        turned = np.array(facts["rotation"]) @ axis
        assert turned == pytest.approx([0, 0, np.linalg.norm(axis)], abs=1e-14)
    else:
        assert facts["rotation"] is None


def test_every_parameter_of_a_body_is_an_option():
    from suslov_fast._cli.options import body_classes

    text = succeed("run --help")
    assert sf.Suslov3D in body_classes()
    for kind in body_classes():
        assert all(f" --{name} " in text for name in kind._names())


STARTS = {
    "--omega0 1.0,0.5": [[1.0, 0.5]],
    "--omega0 -1,.5 --omega0 2,-3": [[-1.0, 0.5], [2.0, -3.0]],
    "--trajectories 3 --seed 4": sf.RandomStarts(3, 2.0, 4).states(3),
    "--trajectories 3 --extent 0.5": sf.RandomStarts(3, 0.5).states(3),
    "--initial starts.npy": [[0.3, 0.1], [1.0, 0.25]],
    "--initial plain.csv": [[0.3, 0.1], [1.0, 0.25]],
    "--initial head.csv": [[0.3, 0.1], [1.0, 0.25]],
    "--initial marked.csv": [[0.3, 0.1], [1.0, 0.25]],
}


@pytest.mark.parametrize("options", STARTS)
def test_starts(tmp_path, options):
    rows = "0.3,0.1\n1.0, 2.5e-1\n"
    np.save(tmp_path / "starts.npy", [[0.3, 0.1], [1.0, 0.25]])
    for name, head in (("plain", ""), ("head", "omega1,omega2\n"), ("marked", "\ufeffΩ1, Ω2\n")):
        (tmp_path / f"{name}.csv").write_text(head + rows, encoding="utf-8")
    succeed(f"run {options} --steps 0 -o o.npz", folder=tmp_path)
    assert (
        sf.Trajectories.load(tmp_path / "o.npz").final.tolist()
        == np.array(STARTS[options]).tolist()
    )


def test_orientation(tmp_path):
    line = "run --omega0 1,0.5 --steps 3 --save-every 1 --force -o o.npz"
    np.save(tmp_path / "R0.npy", [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    found = []
    for option in ("--attitude", "--orientation 0,0,90", "--orientation R0.npy"):
        succeed(f"{line} {option}", folder=tmp_path)
        found.append(sf.Trajectories.load(tmp_path / "o.npz").attitude)
    plain, vector, matrix = found
    assert (plain[0] == np.eye(3)).all()
    np.testing.assert_allclose(vector, matrix, atol=1e-15)
    np.testing.assert_allclose(matrix, matrix[0] @ plain, atol=1e-15)


# ------------------------------------------------------------------ mistakes

# The exit status, a command line, and what stderr says in one line.
MISTAKES = """
2 | | expected one of run, info, warm-up, pictures, animate, explore, got nothing
2 | walk | unknown command 'walk'; expected one of run
2 | pictrues | unknown command 'pictrues'; did you mean pictures?
2 | --verison | unknown command '--verison'
2 | run --step 3 | unknown option --step; did you mean --steps?
2 | run --sed=3 | unknown option --sed; did you mean --seed?
2 | run --speed 3 | unknown option --speed
2 | run now | expected no argument 'now'
2 | run --picture 5 | --picture: expected 1, 2, 3 or 4, got '5'
2 | run --I1 4 | expected all of --I1 --I2 --I13 --I23, got no --I2 --I13 --I23; --picture N takes
2 | run --I1 4 --I2 1 --I13 1 --I23 1 | expected a step size with a body of your own, got none; wri
2 | run --picture 1 --J 4,5 | expected the parameters of one body, got --I1 --I13 --I2 --I23 --J
2 | run --J 1,2 --I1 3 | expected the parameters of one body, got --I1 --J
2 | run --picture 1 --I1 0 | --I1: expected a positive number, got '0'
2 | run --eps nan | --eps: expected a finite number, got 'nan'
2 | run --eps | --eps: expected one argument
2 | run --steps -1 | --steps: expected an integer of at least 0 and below 2**62, got '-1'
2 | run --steps 1.5 | --steps: expected an integer of at least 0 and below 2**62, got '1.5'
2 | run --steps 1e999999999 | --steps: expected an integer of at least 0 and below 2**62, got '1e99
2 | run --steps 99999999999999999999 | expected an integer of at least 0 and below 2**62, got '9999
2 | run --trajectories 0 | --trajectories: expected an integer of at least 1
1 | run --trajectories 1000000000000 | expected arrays that fit in memory
1 | run --steps 1000000000 --save-every 1 | raise --save-every or lower --trajectories
2 | run --extent -1 | --extent: expected a positive number, got '-1'
2 | run --threads 100000 | --threads: expected at most
2 | run --method rk4 | method: expected one of 'auto', 'canonical', 'ds2', got 'rk4'
2 | run --J 1,2,4 --I 1,2,3 --eps 0.1 --method ds2 | method: expected one of 'auto', 'gauss'
2 | run --omega0 1 | --omega0: expected 2 numbers, Omega1, Omega2, got 1
2 | run --omega0 1,x | --omega0: expected finite numbers separated by commas, got '1,x'
2 | run --omega0 1,2 --seed 0 | expected either --omega0 or --seed, got both
2 | run --initial good.npy --trajectories 3 | expected either --initial or --trajectories, got both
2 | run --orientation 1,2 | --orientation: expected a rotation vector of three numbers
1 | run --orientation good.csv | good.csv: orientation: expected shape (..., 3), got (2, 2)
1 | run --initial missing.npy | missing.npy: expected a readable file, got: No such file
1 | run --initial folder.npy | folder.npy: expected a readable file, got a folder
1 | run --initial fifo.csv | fifo.csv: expected a readable file, got a FIFO
1 | run --initial loop.npy | loop.npy: expected a readable file, got: Too many levels
1 | run --initial starts.txt | starts.txt: expected a .npy or .csv file, got '.txt'
1 | run --initial three.npy | three.npy: states: expected shape (..., 2), got (4, 3)
1 | run --initial flat.npy | flat.npy: expected 2 columns, got an array of shape (4,)
1 | run --initial complex.npy | complex.npy: states: expected real numbers
1 | run --initial objects.npy | objects.npy: expected a .npy file that numpy.save wrote, got: Object
1 | run --initial cut.npy | cut.npy: expected a .npy file that numpy.save wrote
1 | run --initial empty.npy | empty.npy: expected a .npy file that numpy.save wrote
1 | run --initial nan.csv | nan.csv: states: expected finite real numbers, got nan at index
1 | run --initial words.csv | words.csv: could not convert string 'b'
1 | run --initial semicolon.csv | semicolon.csv: could not convert string '0.3;0.1'
1 | run --initial ragged.csv | ragged.csv: the number of columns changed from 2 to 1
1 | run --initial empty.csv | empty.csv: expected at least one state, got none
2 | run --J 1,2,3 --eps 0.1 | expected all of --J --I, got no --I
2 | run --J 1,2,3 --I 1,2 --eps 0.1 | parameters of the body: J, I: expected shapes (..., n - 1)
2 | run --J 1,-2 --I 1,2 --eps 0.1 | parameters of the body: J: expected positive
2 | run --inertia 1,2,3 --eps 1 | --inertia: expected six entries Ixx,Iyy,Izz,Ixy,Ixz,Iyz or the na
2 | run --inertia 1,1,3,0,0,0 --eps 1 | --inertia: I: expected an inertia tensor that a body can
2 | run --inertia good.txt --eps 1 | --inertia: expected finite numbers separated by commas or the n
2 | run --inertia 1,1,1,0,0,0 --eps 1 --axis 0,0,0 | --inertia: a: expected an axis other
2 | run --inertia 1,1,1,0,0,0 | expected a step size with a body of your own
1 | run --inertia good.npy --eps 1 | good.npy: expected an n x n matrix, got an array of
1 | run --inertia four.npy --eps 1 | four.npy: I: expected shape (..., 3, 3), got (4, 4)
1 | run --mass-tensor missing.npy --eps 1 | missing.npy: expected a readable file
2 | run --mass-tensor four.npy --picture 1 | expected one body, got --mass-tensor and --picture
2 | run --axis 1,2,3 | expected --axis only with --inertia or --mass-tensor, got it alone
1 | run -o good.npz | good.npz: expected a new name, got one that exists; --force replaces it
1 | run -o missing/o.npz | missing/o.npz: expected a name in a folder that can be written to
1 | run -o folder.npz | folder.npz: expected the name of a file to write, got a folder
1 | run -o fifo.npz | fifo.npz: expected the name of a file to write, got a FIFO
2 | run -o result/ | -o/--output: expected the name of a .npz, .nc or .zarr file, got 'result/'
2 | run -o good.npy | -o/--output: expected the name of a .npz, .nc or .zarr file, got 'good.npy'
2 | run --chunk 5 | argument --chunk: expected -o FILE.zarr with it, got none
2 | run --reduce omega_max -o o.npz | argument --reduce: expected -o FILE.zarr with it, got none
2 | info | the following arguments are required: FILE
1 | info missing.npz | missing.npz: expected a readable file, got: No such file or directory
1 | info missing.zarr | missing.zarr: expected a readable file, got: No such file or directory
1 | info folder.npz | folder.npz: expected a .npz file that Trajectories.save wrote
1 | info other.npz | other.npz: expected a run that Trajectories.save or to_xarray wrote
1 | pictures -o good.npy | good.npy: expected a folder or a name for one, got: File exists
1 | pictures | picture1.png: expected a new name, got one that exists; --force replaces it
2 | animate | the following arguments are required: -o/--output
2 | animate -o body.png | body.png: expected a name that ends in .gif or .mp4, got '.png'
1 | animate -o missing/body.gif | missing/body.gif: expected a name in a folder that can be written
2 | animate -o a.gif --J 1,2,3 --I 1,2,3 --eps 1 | expected a three-dimensional body, got one for
2 | animate -o a.gif --inertia 4,2,3,0,0,0 | expected a step size with a body of your own
2 | explore --port 65536 | --port: expected an integer of at least 0 and below 65536, got '65536'
"""


@pytest.fixture(scope="module")
def bad_files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bad")
    for suffix in ("npy", "npz"):
        (folder / f"folder.{suffix}").mkdir()
        (folder / f"loop.{suffix}").symlink_to(f"loop.{suffix}")
    for name in ("fifo.csv", "fifo.npz"):
        os.mkfifo(folder / name)
    np.savez(folder / "other.npz", omega=np.ones(3))
    arrays = {
        "good": np.ones((4, 2)),
        "four": np.eye(4),
        "three": np.ones((4, 3)),
        "flat": np.ones(4),
        "complex": np.ones((4, 2)) * 1j,
        "objects": np.array([[1, "a"]], dtype=object),
    }
    for name, array in arrays.items():
        np.save(folder / f"{name}.npy", array)
    (folder / "cut.npy").write_bytes((folder / "good.npy").read_bytes()[:100])
    texts = {
        "good.npz": "precious",
        "good.csv": "1,0\n0,1\n",
        "empty.npy": "",
        "empty.csv": "",
        "picture1.png": "precious",
        "starts.txt": "1,2\n",
        "nan.csv": "1,2\n3,nan\n",
        "words.csv": "1,2\n3,b\n",
        "semicolon.csv": "0.3;0.1\n0.4;0.2\n",
        "ragged.csv": "1,2\n3\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    return folder


@posix
@pytest.mark.parametrize("mistake", MISTAKES.strip().splitlines())
def test_mistakes(bad_files, mistake):
    """One line, the right exit status, nothing written."""
    status, line, message = map(str.strip, mistake.split("|"))
    if "animate" in line or "pictures" in line:
        pytest.importorskip("matplotlib")
    before = sorted(bad_files.iterdir())
    done = run(*line.split(), folder=bad_files)
    assert (done.code, done.out) == (int(status), "")
    assert done.err.startswith("suslov-fast: ")
    assert message in done.err
    assert done.err.count("\n") == 1
    assert sorted(bad_files.iterdir()) == before
    assert (bad_files / "good.npz").read_text() == "precious"


def test_force(tmp_path):
    line = "run --trajectories 3 --steps 3 -o o.npz"
    (tmp_path / "o.npz").write_text("of another run")
    assert run(*line.split(), folder=tmp_path).code == 1
    succeed(f"{line} --force", folder=tmp_path)
    assert sf.Trajectories.load(tmp_path / "o.npz").status.shape == (3,)


def test_sizes_are_said_before(tmp_path, monkeypatch):
    from suslov_fast._cli import work

    monkeypatch.setattr(work, "_LARGE", 2**20)
    line = "run --steps 99 --save-every 1 --trajectories 1000 -o o.npz"
    assert run(*line.split(), folder=tmp_path).err == "suslov-fast: o.npz will take 0.0 GB\n"


# ------------------------------------------------------------------ signals, streams, disks


@pytest.mark.compiled
@posix
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_signals_leave_nothing_behind(tmp_path, name):
    result = tmp_path / "o.npz"
    few = "run --method ds2 --trajectories 1 --threads 1 --steps".split()
    assert run(*few, 1000).code == 0  # compiles
    command = [*COMMAND, *few, "10000000000000", "-o", str(result)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            while not list(tmp_path.iterdir()):
                assert process.poll() is None
                time.sleep(0.05)
            time.sleep(0.5)
            process.send_signal(getattr(signal, name))
            errors = process.communicate(timeout=60)[1]
        finally:
            process.kill()
    assert process.returncode == 130, errors
    *_, last = errors.splitlines()  # Python may say that a callback dropped an exception
    assert last.startswith("suslov-fast: interrupted while ")
    assert last.endswith(f"; {result} was not written")
    assert list(tmp_path.iterdir()) == []


@posix
@pytest.mark.parametrize(
    ("module", "name", "phase", "written"),
    [
        ("run", "_compile", "compiling", False),
        ("run", "entries_of", "writing", False),
        ("run", "outcome_of", "checking", True),
    ],
)
def test_ctrl_c(tmp_path, monkeypatch, module, name, phase, written):
    """The message says in which phase it came, and whether the file was written."""
    import importlib

    def interrupt(*args, **kwargs):
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(importlib.import_module(f"suslov_fast._cli.{module}"), name, interrupt)
    path = tmp_path / "o.npz"
    path.write_text("of another run")
    done = run("run", "--trajectories", 5, "--steps", 5, "--force", "-o", path)
    assert (done.code, done.out) == (130, "")
    said = f"{path} was {'' if written else 'not '}written"
    assert done.err == f"suslov-fast: interrupted while {phase}; {said}\n"
    assert (path.read_bytes() != b"of another run") == written
    assert len(list(tmp_path.iterdir())) == 1


@posix
@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM"])
def test_ctrl_c_while_the_package_is_imported(tmp_path, number):
    (tmp_path / "numba.py").write_text(
        f"import os, signal, time\nos.kill(os.getpid(), signal.{number})\ntime.sleep(60)\n"
    )
    path = f"{tmp_path}{os.pathsep}{Path(sf.__file__).parents[1]}"
    done = in_process("run", env=os.environ | {"PYTHONPATH": path}, timeout=50)
    assert (done.returncode, done.stderr) == (130, "suslov-fast: interrupted\n")


@posix
def test_progress_on_a_terminal(tmp_path):
    import pty

    ours, theirs = pty.openpty()
    line = "run --method ds2 --trajectories 20000 --steps 3000 --threads 1 -o o.npz".split()
    done = subprocess.run(
        [*COMMAND, *line], cwd=tmp_path, stdout=subprocess.PIPE, stderr=theirs, timeout=120
    )
    os.close(theirs)
    shown = b""
    with contextlib.suppress(OSError):  # the other end is closed
        while some := os.read(ours, 4096):
            shown += some
    os.close(ours)
    assert done.returncode == 0
    text = shown.decode()
    places = [text.index(f"suslov-fast: {each}") for each in ("compiling", "iterating", "checking")]
    assert places == sorted(places)
    assert "iterating [" in text
    assert text.endswith("\r\x1b[K"), "the line is cleared"
    assert b"suslov-fast: " not in done.stdout


@posix
@pytest.mark.parametrize(
    ("redirection", "status", "errors"),
    [
        (">&-", 0, ""),
        ("2>&-", 0, ""),
        ("| true", 0, ""),
        ("> /dev/full", 1, "suslov-fast: standard output: No space left on device\n"),
    ],
)
def test_streams(tmp_path, redirection, status, errors):
    line = f"'{COMMAND[0]}' -m suslov_fast run --trajectories 5 --steps 5 {redirection}"
    done = subprocess.run(["sh", "-c", line], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (status, errors)


@pytest.mark.compiled
@posix
@pytest.mark.parametrize("suffix", [".npz", ".nc"])
def test_a_disk_that_is_full(tmp_path, suffix):
    """An old file stays, and nothing is left beside it."""
    import resource

    path = tmp_path / f"o{suffix}"
    succeed("run --trajectories 100 --steps 3 -o", path)
    before = path.read_bytes()
    done = in_process(
        *"run --trajectories 2e4 --seed 1 --steps 3 --force -o".split(),
        path,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (2**16, 2**16)),
    )
    assert done.returncode == 1
    assert done.stderr.startswith(f"suslov-fast: {path}: could not be written: ")
    assert done.stderr.count("\n") == 1
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@posix
def test_names_that_the_terminal_cannot_show(tmp_path):
    ascii_only = {"PYTHONIOENCODING": "ascii", "LC_ALL": "C", "PYTHONUTF8": "0"}
    name = os.fsdecode(b"\xff.npz")
    line = ["run", "--trajectories", "3", "--steps", "3", "-o", name]
    done = in_process(*line, cwd=tmp_path, env=os.environ | ascii_only)
    assert summary(done.stdout)["written"] == [r"\udcff.npz"]
    again = in_process(*line, cwd=tmp_path, env=os.environ | ascii_only)
    assert again.stderr.startswith(r"suslov-fast: \udcff.npz: expected a new name")


# ------------------------------------------------------------------ other commands


def test_warm_up_calls_everything(monkeypatch):
    """Every public function, on few and on many states."""
    from suslov_fast._cli import warm_up

    monkeypatch.setattr(warm_up, "_COUNTS", {"one thread": 3, "all threads": 4})
    monkeypatch.setattr(warm_up, "_STEPS", 8)
    calls = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, job in warm_up._jobs():
            calls.setdefault(name, []).append(job())
    others = ("plot", "animate", "ensemble", "open", "from_matrix", "from_vector")
    for name in dir(sf):
        if inspect.isfunction(getattr(sf, name)) and not name.startswith(others):
            half = len(calls[name]) // 2
            assert max(calls[name][:half]) > 0, name
            assert max(calls[name][half:]) > 0, name


@pytest.mark.compiled
def test_pictures(tmp_path):
    image = pytest.importorskip("matplotlib.image")
    paths = succeed("pictures --dpi 80 -o", tmp_path / "new" / "folder").split()
    names = [*(f"picture{k}" for k in (1, 2, 3, 4)), "regimes", "convergence"]
    names += ["four_dimensions", "scattering"]
    assert paths == [str(tmp_path / "new" / "folder" / f"{name}.png") for name in names]
    assert all(min(image.imread(path).shape[:2]) > 200 for path in paths)


@pytest.mark.compiled
@pytest.mark.parametrize(
    "options", ["", "--picture 4 --eps 0.1", "--inertia 4,2,3,0,-.5,-.3 --eps .1 --omega0 1,2"]
)
def test_animate(tmp_path, options):
    pytest.importorskip("PIL")
    turned = "--orientation 0,0,30" if options else ""
    line = f"animate {options} {turned} --steps 4 --dpi 40 -o body.gif"
    assert succeed(line, folder=tmp_path) == "body.gif\n"
    assert (tmp_path / "body.gif").read_bytes().startswith(b"GIF89a")
    assert [path.name for path in tmp_path.iterdir()] == ["body.gif"]


def test_without_matplotlib(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    done = run("pictures")
    assert done.code == 1
    assert "pip install 'suslov_fast[plots]'" in done.err
