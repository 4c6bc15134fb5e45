"""Maps and bodies of a user's own: each function is right for them, or refuses them."""

import dataclasses
import itertools
import json
import pickle
import re

import children
import numpy as np
import own
import pytest

import suslov_fast as sf
from suslov_fast import compiled, ensemble, iterate, maps
from suslov_fast.command import main
from suslov_fast.engine import threads
from suslov_fast.engine.arguments import by_field
from suslov_fast.engine.stretches import Steps
from suslov_fast.formulas import KAHAN, Formula

HENON = sf.QuadraticField.from_hamiltonian(
    lambda x: sum(each**2 for each in x) / 2 + x[0] ** 2 * x[1] - x[1] ** 3 / 3, 4
)
START = np.array([[0.1, -0.2, 0.3, 0.1], [0.2, 0.1, -0.1, 0.2], [np.nan, 0, 0, 0], [9, 9, 9, 9.0]])
SLEIGHS, SPEEDS = own.Sleigh([1.0, 2.0, 3.0], 1.5, 0.4), [[1.0, 0.5]] * 3


@pytest.fixture(autouse=True)
def _registered(monkeypatch):
    monkeypatch.setattr(maps, "MAPS", dict(maps.MAPS))
    maps.register(own.MIDPOINT)
    maps.register(own.SLEIGH)


def midpoint(eps=0.1, steps=40, **options):
    return iterate(HENON, START, eps, steps, method="midpoint", on_singular="ignore", **options)


def test_states_of_another_discretization():
    run, x = midpoint(), START[:2].copy()
    for state in run.x[:, :2]:
        np.testing.assert_allclose(state, x, rtol=1e-13)
        x = x + 0.1 * HENON(x + 0.05 * HENON(x))
    assert run.status.tolist() == [0, 0, sf.Status.NONFINITE, sf.Status.NONFINITE]
    assert run.failed_at[2] == 0
    assert 0 < run.failed_at[3] <= 40
    assert np.isnan(run.x[run.failed_at[3] :, 3]).all()
    assert np.isfinite(run.x[: run.failed_at[3], 3]).all()


def test_cuts_threads_and_batches_change_no_bit(monkeypatch):
    whole = midpoint()
    for every, cuts in itertools.product((1, 7, None), ((20, 20), (0, 1, 28, 11), (33, 0, 7))):
        run = midpoint(steps=cuts[0], save_every=every)
        for more in cuts[1:]:
            run = run.extend(more, on_singular="ignore")
        assert run == midpoint(save_every=every)
        np.testing.assert_array_equal(run.x, whole.x[run.n])
    alone = iterate(HENON, START[1], 0.1, 40, method="midpoint")
    np.testing.assert_array_equal(alone.x, whole.x[:, 1])
    monkeypatch.setattr(threads, "CROSSOVER", 0)
    assert midpoint(threads=2) == whole


def test_a_run_has_the_quantities_of_its_map_alone(tmp_path, capsys):
    """Kahan's modified energy is none of the midpoint rule, which has no drift."""
    run = iterate(HENON, START[:2], 0.1, 40, method="midpoint")
    assert run.map is own.MIDPOINT
    np.testing.assert_array_equal(run.energy(), sf.energy(HENON, run.x))
    assert {"energy"} == {"energy", "modified_energy", "first_integral"} & {*dir(run)}
    with pytest.raises(TypeError, match="Explicit midpoint rule, which has no modified_energy"):
        run.modified_energy()
    with pytest.raises(TypeError, match=r"^attitude: .* no orientation"):
        midpoint(attitude=True)
    assert run.to_xarray().title == run.to_xarray().attrs["title"] == "Explicit midpoint rule"
    axes = run.plot()
    assert axes.get_title().startswith("Explicit midpoint rule")
    assert len(axes.figure.axes) == 1  # no bar of levels of a quantity
    kahan = iterate(HENON, START[:2], 0.1, 40)
    assert kahan != run
    assert "modified_energy" in dir(kahan)
    assert (sf.step(HENON, START[0], 0.1) == kahan.x[1, 0]).all()  # functions are of "auto"
    path, body = tmp_path / "run.npz", tmp_path / "body.json"
    body.write_text(json.dumps(HENON.to_dict()))
    given = f"run --body {body} --eps 0.1 --steps 9 --trajectories 3 --method midpoint --json"
    assert main([*given.split(), "-o", str(path)]) == 0
    assert json.loads(capsys.readouterr().out)["drift"] == {}
    assert sf.Trajectories.load(path).map is own.MIDPOINT


def test_files_name_the_map(tmp_path):
    run, path = midpoint(), tmp_path / "run.npz"
    run.save(path)
    loaded = sf.Trajectories.load(path)
    assert loaded == run
    assert loaded.map is own.MIDPOINT
    assert loaded.extend(3, on_singular="ignore") == midpoint(steps=43)
    again = pickle.loads(pickle.dumps(run))
    assert again == run
    assert again.map is own.MIDPOINT
    code = "import sys, suslov_fast as sf; sf.Trajectories.load(sys.argv[1])"
    done = children.attempt(code, path)
    assert done.returncode == 1
    assert re.search(
        r"map: expected .*a map that `maps.register` made known.*'midpoint'", done.stderr
    )


