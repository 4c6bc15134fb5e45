"""The command line, as a newcomer meets it."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import suslov_fast as sf

COMMAND = [str(Path(sys.executable).with_name("suslov-fast"))]
MODULE = [sys.executable, "-m", "suslov_fast"]


def run(*arguments, command=COMMAND, folder=None, **environment):
    return subprocess.run(
        [*command, *map(str, arguments)],
        cwd=folder,
        env=os.environ | environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=120,
    )


def summary(text):
    rows = {}
    for line in text.splitlines():
        rows.setdefault(line[:16].strip(), []).append(line[16:].strip())
    return rows


@pytest.mark.parametrize("command", [COMMAND, MODULE])
def test_version_and_help(command):
    assert run("--version", command=command).stdout == f"suslov-fast {sf.__version__}\n"
    assert "{run,pictures,animate}" in run("--help", command=command).stdout
    for name in ("run", "pictures", "animate"):
        shown = run(name, "--help", command=command)
        assert shown.returncode == 0
        assert f"usage: suslov-fast {name}" in shown.stdout


@pytest.mark.compiled
def test_run_without_options(tmp_path):
    done = run("run", folder=tmp_path)
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
    assert what == "steps/s, by the closed form; --method canonical iterates"
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
    with np.load(tmp_path / "result.npz") as saved:
        result = dict(saved)
    body = sf.Suslov3D(*(result[name] for name in ("I1", "I2", "I13", "I23")))
    redone = sf.iterate(
        body,
        result["omega0"],
        result["eps"],
        int(result["steps"]),
        save_every=int(result["save_every"]),
        method=str(result["method"]),
        on_singular="ignore",
    )
    for name in ("omega", "n", "t", "final", "status", "failed_at"):
        np.testing.assert_array_equal(result[name], getattr(redone, name))
    assert result["version"] == sf.__version__
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result.npz", "starts.npy"]


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
    with np.load(tmp_path / "a.npz") as a, np.load(tmp_path / "b.npz") as b:
        assert (a["omega"] == b["omega"]).all()
        assert a["J"].tolist() == [5, 6, 7]
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
    a, b, c = (np.load(tmp_path / f"{name}.npz")["omega"] for name in "abc")
    assert (a == b).all()
    assert (a != c).all()
    assert a.shape == (5, 1, 2)


@pytest.mark.parametrize(
    "header", ["", "omega1,omega2\n", "# two columns\n", "\ufeff", "\ufeffΩ1, Ω2\n"]
)
def test_csv(tmp_path, header):
    (tmp_path / "starts.csv").write_text(header + "0.3,0.1\n1.0, 2.5e-1\n", encoding="utf-8")
    done = run(*"run --initial starts.csv --steps 0 -o o.npz".split(), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert np.load(tmp_path / "o.npz")["omega0"].tolist() == [[0.3, 0.1], [1.0, 0.25]]


BAD = [
    ("", "the following arguments are required: {run,pictures,animate}"),
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
    ("run --steps 1e3", "--steps: expected an integer of at least 0, got '1e3'"),
    ("run --trajectories 0", "--trajectories: expected an integer of at least 1, got '0'"),
    ("run --trajectories 1000000000000", "expected a batch that fits in"),
    ("run --steps 1000000000 --save-every 1", "raise --save-every or lower --trajectories"),
    ("run --steps 99999999999999999999", "--steps: expected an integer below 2**62, got '9999"),
    ("run --save-every 0", "--save-every: expected an integer of at least 1, got '0'"),
    ("run --seed -3", "--seed: expected an integer of at least 0, got '-3'"),
    ("run --threads 0", "--threads: expected an integer of at least 1, got '0'"),
    ("run --threads 100000", "--threads: expected at most"),
    ("run --method rk4", "--method: expected one of 'auto', 'canonical', 'ds2', got 'rk4'"),
    ("run --initial missing.npy", "missing.npy: expected a readable file, got: No such file"),
    ("run --initial folder.npy", "folder.npy: expected a readable file, got: Is a directory"),
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
    ("run --J 1,2 --I 1,2 --eps 0.1 --method ds2", "--method: expected one of 'auto', 'gauss'"),
    ("run --inertia good.npy --eps 0.1", "good.npy: I: expected shape (n, n), got (4, 2)"),
    ("run --inertia missing.npy --eps 0.1", "missing.npy: expected a readable file"),
    ("run --inertia good.npy", "expected all of --inertia --eps or none, got no --eps"),
    ("run --inertia three.npy --J 1 --eps 1", "expected one body, got --inertia and --J"),
    ("run -o missing/o.npz", "missing/o.npz: expected a name in a folder that can be written to"),
    ("run -o good.npy/o.npz", "good.npy/o.npz: expected a name in a folder"),
    ("run -o folder.npz", "folder.npz: expected the name of a file to write, got something else"),
    ("run -o /dev/null", "-o: expected the name of a .npz file, got '/dev/null'"),
    ("run -o result/", "-o: expected the name of a .npz file, got 'result/'"),
    ("pictures -o good.npy", "good.npy: expected a folder or a name for one, got: File exists"),
    ("pictures -o good.npy/deeper", "good.npy/deeper: expected a folder or a name for one"),
]


@pytest.fixture(scope="module")
def bad_files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bad")
    (folder / "folder.npy").mkdir()
    (folder / "folder.npz").mkdir()
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
    from suslov_fast._cli import main

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


@pytest.mark.parametrize("arguments", ["run --eps x", "run --initial missing.npy", "nonsense"])
def test_bad_input(tmp_path, arguments):
    done = run(*arguments.split(), folder=tmp_path)
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


@pytest.mark.compiled
@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_signals_leave_nothing_behind(tmp_path, name):
    result = tmp_path / "o.npz"
    run("run --method ds2")  # compiles
    process = subprocess.Popen(
        [*COMMAND, *f"run --method ds2 --steps 10000000000000 -o {result}".split()],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        while not list(tmp_path.iterdir()):
            time.sleep(0.05)
        time.sleep(1.0)
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
    assert errors.endswith("suslov-fast: interrupted\n")
    assert list(tmp_path.iterdir()) == []


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
    assert summary(done.stdout)["drift of F"] == ["0, largest relative; 2 states beyond float64"]


def test_a_link_stays(tmp_path):
    (tmp_path / "link.npz").symlink_to(tmp_path / "target.npz")
    assert (
        run(*"run --trajectories 3 --steps 3 -o link.npz".split(), folder=tmp_path).returncode == 0
    )
    assert (tmp_path / "link.npz").is_symlink()
    assert np.load(tmp_path / "target.npz")["omega"].shape == (3, 1, 2)


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
    from suslov_fast._cli import main

    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(SystemExit) as stopped:
        main(["pictures"])
    assert stopped.value.code == 2
    assert "pip install 'suslov_fast[plots]'" in capsys.readouterr().err
