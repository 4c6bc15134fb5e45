"""The command line, as a newcomer meets it."""

import contextlib
import io
import json
import os
import re
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast._cli import main

COMMAND = [str(Path(sys.executable).with_name("suslov-fast"))]
MODULE = [sys.executable, "-m", "suslov_fast"]


def in_process(*arguments, command=COMMAND, folder=None, **environment):
    """The command in a process of its own, where that is what is tested."""
    return subprocess.run(
        [*command, *map(str, arguments)],
        cwd=folder,
        env=os.environ | environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300,
    )


def run(*arguments, folder="."):
    """The same in this process, which has imported and loaded everything."""
    streams = io.StringIO(), io.StringIO()
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    before = os.getcwd()
    os.chdir(folder)
    try:
        with contextlib.redirect_stdout(streams[0]), contextlib.redirect_stderr(streams[1]):
            main([str(each) for each in arguments])
    except SystemExit as stopped:
        return SimpleNamespace(
            returncode=stopped.code, stdout=streams[0].getvalue(), stderr=streams[1].getvalue()
        )
    finally:
        os.chdir(before)
        for number, handler in handlers.items():
            signal.signal(number, handler)


def summary(text):
    rows = {}
    for line in text.splitlines():
        rows.setdefault(line[:16].strip(), []).append(line[16:].strip())
    return rows


@pytest.mark.parametrize("command", [COMMAND, MODULE])
def test_version(command):
    assert in_process("--version", command=command).stdout == f"suslov-fast {sf.__version__}\n"


def test_help():
    assert "{run,info,warm-up,pictures,animate,explore}" in run("--help").stdout
    for name in ("run", "info", "warm-up", "pictures", "animate", "explore"):
        shown = run(name, "--help")
        assert shown.returncode == 0
        assert f"usage: suslov-fast {name}" in shown.stdout


@pytest.mark.compiled
def test_run_without_options(tmp_path):
    done = in_process("run", folder=tmp_path)
    assert done.returncode == 0
    assert done.stderr == "", "no bar where there is no terminal"
    rows = summary(done.stdout)
    assert rows["body"] == ["I1 = 4, I2 = 1, I13 = -0.5, I23 = -0.3"]
    assert rows["step size"] == ["eps = 0.2"]
    assert rows["trajectories"] == ["65,536"]
    assert rows["steps"] == ["1,000"]
    assert int(rows["threads"][0]) >= 1
    assert float(rows["wall time"][0].split()[0]) > 0
    speed, what = rows["speed"][0].split(maxsplit=1)
    assert float(speed) > 1e6
    assert what == ("steps/s, by the closed form where it is faster; --method canonical iterates")
    assert float(rows["drift of F"][0].split(",")[0]) < 1e-12
    assert rows["status"] == ["65,536 OK: finished"]
    assert list(tmp_path.iterdir()) == []