def test_stores_hold_the_map(tmp_path):
    pytest.importorskip("zarr")
    store = tmp_path / "runs.zarr"
    data = ensemble(HENON, START, 0.1, 40, store=store, method="midpoint", save_every=10)
    np.testing.assert_array_equal(data.x, midpoint(save_every=10).x)
    assert data.attrs["map"] == "midpoint"
    with pytest.raises(ValueError, match="map: Kahan, the store has midpoint"):
        ensemble(HENON, START, 0.1, 40, store=store, save_every=10)


def test_a_body_that_turns_nothing(tmp_path):
    run, path = iterate(SLEIGHS, SPEEDS, 0.3, 50), tmp_path / "run.npz"
    suslov = sf.Suslov3D(SLEIGHS.mass, 1.5 + 0.16 * SLEIGHS.mass, 0, -0.4 * SLEIGHS.mass)
    assert abs(run.omega - iterate(suslov, SPEEDS, 0.3, 50).omega).max() < 1e-14
    assert run.extend(5) == iterate(SLEIGHS, SPEEDS, 0.3, 55)
    run.save(path)
    assert sf.Trajectories.load(path) == run
    assert type(sf.body_from_dict(SLEIGHS.to_dict())) is own.Sleigh
    for f in (sf.matrix, sf.jacobian):
        np.testing.assert_array_equal(f(SLEIGHS, SPEEDS, 0.3), f(SLEIGHS.field(), SPEEDS, 0.3))
    rates = (sf.lyapunov_exponents(body, SPEEDS, 0.3, 9) for body in (SLEIGHS, SLEIGHS.field()))
    np.testing.assert_array_equal(*rates)
    np.testing.assert_allclose(run.energy()[0], sf.energy(suslov, SPEEDS), rtol=1e-15)
    constants, state = compiled.system(SLEIGHS[0], 0.3), np.array(SPEEDS[0])
    assert compiled.step_system(constants, state, state, compiled.work(constants)) == 0
    np.testing.assert_allclose(state, run.omega[1, 0], rtol=1e-15)
    with pytest.raises(TypeError, match=r"attitude: .*no orientation"):
        iterate(SLEIGHS, SPEEDS, 0.3, 5, attitude=True)
    refused = (
        "to_xy closed_form first_integral reaction to_matrix to_vector momentum attitude".split()
    )
    for name in (*refused, "exact", "limits", "flow"):
        given = (SPEEDS,) if name.startswith(("to_", "momentum")) else (SPEEDS, 0.3)
        given = (*given, 3) if name == "exact" else given
        with pytest.raises(TypeError, match=r"^body: expected Suslov3D.*got Sleigh"):
            getattr(sf, name)(SLEIGHS, *given)
    for f in (compiled.frame, sf.plot_phase):
        with pytest.raises(TypeError, match=r"^body: expected Suslov3D.*got Sleigh"):
            f(SLEIGHS[0], 0.3, *(2.0,) * (f is sf.plot_phase))
    with pytest.raises(TypeError, match=r"^body: .*got Sleigh"):
        sf.scattering_angle(SLEIGHS)


def test_compiled_steps_are_those_of_the_map_or_refused():
    class Midpoint(own.Sleigh):
        """A sleigh with the steps of another map."""

    methods = {"auto": Steps(own.midpoint_steps, by_field)}
    maps.register(dataclasses.replace(own.SLEIGH, name="new", body=Midpoint, methods=methods))
    with pytest.raises(TypeError, match=r"^body: expected .*compiled steps, got Midpoint: Sleigh"):
        compiled.system(Midpoint(1.0, 1.5, 0.4), 0.1)


def test_exponents_of_a_map_with_a_jacobian(monkeypatch):
    """Those of Kahan's map by its formula of the Jacobian alone, and of the midpoint rule."""

    class Alone(own.Sleigh):
        """A sleigh of which nothing but the Jacobian is known."""

    class Midpoint(own.Sleigh):
        """A sleigh with the steps of another map."""

    def of_midpoint(problem):
        f, x, h = problem.body.field(), problem.omega, np.asarray(problem.eps)[..., None, None]
        slopes = [(np.eye(2) - sf.matrix(f, y, 1.0)) * 2.0 for y in (x, x + 0.5 * h[..., 0] * f(x))]
        return np.eye(2) + h * slopes[1] @ (np.eye(2) + 0.5 * h * slopes[0])

    jacobian = {"jacobian": KAHAN["jacobian"]}
    new = dataclasses.replace(own.SLEIGH, name="alone", body=Alone, formulas=jacobian)
    maps.register(new)
    methods = {"auto": Steps(own.midpoint_steps, by_field)}
    own_jacobian = {"jacobian": Formula(of_midpoint)}
    other = {"name": "other", "body": Midpoint, "methods": methods, "formulas": own_jacobian}
    maps.register(dataclasses.replace(own.SLEIGH, **other))
    given = [2.0, 3.0], 1.5, 0.4
    starts, eps = [[1.0, 0.5], [np.nan, 0.5]], [0.3, 0.2]
    expected = sf.lyapunov_exponents(own.Sleigh(*given), starts, eps, 200, 5)
    rates = sf.lyapunov_exponents(Alone(*given), starts, eps, 200, 5)
    np.testing.assert_allclose(rates, expected, atol=1e-13)
    assert np.isnan(rates[1]).all()
    monkeypatch.setattr("suslov_fast.formulas._STRETCH", 0)  # one state at a time
    np.testing.assert_array_equal(sf.lyapunov_exponents(Alone(*given), starts, eps, 200, 5), rates)
    x, Q, sums = np.array([1.0, 0.5]), np.eye(2), 0.0
    body = Midpoint(2.0, 1.5, 0.4)
    for state in iterate(body, x, 0.1, 49).omega:
        Q, R = np.linalg.qr(sf.jacobian(body, state, 0.1) @ Q)
        sums += np.log(abs(np.diag(R)))
    rates = sf.lyapunov_exponents(body, x, 0.1, 50)
    np.testing.assert_allclose(rates, -np.sort(-sums / 50), rtol=1e-12)
    step = 1e-6
    by_difference = [
        (sf.step(body, x + d, 0.1) - sf.step(body, x - d, 0.1)) / (2 * step)
        for d in step * np.eye(2)
    ]
    np.testing.assert_allclose(sf.jacobian(body, x, 0.1).T, by_difference, atol=1e-9)
    rest = [[2.0, 0.0], [np.nan, 0.0]]
    values = sf.multipliers(Alone(*given), rest, eps)
    np.testing.assert_allclose(values, sf.multipliers(own.Sleigh(*given), rest, eps), rtol=1e-13)
    values = sf.multipliers(body, [2.0, 0.0], 0.1)  # f' has -c v on its diagonal
    slope = 0.1 * -2.0 * 0.4 * 2.0 / (1.5 + 2.0 * 0.16)
    np.testing.assert_allclose(values, [1.0, 1.0 + slope + slope**2 / 2], rtol=1e-13)
    with pytest.raises(ValueError, match=r"^x: expected fixed points of the map, got 1 other"):
        sf.multipliers(body, [2.0, 0.1], 0.1)
    with pytest.raises(TypeError, match=r"^body: .*got Alone"):
        sf.energy(Alone(*given), starts)
    with pytest.warns(sf.SingularStepWarning):
        pole = sf.lyapunov_exponents(Alone(1.0, 1.0, 1.0), own.SLEIGH.pole[1], 1.0, 1)
    assert np.isnan(pole).all()


def test_a_state_at_a_pole_of_the_sleigh():
    body, pole = own.SLEIGH.pole
    assert iterate(body, pole, 1.0, 1, on_singular="ignore").status == sf.Status.SINGULAR


class Named(sf.QuadraticField):
    """A field with methods of its own."""


def test_a_subclass_comes_back_as_itself(tmp_path):
    field = Named([[[1]]], [[-1]])
    run = iterate(field, [0.5], 0.1, 5)
    run.save(tmp_path / "run.npz")
    assert type(sf.Trajectories.load(tmp_path / "run.npz").body) is Named
    assert type(sf.body_from_dict(field.to_dict())) is Named
    code = "import sys, suslov_fast as sf; sf.Trajectories.load(sys.argv[1])"
    done = children.attempt(code, tmp_path / "run.npz")
    assert "body: expected one of" in done.stderr
    assert "'Named'" in done.stderr


def test_classes_without_a_name_of_their_own_are_not_saved(tmp_path):
    same = type("QuadraticField", (sf.QuadraticField,), {})
    with pytest.raises(TypeError, match="body: expected a class whose name no other one has"):
        iterate(same([[[1]]]), [0.5], 0.1, 5).save(tmp_path / "run.npz")


def changed(**changes):
    return lambda: maps.register(dataclasses.replace(own.MIDPOINT, **{"name": "new"} | changes))


@pytest.mark.parametrize(
    ("register", "error", "words"),
    [
        (changed(name="Kahan"), ValueError, "name: "),
        (changed(methods={}), ValueError, "methods: .*none"),
        (changed(), ValueError, "methods: expected other names than auto, midpoint"),
        (changed(body=int), TypeError, "body: "),
        (changed(variable="y"), ValueError, "variable: "),
        (lambda: maps.register("midpoint"), TypeError, "record: "),
    ],
)
def test_records_are_checked(register, error, words):
    with pytest.raises(error, match=f"^{words}"):
        register()


def test_a_class_without_a_record_is_refused():
    class Other(own.Body):
        pass

    with pytest.raises(TypeError, match=r"^body: expected Suslov3D or .*got Other"):
        iterate(Other(), [0.5, 1.0], 0.1, 5)