def test_run_with_a_body(tmp_path):
    np.save(tmp_path / "starts.npy", [[0.3, 0.1], [1.0, -3.0], [0.5, -40.0]])
    done = run(
        *"run --I1 1 --I2 1 --I13 1 --I23 0 --eps 1 --steps 20 --initial starts.npy".split(),
        *"--save-every 5 --threads 1 --method canonical -o result.npz".split(),
        folder=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    rows = summary(done.stdout)
    assert rows["status"] == [
        f"1 {status.name}: {status.message}"
        for status in (sf.Status.OK, sf.Status.SUPERCRITICAL, sf.Status.SINGULAR)
    ]
    assert rows["written"] == ["result.npz"]
    saved = sf.Trajectories.load(tmp_path / "result.npz")
    redone = sf.iterate(
        sf.Suslov3D(1, 1, 1, 0),
        np.load(tmp_path / "starts.npy"),
        1,
        20,
        save_every=5,
        method="canonical",
        on_singular="ignore",
    )
    for name in ("omega", "n", "t", "final", "status", "failed_at", "eps"):
        np.testing.assert_array_equal(getattr(saved, name), getattr(redone, name))
    assert saved.body == redone.body
    assert (saved.method, saved.steps, saved.save_every) == ("canonical", 20, 5)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result.npz", "starts.npy"]


@pytest.mark.parametrize("suffix", [".npz", ".nc", ".zarr"])
def test_all_kinds_of_files(tmp_path, suffix):
    pytest.importorskip("netCDF4")
    pytest.importorskip("zarr")
    name = f"result{suffix}"
    arguments = "--trajectories 1e2 --steps 2e1 --save-every 10 --json".split()
    done = run("run", *arguments, "-o", name, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    facts = json.loads(done.stdout)
    saved = sf.Trajectories.load(tmp_path / name)
    assert facts["trajectories"] == saved.status.size == 100
    assert facts["steps"] == saved.steps == 20
    assert facts["saved_states"] == len(saved.omega) == 3
    assert facts["written"] == name
    F = saved.first_integral()
    assert facts["drift"] == {
        "F": {"largest": pytest.approx(abs(F / F[0] - 1).max(), abs=1e-18), "beyond_float64": 0}
    }
    assert facts["status"] == {"OK": 100}
    assert facts["body"] == {"type": "Suslov3D", "I1": 4.0, "I2": 1.0, "I13": -0.5, "I23": -0.3}
    assert facts["seconds"] > 0
    assert facts["steps_per_second"] == pytest.approx(2000 / facts["seconds"])
    told = run("info", name, "--json", folder=tmp_path)
    assert told.stderr == ""
    for key, value in json.loads(told.stdout).items():
        assert facts[key] == value, key
    rows = summary(run("info", name, folder=tmp_path).stdout)
    assert rows["saved states"] == ["3"]
    assert rows["method"] == ["auto"]
    assert rows["status"] == ["100 OK: finished"]
    assert list(rows) == [
        "body",
        "step size",
        "trajectories",
        "steps",
        "saved states",
        "method",
        "drift of F",
        "status",
        *(["tiles done"] if suffix == ".zarr" else []),
    ]


def test_info_on_a_sweep(tmp_path):
    """Bodies and step sizes that vary along different axes."""
    body = sf.Suslov3D([[4.0], [3.0], [2.0]], 1, -0.5, -0.3)
    orbits = sf.iterate(body, [1.0, 0.5], [0.1, 0.2], 30, save_every=7)
    orbits.save(tmp_path / "sweep.npz")
    rows = summary(run("info", "sweep.npz", folder=tmp_path).stdout)
    assert rows["body"] == ["I1 = 2 ... 4 (3, 1), I2 = 1, I13 = -0.5, I23 = -0.3"]
    assert rows["step size"] == ["eps = 0.1 ... 0.2 (2,)"]
    assert rows["trajectories"] == ["6"]
    facts = json.loads(run("info", "sweep.npz", "--json", folder=tmp_path).stdout)
    F = np.concatenate(
        [orbits.first_integral(), sf.first_integral(body, orbits.final, orbits.eps)[None]]
    )
    assert facts["drift"]["F"]["largest"] == abs(F / F[0] - 1).max()
    assert facts["eps"] == {"shape": [2], "min": 0.1, "max": 0.2}


def test_info_without_the_first_state(tmp_path):
    sf.iterate(sf.SuslovND([1.0, 2.0], [0.1, 0.2]), np.ones((3, 2)), 0.1, 9, save_every=None).save(
        tmp_path / "last.npz"
    )
    rows = summary(run("info", "last.npz", folder=tmp_path).stdout)
    assert "drift of E" not in rows
    assert rows["body"] == ["n = 3, J = [1. 2.], I = [0.1 0.2]"]


@pytest.mark.parametrize("picture", [1, 2, 3, 4])
def test_pictures_as_bodies(picture):
    done = run("run", "--picture", picture, "--trajectories", 10, "--steps", 10)
    assert done.returncode == 0
    assert summary(done.stdout)["trajectories"] == ["10"]


def test_run_in_n_dimensions(tmp_path):
    matrix = np.diag([1.0, 2.0, 3.0, 4.0])
    matrix[:3, 3] = matrix[3, :3] = [0.4, -0.7, 0.5]
    np.savetxt(tmp_path / "inertia.csv", matrix, delimiter=",")
    np.save(tmp_path / "starts.npy", np.ones((5, 3)))
    few = "--eps 0.2 --steps 50 --trajectories 40".split()
    of_file = run(*"run --inertia inertia.csv -o a.npz".split(), *few, folder=tmp_path)
    of_lists = run(*"run --J 5,6,7 --I 0.4,-0.7,0.5 -o b.npz".split(), *few, folder=tmp_path)
    assert of_file.returncode == 0, of_file.stderr
    rows = summary(of_file.stdout)
    assert rows["body"] == ["n = 4, J = [5. 6. 7.], I = [ 0.4 -0.7  0.5]"]
    energy, modified = (
        float(rows[name][0].split(",")[0]) for name in ("drift of E", "drift of E_mod")
    )
    assert 0 < modified < energy < 1
    a, b = (sf.Trajectories.load(tmp_path / name) for name in ("a.npz", "b.npz"))
    assert (a.omega == b.omega).all()
    assert a.body.J.tolist() == [5, 6, 7]
    assert summary(of_lists.stdout)["drift of E"] == rows["drift of E"]
    own = "--eps 0.2 --steps 50 --initial starts.npy --method gauss --save-every 10".split()
    done = run(*"run --J 5,6,7 --I -0.4,-0.7,-5e-1".split(), *own, folder=tmp_path)
    assert summary(done.stdout)["trajectories"] == ["5"]


def test_seeds(tmp_path):
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        run(
            *f"run --trajectories 5 --steps 3 --seed {seed} -o {name}.npz".split(),
            folder=tmp_path,
        )
    a, b, c = (sf.Trajectories.load(tmp_path / f"{name}.npz").omega for name in "abc")
    assert (a == b).all()
    assert (a != c).all()
    assert a.shape == (1, 5, 2)


def test_matrices_in_any_basis(tmp_path, rng):
    """Turned by any rotation, and the axis with it, a body is the same body."""
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    tensor = np.array([[4.0, 0.0, -0.5], [0.0, 1.5, -0.3], [-0.5, -0.3, 3.0]])
    np.save(tmp_path / "tensor.npy", turn @ tensor @ turn.T)
    mass = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    np.save(tmp_path / "mass.npy", turn @ mass @ turn.T)
    axis = ",".join(map(repr, map(float, turn[:, 2])))
    few = "--eps 0.1 --steps 5 --trajectories 4 --json".split()
    of_tensor, of_mass = (
        run("run", f"--{name}", file, "--axis", axis, *few, folder=tmp_path)
        for name, file in (("inertia-tensor", "tensor.npy"), ("inertia", "mass.npy"))
    )
    assert of_tensor.returncode == 0, of_tensor.stderr
    facts = json.loads(of_tensor.stdout)
    assert sorted([facts["body"]["I1"], facts["body"]["I2"]]) == pytest.approx([1.5, 4.0])
    rotation = np.array(facts["rotation"])
    assert rotation @ turn[:, 2] == pytest.approx([0, 0, 1], abs=1e-14)
    assert sorted(json.loads(of_mass.stdout)["body"]["J"]) == pytest.approx([1.5, 4.0])
    told = run("run", "--inertia", "mass.npy", "--axis", axis, *few[:-1], folder=tmp_path)
    assert "adapted basis" in summary(told.stdout)["rotation"][0]


def test_the_axis_is_the_last_unless_given(tmp_path):
    tensor = np.array([[4.0, 0.0, -0.5], [0.0, 1.5, -0.3], [-0.5, -0.3, 3.0]])
    np.savetxt(tmp_path / "tensor.csv", tensor, delimiter=",")
    done = run(
        *"run --inertia-tensor tensor.csv --eps -0.1 --steps 5 --trajectories 4".split(),
        folder=tmp_path,
    )
    rows = summary(done.stdout)
    assert rows["body"] == ["I1 = 4, I2 = 1.5, I13 = -0.5, I23 = -0.3"]
    assert "rotation" not in rows


@pytest.mark.parametrize(
    "header", ["", "omega1,omega2\n", "# two columns\n", "\ufeff", "\ufeffΩ1, Ω2\n"]
)
def test_csv(tmp_path, header):
    (tmp_path / "starts.csv").write_text(header + "0.3,0.1\n1.0, 2.5e-1\n", encoding="utf-8")
    done = run(*"run --initial starts.csv --steps 0 -o o.npz".split(), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert sf.Trajectories.load(tmp_path / "o.npz").final.tolist() == [[0.3, 0.1], [1.0, 0.25]]


BAD = [
    ("", "the following arguments are required: {run,info,warm-up,pictures,animate,explore}"),
    ("walk", "invalid choice: 'walk'"),
    ("run --speed 3", "unrecognized arguments: --speed 3"),
    ("run --picture 5", "--picture: expected 1, 2, 3 or 4, got '5'"),
    ("run --picture one", "--picture: expected 1, 2, 3 or 4, got 'one'"),
    ("run --I1 4", "expected all of --I1 --I2 --I13 --I23 --eps or none, got no --I2 --I13"),
    ("run --I1 4 --I2 1 --I13 1 --I23 1", "got no --eps"),
    ("run --picture 1 --I1 4", "expected one body, got --picture and --I1"),
    ("run --I1 0 --I2 1 --I13 1 --I23 1 --eps 1", "--I1: expected a positive number, got '0'"),
    ("run --I1 x --I2 1 --I13 1 --I23 1 --eps 1", "--I1: expected a positive number, got 'x'"),
    ("run --eps nan", "--eps: expected a finite number, got 'nan'"),
    ("run --eps", "--eps: expected one argument"),
    ("run --steps -1", "--steps: expected an integer of at least 0, got '-1'"),
    ("run --steps 1.5", "--steps: expected an integer of at least 0, got '1.5'"),
    ("run --steps 1e-3", "--steps: expected an integer of at least 0, got '1e-3'"),
    ("run --steps nan", "--steps: expected an integer of at least 0, got 'nan'"),
    ("run --steps inf", "--steps: expected an integer of at least 0, got 'inf'"),
    ("run --steps -1e999999999", "--steps: expected an integer of at least 0, got '-1e9"),
    ("run --steps 1e999999999", "--steps: expected an integer below 2**62, got '1e9999"),
    ("run --steps 1e-999999999", "--steps: expected an integer of at least 0, got '1e-9"),
    ("run --step 3", "unrecognized arguments: --step 3"),
    ("run --trajectories 0", "--trajectories: expected an integer of at least 1, got '0'"),
    ("run --trajectories 1000000000000", "expected arrays that fit in memory"),
    ("run --steps 1000000000 --save-every 1", "raise --save-every or lower --trajectories"),
    ("run --steps 99999999999999999999", "--steps: expected an integer below 2**62, got '9999"),
    ("run --save-every 0", "--save-every: expected an integer of at least 1, got '0'"),
    ("run --seed -3", "--seed: expected an integer of at least 0, got '-3'"),
    ("run --threads 0", "--threads: expected an integer of at least 1, got '0'"),
    ("run --threads 100000", "--threads: expected at most"),
    ("run --method rk4", "method: expected one of 'auto', 'canonical', 'ds2', got 'rk4'"),
    ("run --initial missing.npy", "missing.npy: expected a readable file, got: No such file"),
    ("run --initial folder.npy", "folder.npy: expected a readable file, got a folder"),
    ("run --initial fifo.csv", "fifo.csv: expected a readable file, got a FIFO"),
    ("run --initial fifo.npy", "fifo.npy: expected a readable file, got a FIFO"),
    ("run --initial loop.npy", "loop.npy: expected a readable file, got: Too many levels"),
    ("run --initial starts.txt", "starts.txt: expected a .npy or .csv file, got '.txt'"),
    ("run --initial three.npy", "three.npy: states: expected shape (..., 2), got (4, 3)"),
    ("run --initial flat.npy", "flat.npy: expected 2 columns, got an array of shape (4,)"),
    ("run --initial complex.npy", "complex.npy: states: expected real numbers"),
    ("run --initial objects.npy", "save writes it, got: Object arrays cannot be loaded"),
    ("run --initial nan.csv", "nan.csv: states: expected finite real numbers, got nan at index"),
    ("run --initial words.csv", "words.csv: could not convert string 'b'"),
    ("run --initial typo.csv", "typo.csv: could not convert string '1.O'"),
    ("run --initial blank.csv", "blank.csv: could not convert string ''"),
    ("run --initial semicolon.csv", "semicolon.csv: could not convert string '0.3;0.1'"),
    ("run --initial nanhead.csv", "nanhead.csv: states: expected finite real numbers, got nan"),
    ("run --initial huge.npy", "huge.npy: expected a .npy file as numpy.save writes it"),
    ("run --initial torn.npy", "torn.npy: expected a .npy file as numpy.save writes it"),
    ("run --initial ragged.csv", "ragged.csv: the number of columns changed from 2 to 1"),
    ("run --initial binary.csv", "binary.csv:"),
    ("run --initial empty.csv", "empty.csv: expected at least one state, got none"),
    ("run --initial empty.npy", "empty.npy: expected a .npy file as numpy.save writes it"),
    ("run --initial cut.npy", "cut.npy:"),
    ("run --initial good.npy --trajectories 3", "expected either --initial or --trajectories"),
    ("run --initial good.npy --seed 3", "expected either --initial or --seed, got both"),
    ("run --J 1,2,3 --eps 0.1", "expected all of --J --I --eps or none, got no --I"),
    ("run --J 1,2,3 --I 1,2 --eps 0.1", "expected shapes (..., n - 1) with the same n > 1"),
    ("run --J 1,-2 --I 1,2 --eps 0.1", "J: expected positive sums I_ii + I_nn, got -2.0"),
    ("run --J 1,x --I 1,2 --eps 0.1", "--J: expected a finite number, got 'x'"),
    ("run --J 1,2 --I 1,2 --eps 0.1 --method ds2", "method: expected one of 'auto', 'gauss'"),
    ("run --inertia good.npy --eps 0.1", "good.npy: expected an n x n matrix, got an array of"),
    (
        "run --inertia tensors.npy --eps 0.1",
        "expected an n x n matrix, got an array of shape (2, 3",
    ),
    (
        "run --inertia-tensor four.npy --eps 1",
        "four.npy: I: expected shape (..., 3, 3), got (4, 4)",
    ),
    ("run --inertia-tensor cube.npy --eps 1 --axis 0,0", "cube.npy: a: expected shape (..., 3)"),
    ("run --inertia-tensor cube.npy --eps 1 --axis 0,0,0", "cube.npy: a: expected an axis other"),
    ("run --inertia cube.npy --eps 1 --axis 1,2", "cube.npy: a: expected shape (..., 3), got (2,)"),
    ("run --inertia cube.npy --eps 1 --axis x", "--axis: expected a finite number, got 'x'"),
    ("run --inertia cube.npy --inertia-tensor cube.npy --eps 1", "got --inertia and --inertia-te"),
    ("run --inertia-tensor cube.npy", "expected all of --inertia-tensor --eps or none, got no --"),
    ("run --axis 1,2,3", "expected --axis only with --inertia or --inertia-tensor, got it alone"),
    ("run --J 1,2 --I 1,2 --eps 1 --axis 1,2,3", "expected --axis only with --inertia or"),
    ("run --inertia missing.npy --eps 0.1", "missing.npy: expected a readable file"),
    ("run --inertia good.npy", "expected all of --inertia --eps or none, got no --eps"),
    ("run --inertia three.npy --J 1 --eps 1", "expected one body, got --inertia and --J"),
    ("run -o missing/o.npz", "missing/o.npz: expected a name in a folder that can be written to"),
    ("run -o good.npy/o.npz", "good.npy/o.npz: expected a name in a folder"),
    ("run -o folder.npz", "folder.npz: expected the name of a file to write, got a folder"),
    ("run -o folder.nc", "folder.nc: expected the name of a file to write, got a folder"),
    ("run -o folder.zarr", "folder.zarr: expected the name of a Zarr store to write, got another"),
    ("run -o file.zarr", "file.zarr: expected the name of a Zarr store to write, got a file"),
    ("run -o fifo.npz", "fifo.npz: expected the name of a file to write, got a FIFO"),
    ("run -o loop.npz", "loop.npz: expected a name in a folder that can be written to, got: Too m"),
    (f"run -o {'x' * 300}.npz", "got: File name too long"),
    ("run -o /dev/null", "-o: expected the name of a .npz, .nc or .zarr file, got '/dev/null'"),
    ("run -o result/", "-o: expected the name of a .npz, .nc or .zarr file, got 'result/'"),
    ("run -o .npz", "-o: expected the name of a .npz, .nc or .zarr file, got '.npz'"),
    ("run -o good.npy", "-o: expected the name of a .npz, .nc or .zarr file, got 'good.npy'"),
    ("info", "the following arguments are required: FILE"),
    ("info good.npy", "FILE: expected the name of a .npz, .nc or .zarr file, got 'good.npy'"),
    ("info missing.npz", "missing.npz: expected a readable file, got: No such file or directory"),
    ("info missing.nc", "missing.nc: expected a readable file, got: No such file or directory"),
    ("info missing.zarr", "missing.zarr: expected a readable file, got: No such file or direct"),
    ("info folder.npz", "folder.npz: expected a .npz file that Trajectories.save wrote"),
    ("info folder.nc", "folder.nc: expected a .nc file that Trajectories.save wrote"),
    ("info folder.zarr", "folder.zarr: expected a .zarr file that Trajectories.save wrote"),
    ("info loop.npz", "loop.npz: expected a readable file, got: Too many levels"),
    ("info other.npz", "other.npz: expected a run that Trajectories.save or to_xarray wrote"),
    ("warm-up now", "unrecognized arguments: now"),
    ("pictures -o good.npy", "good.npy: expected a folder or a name for one, got: File exists"),
    ("pictures -o good.npy/deeper", "good.npy/deeper: expected a folder or a name for one"),
]


@pytest.fixture(scope="module")
def bad_files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bad")
    (folder / "folder.npy").mkdir()
    for suffix in ("npz", "nc", "zarr"):
        (folder / f"folder.{suffix}").mkdir()
    (folder / "folder.zarr" / "thesis.tex").touch()
    (folder / "file.zarr").touch()
    for suffix in ("npz", "npy", "csv"):
        os.mkfifo(folder / f"fifo.{suffix}")
        (folder / f"loop.{suffix}").symlink_to(f"loop.{suffix}")
    np.savez(folder / "other.npz", omega=np.ones(3))
    np.save(folder / "four.npy", np.eye(4))
    np.save(folder / "cube.npy", np.eye(3))
    np.save(folder / "tensors.npy", np.stack([np.eye(3)] * 2))
    np.save(folder / "good.npy", np.ones((4, 2)))
    np.save(folder / "three.npy", np.ones((4, 3)))
    np.save(folder / "flat.npy", np.ones(4))
    np.save(folder / "complex.npy", np.ones((4, 2)) * 1j)
    np.save(folder / "objects.npy", np.array([[1, "a"]], dtype=object))
    (folder / "starts.txt").write_text("1,2\n")
    (folder / "nan.csv").write_text("1,2\n3,nan\n")
    (folder / "words.csv").write_text("1,2\n3,b\n")
    (folder / "typo.csv").write_text("1.O,2.0\n0.4,0.2\n")
    (folder / "blank.csv").write_text(",0.1\n0.4,0.2\n")
    (folder / "semicolon.csv").write_text("0.3;0.1\n0.4;0.2\n")
    (folder / "nanhead.csv").write_text("nan,0.1\n0.4,0.2\n")
    good = (folder / "good.npy").read_bytes()
    (folder / "huge.npy").write_bytes(good.replace(b"(4, 2), }     ", b"(10**9, 2), } "))
    (folder / "torn.npy").write_bytes(good.replace(b"}", b" "))
    (folder / "ragged.csv").write_text("1,2\n3\n")
    (folder / "binary.csv").write_bytes(bytes(range(256)))
    (folder / "empty.csv").write_text("")
    (folder / "empty.npy").write_text("")
    (folder / "cut.npy").write_bytes((folder / "good.npy").read_bytes()[:100])
    return folder


@pytest.mark.parametrize(("arguments", "message"), BAD)
def test_bad_input_in_this_process(bad_files, monkeypatch, capsys, arguments, message):
    """One line, exit status 2, nothing written."""
    monkeypatch.chdir(bad_files)
    before = sorted(bad_files.iterdir())
    with pytest.raises(SystemExit) as stopped:
        main(arguments.split())
    assert stopped.value.code == 2
    output, errors = capsys.readouterr()
    assert output == ""
    assert errors.startswith("suslov-fast: ")
    assert message in errors
    assert errors.count("\n") == 1
    assert sorted(bad_files.iterdir()) == before


def test_bad_input(tmp_path):
    done = in_process(*"run --initial missing.npy".split(), folder=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert "Traceback" not in done.stderr


def test_an_existing_result_survives_a_failure(tmp_path):
    result = tmp_path / "o.npz"
    result.write_text("precious")
    done = run("run", "--initial", tmp_path / "missing.npy", "-o", result)
    assert done.returncode == 2
    assert result.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [result]


def test_warm_up_calls_everything(monkeypatch, capsys):
    """Every public function, on few and on many states."""
    from suslov_fast._cli import warm_up as module

    called = set()

    def watched(name):
        function = getattr(sf, name)

        def call(*arguments, **settings):
            called.add((name, module._MANY in sizes))
            return function(*arguments, **settings)

        return call

    sizes = set()
    starts = module._starts
    monkeypatch.setattr(module, "_MANY", 4)
    monkeypatch.setattr(
        module, "_starts", lambda count, body: (sizes.add(count), starts(count, body))[1]
    )
    # What pictures and stores are made of is called by itself, and matrices have no kernel.
    without = ("plot", "animate", "ensemble", "open", "to_matrix", "from_matrix", "to_vector")
    without += ("from_vector", "momentum")
    functions = {name for name in sf.__all__ if name.islower() and not name.startswith(without)}
    watching = SimpleNamespace(**vars(sf) | {name: watched(name) for name in functions})
    monkeypatch.setattr(module, "sf", watching)
    with pytest.raises(SystemExit) as stopped:
        main(["warm-up"])
    assert stopped.value.code == 0
    assert capsys.readouterr().out.startswith("compiled in ")
    assert called == {(name, many) for name in functions for many in (False, True)}


@pytest.mark.compiled
@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_signals_leave_nothing_behind(tmp_path, name):
    result = tmp_path / "o.npz"
    few = "run --method ds2 --trajectories 1 --threads 1 --steps".split()
    assert run(*few, 1000).returncode == 0  # compiles
    process = subprocess.Popen(
        [*COMMAND, *few, "10000000000000", "-o", result],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        while not list(tmp_path.iterdir()):
            time.sleep(0.05)
        time.sleep(0.5)
        # Python drops an exception in a callback of the compiler, which loading code calls too: a
        # user would press Ctrl-C again.
        for _ in range(5):
            process.send_signal(getattr(signal, name))
            with contextlib.suppress(subprocess.TimeoutExpired):
                _, errors = process.communicate(timeout=6)
                break
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == 130
    assert re.search(
        rf"suslov-fast: interrupted while (compiling|iterating); {result} was not written\n$",
        errors,
    )
    assert list(tmp_path.iterdir()) == []


def interrupted(monkeypatch, capsys, name, *arguments):
    """What is said if Ctrl-C comes when a function of the run is called."""
    from suslov_fast._cli import run as module

    def interrupt(*args, **kwargs):
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(module, name, interrupt)
    with pytest.raises(SystemExit) as stopped:
        main(["run", "--trajectories", "5", "--steps", "5", *map(str, arguments)])
    assert stopped.value.code == 130
    output, errors = capsys.readouterr()
    assert output == ""
    return errors


def test_ctrl_c_while_checking_loses_nothing(tmp_path, monkeypatch, capsys):
    path = tmp_path / "o.npz"
    path.write_text("of another run")
    errors = interrupted(monkeypatch, capsys, "outcome_of", "-o", path)
    assert errors == f"suslov-fast: interrupted while checking; {path} was written before\n"
    assert sf.Trajectories.load(path).status.shape == (5,)


def test_ctrl_c_while_checking_what_is_not_written(monkeypatch, capsys):
    errors = interrupted(monkeypatch, capsys, "outcome_of")
    assert errors == "suslov-fast: interrupted while checking\n"


@pytest.mark.parametrize(("name", "phase"), [("_warm_up", "compiling"), ("_bar", "iterating")])
def test_ctrl_c_before_anything_is_written(tmp_path, monkeypatch, capsys, name, phase):
    errors = interrupted(monkeypatch, capsys, name, "-o", tmp_path / "o.npz")
    path = tmp_path / "o.npz"
    assert errors == f"suslov-fast: interrupted while {phase}; {path} was not written\n"
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_while_writing(tmp_path, monkeypatch, capsys):
    from suslov_fast._cli import files

    def interrupt(*args, **kwargs):
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(files, "entries_of", interrupt)
    (tmp_path / "o.npz").write_text("precious")
    errors = interrupted(monkeypatch, capsys, "outcome_of", "-o", tmp_path / "o.npz")
    assert errors.endswith(f"interrupted while writing; {tmp_path / 'o.npz'} was not written\n")
    assert (tmp_path / "o.npz").read_text() == "precious"
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
def test_ctrl_c_while_the_package_is_imported(tmp_path):
    (tmp_path / "numba.py").write_text(
        "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(60)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", "from suslov_fast_command import main; main()"],
        env=os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{Path(sf.__file__).parents[1]}"},
        capture_output=True,
        text=True,
        timeout=50,
    )
    assert done.returncode == 130
    assert done.stderr == "suslov-fast: interrupted\n"


def test_the_entry_point():
    code = "import sys; sys.argv[1:] = ['--version']; import suslov_fast_command as c; c.main()"
    folder = str(Path(sf.__file__).parents[1])
    done = in_process(command=[sys.executable, "-c", code], PYTHONPATH=folder)
    assert done.stdout == f"suslov-fast {sf.__version__}\n"


@pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal")
def test_phases_are_announced_on_a_terminal(tmp_path):
    import pty

    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [*COMMAND, *"run --trajectories 5 --steps 5 -o o.npz".split()],
        cwd=tmp_path,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=theirs,
    )
    os.close(theirs)
    output, _ = process.communicate(timeout=120)
    shown = b""
    with contextlib.suppress(OSError):  # the other end is closed
        while some := os.read(ours, 4096):
            shown += some
    os.close(ours)
    assert process.returncode == 0
    said = [line for line in shown.decode().split("\n") if line.startswith("suslov-fast: ")]
    phases = ["compiling", "iterating", "writing", "checking"]
    assert [line.strip().removeprefix("suslov-fast: ") for line in said] == phases
    assert b"suslov-fast: " not in output


@pytest.mark.parametrize("value", ["-1e-3", "-.5", "-5.", "-0.25"])
def test_negative_numbers(value):
    done = run("run", "--eps", value, "--trajectories", 5, "--steps", 5)
    assert done.returncode == 0, done.stderr
    assert summary(done.stdout)["step size"] == [f"eps = {float(value):g}"]


def test_drift_is_that_of_the_saved_states(tmp_path):
    """Next to a pole F is lost to rounding, and the summary says so."""
    np.save(tmp_path / "starts.npy", [[1.0, -3.0 + 1e-9], [0.0, 0.0]])
    body = "--I1 1 --I2 1 --I13 1 --I23 0 --eps 1 --initial starts.npy".split()
    done = run("run", *body, *"--steps 3 --save-every 1".split(), folder=tmp_path)
    drift = float(summary(done.stdout)["drift of F"][0].split(",")[0])
    orbit = sf.iterate(sf.Suslov3D(1, 1, 1, 0), [1.0, -3.0 + 1e-9], 1, 3)
    F = orbit.first_integral()
    assert drift == pytest.approx(abs(F / F[0] - 1).max(), rel=0.1)
    assert drift > 0


def test_drift_beyond_float64(tmp_path):
    (tmp_path / "starts.csv").write_text("1e160,2\n1,2\n")
    body = "--I1 1 --I2 1 --I13 0 --I23 0 --eps 1 --initial starts.csv".split()
    done = run("run", *body, "--steps", 3, folder=tmp_path)
    assert done.stderr == ""
    assert summary(done.stdout)["drift of F"] == ["0, largest relative; beyond float64: 1"]


@pytest.mark.compiled
def test_the_run_is_computed_once(monkeypatch):
    """And is not longer than it must be: what is called before are parts of it."""
    from suslov_fast._cli import run as module

    called, seconds = [], [0.0]

    def counting(body, omega0, eps, steps, **settings):
        called.append((len(omega0), steps))
        seconds[0] += len(omega0) * steps / 2e8  # on a clock of its own
        return sf.iterate(body, omega0, eps, steps, **settings)

    monkeypatch.setattr(module, "iterate", counting)
    monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=lambda: seconds[0]))
    run(*"run --trajectories 1e5 --steps 2000 --method canonical".split())
    assert called.count((100_000, 2000)) == 1
    assert sum(count * steps for count, steps in called) < 1.5 * 100_000 * 2000


def test_the_drift_of_a_batch_that_is_checked_in_portions(monkeypatch, rng):
    from suslov_fast._cli import summary as module

    body = sf.SuslovND([1.0, 2.0, 3.0], [0.4, -0.7, 0.5])
    orbits = sf.iterate(body, rng.normal(size=(7, 3)), 0.3, 11, save_every=2)
    E = np.concatenate([orbits.energy(), sf.energy(body, orbits.final)[None]])
    for portion in (1, 3, 7, 10, 20, 10**6):
        monkeypatch.setattr(module, "_PORTION", portion)
        drift = module.outcome_of(orbits, orbits.omega[0])["drift"]
        assert drift["E"] == {"largest": abs(E / E[0] - 1).max(), "beyond_float64": 0}


@pytest.mark.skipif(os.name != "posix", reason="needs links")
def test_links(tmp_path):
    (tmp_path / "link.npz").symlink_to(tmp_path / "target.npz")
    few = "run --trajectories 3 --steps 3 -o".split()
    assert run(*few, "link.npz", folder=tmp_path).returncode == 0
    assert (tmp_path / "link.npz").is_symlink()
    assert sf.Trajectories.load(tmp_path / "target.npz").omega.shape == (1, 3, 2)
    os.link(tmp_path / "target.npz", tmp_path / "hard.npz")
    (tmp_path / "hard.npz").chmod(0o600)
    rows = summary(run(*few, "hard.npz", folder=tmp_path).stdout)
    assert rows["written"] == ["hard.npz, under this name alone: its hard links keep what they had"]
    assert stat.S_IMODE((tmp_path / "hard.npz").stat().st_mode) == 0o600
    assert not (tmp_path / "hard.npz").samefile(tmp_path / "target.npz")


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX names")
def test_names_that_the_terminal_cannot_show(tmp_path):
    ascii_only = {"PYTHONIOENCODING": "ascii", "LC_ALL": "C", "PYTHONUTF8": "0"}
    # Read as bytes: Python takes no encoding from a locale that has none.
    names = {"ü.npz": r"\udcc3\udcbc.npz", os.fsdecode(b"\xff.npz"): r"\udcff.npz"}
    code = """
import contextlib, sys
from suslov_fast._cli import main
for name in sys.argv[1:]:
    for arguments in (["--trajectories", "3", "--steps", "3", "-o", name],
                      ["--initial", f"{name}.npy"]):
        with contextlib.suppress(SystemExit):
            main(["run", *arguments])
"""
    done = in_process(*names, command=[sys.executable, "-c", code], folder=tmp_path, **ascii_only)
    assert done.returncode == 0, done.stderr
    assert summary(done.stdout)["written"] == list(names.values())
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    errors = done.stderr.splitlines()
    for line, shown in zip(errors, names.values(), strict=True):
        assert line.startswith(f"suslov-fast: {shown}.npy: expected a readable file")


@pytest.mark.skipif(os.name != "posix", reason="removes a folder in use")
@pytest.mark.parametrize("arguments", ["run -o o.npz", "run -o o.zarr", "run --initial s.npy"])
def test_a_deleted_working_directory(tmp_path, monkeypatch, capsys, arguments):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(SystemExit) as stopped:
        main(arguments.split())
    assert stopped.value.code == 2
    errors = capsys.readouterr().err
    assert errors.startswith(f"suslov-fast: {arguments.split()[-1]}: expected a")
    assert "got: No such file or directory" in errors
    assert errors.count("\n") == 1


@pytest.mark.compiled
@pytest.mark.skipif(os.name != "posix", reason="limits a process")
@pytest.mark.parametrize("suffix", [".npz", ".nc"])
def test_a_disk_that_is_full(tmp_path, suffix):
    """What was there stays, and nothing is left beside it."""
    import resource

    path = tmp_path / f"o{suffix}"
    few = "run --trajectories 100 --steps 3 -o".split()
    assert run(*few, path).returncode == 0
    before = sf.Trajectories.load(path).final
    limit = 2**16
    done = subprocess.run(
        [*COMMAND, *"run --trajectories 2e4 --seed 1 --steps 3 -o".split(), path],
        capture_output=True,
        text=True,
        timeout=120,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith(f"suslov-fast: {path}: could not be written: ")
    assert done.stderr.count("\n") == 1
    assert (sf.Trajectories.load(path).final == before).all()
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("closed", [">&-", "2>&-"])
def test_closed_streams(tmp_path, closed):
    done = subprocess.run(
        ["sh", "-c", f"'{COMMAND[0]}' run --trajectories 5 --steps 5 -o o.npz {closed}"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0
    assert "Traceback" not in done.stderr
    assert (tmp_path / "o.npz").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_reported():
    done = subprocess.run(
        ["sh", "-c", f"'{COMMAND[0]}' run --trajectories 10 --steps 1 > /dev/full"],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2
    assert done.stderr == "suslov-fast: standard output: No space left on device\n"


def test_a_closed_pipe_is_no_traceback():
    done = subprocess.run(
        ["sh", "-c", f"'{COMMAND[0]}' run --trajectories 10 --steps 1 | true"],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.stderr == ""


@pytest.mark.compiled
def test_pictures(tmp_path):
    matplotlib_image = pytest.importorskip("matplotlib.image")
    done = run("pictures", "-o", tmp_path / "new" / "folder")
    assert done.returncode == 0, done.stderr
    names = [f"picture{k}.png" for k in (1, 2, 3, 4)] + [
        "regimes.png",
        "convergence.png",
        "four_dimensions.png",
        "scattering.png",
    ]
    assert done.stdout.split() == [str(tmp_path / "new" / "folder" / name) for name in names]
    assert sorted(path.name for path in (tmp_path / "new" / "folder").iterdir()) == sorted(names)
    for name in names:
        picture = matplotlib_image.imread(tmp_path / "new" / "folder" / name)
        assert min(picture.shape[:2]) > 600
        if name == "scattering.png":
            continue
        red = (picture[..., 0] > 0.8) & (picture[..., 1] < 0.2) & (picture[..., 2] < 0.4)
        assert red.sum() > 800, "the line of steady states"


def test_pictures_without_matplotlib(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(SystemExit) as stopped:
        main(["pictures"])
    assert stopped.value.code == 2
    assert "pip install 'suslov_fast[plots]'" in capsys.readouterr().err
