"""Named parameters of fields, in batches, copies, files, datasets, stores and the command."""

import json
import pickle
from dataclasses import replace
from fractions import Fraction as F

import numpy as np
import pytest
import xarray
from test_cli import succeed

import suslov_fast as sf
from suslov_fast import QuadraticField, Trajectories, ensemble, iterate
from suslov_fast._bodies.named import _RESERVED
from suslov_fast._ensemble.reductions import reductions_of
from suslov_fast._maps import MAPS
from suslov_fast._runs.labelled import TAKEN
from suslov_fast._runs.schema import HEADER, schema_of

VALUES = np.linspace(1.0, 6.0, 11)


def dynamo(x, a, mu=F(1, 3)):
    """The two-disc dynamo of Rikitake."""
    return -mu * x[0] + x[1] * x[2], -mu * x[1] + (x[2] - a) * x[0], 1 - x[0] * x[1]


def cubic(x, a, b=2):
    return x[1] ** 2 / 2 + a * x[0] ** 2 - b * a * x[0] ** 3 / 7


BATCH = QuadraticField.from_function(dynamo, 3, a=VALUES, mu=0.5)
ENERGIES = QuadraticField.from_hamiltonian(cubic, 2, a=VALUES[:, None], b=[0.5, 1.0])
GRID = QuadraticField.from_function(dynamo, 3, a=VALUES[:, None], mu=[0.5, 1.0])
SINGLE = QuadraticField.from_hamiltonian(cubic, 2, a=F(1, 3))
RUN = [1.0, 0.5, 2.0], 0.01, 20


def assert_named(field, other):
    assert field == other
    assert hash(field) == hash(other)
    assert list(field.parameters) == list(other.parameters)
    for name, value in other.parameters.items():
        assert np.array_equal(field.parameters[name], value)


@pytest.mark.parametrize("make", ["from_function", "from_hamiltonian"])
def test_a_batch_has_the_coefficients_of_single_fields(make):
    f, D = (dynamo, 3) if make == "from_function" else (cubic, 2)
    fields = getattr(QuadraticField, make)(f, D, a=VALUES)
    singles = [getattr(QuadraticField, make)(f, D, a=a) for a in VALUES]
    for name in ("quadratic", "linear", "constant"):
        expected = [np.asarray(getattr(each, name), float) for each in singles]
        assert np.array_equal(getattr(fields, name), expected)
    plain = QuadraticField(fields.quadratic, fields.linear, fields.constant)
    assert (fields == plain) == (fields.H is None)
    assert GRID.shape == (11, 2)
    with pytest.raises(ValueError, match="read-only"):
        fields.parameters["a"][0] = 0.0


def test_single_numbers_remain_exact():
    field = QuadraticField.from_function(dynamo, 3, a=F(2, 7))
    assert field.linear[1, 0] == -F(2, 7)
    assert field.parameters == {"a": F(2, 7)}
    assert SINGLE.H([F(1), F(0)]) == F(1, 3) - F(2, 21)


@pytest.mark.parametrize("field", [BATCH, GRID, ENERGIES, SINGLE])
def test_copies_keep_names(field, tmp_path):
    text = json.loads(json.dumps(field.to_dict()))
    for copy in (sf.body_from_dict(text), pickle.loads(pickle.dumps(field, 0))):
        assert_named(copy, field)
        assert copy.to_dict() == text
    starts = [0.1, 0.2, 0.3][: field.dimension]
    run = iterate(field, starts, 0.01, 20)
    run.save(tmp_path / "run.npz")
    assert_named(Trajectories.load(tmp_path / "run.npz").extend(3).body, field)
    assert_named(Trajectories.from_xarray(run.to_xarray()).body, field)


def test_coordinates_of_datasets(tmp_path):
    data = iterate(BATCH, *RUN).to_xarray()
    store = ensemble(BATCH, *RUN, store=tmp_path / "a.zarr", save_every=1)
    for each in (data, store, xarray.open_zarr(tmp_path / "a.zarr")):
        some = each.sel(a=2.4, method="nearest")
        assert (some.a, some.mu) == (2.5, 0.5)
        assert np.array_equal(some.x, iterate(BATCH, *RUN).x[:, 3])
        part = Trajectories.from_xarray(each.isel(a=slice(2, 5))).body
        assert_named(part, QuadraticField.from_function(dynamo, 3, a=VALUES[2:5], mu=0.5))
        one = Trajectories.from_xarray(each.isel(a=2)).body
        assert_named(one, QuadraticField.from_function(dynamo, 3, a=2.0, mu=0.5))
        with pytest.raises(ValueError, match=r"a: expected values of this .* got none"):
            Trajectories.from_xarray(each.isel(a=2, drop=True))
    dims = ("start", "a", "mu")
    starts = sf.RandomStarts((3, 1, 1), 1.0)
    grid = ensemble(GRID, starts, 0.01, 5, store=tmp_path / "b.zarr", dims=dims)
    assert grid.final.sel(a=2.5, mu=1.0).dims == ("start", "component")


def test_a_store_keeps_the_names_that_it_has(tmp_path):
    plain = QuadraticField(BATCH.quadratic, BATCH.linear, BATCH.constant)
    for first, second, dims in ((BATCH, plain, ("a",)), (plain, BATCH, ("trajectory",))):
        store = tmp_path / f"{dims[0]}.zarr"
        ensemble(first, *RUN, store=store)
        for verify in (False, True):
            longer = ensemble(second, *RUN[:2], 30, store=store, verify=verify)
            assert longer.status.dims == dims
            assert_named(Trajectories.from_xarray(longer).body, BATCH)


def test_the_command_sweeps_affine_parameters(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def rates(x, a, b, c):
        return a * b * x[0] + F(1, 3) * b + c**2 * x[1], -x[1] - a * x[0] * x[1]

    field = QuadraticField.from_function(rates, 2, a=1, b=F(1, 7), c=2)
    (tmp_path / "f.json").write_text(json.dumps(field.to_dict()))
    line = "run --body f.json --eps 0.1 --steps 5 --omega0 1,2 -o {}.zarr --sweep {}"
    said = succeed(line.format("ab", "a=1:2:3 --sweep b=0.5:1:2"))
    assert "a = 1 ... 2 (3, 1, 1), b = 0.5 ... 1 (2, 1), c = 2" in said
    final = sf.open_ensemble("ab.zarr").final.sel(a=1.5, b=0.5).values
    other = QuadraticField.from_function(rates, 2, a=1.5, b=0.5, c=2)
    np.testing.assert_allclose(final[0], iterate(other, [1, 2], 0.1, 5).final, rtol=1e-14)
    (tmp_path / "f.json").write_text(json.dumps(SINGLE.to_dict()))
    said = succeed(line.format("H", "a=1:2:3").replace("1,2", ".1,.2") + " --save-every 1")
    assert "drift of E_mod" in said
    kept = Trajectories.from_xarray(sf.open_ensemble("H.zarr")).body
    expected = [[a * (1 / 4 - 1 / 28)] for a in (1, 1.5, 2)]
    np.testing.assert_allclose(sf.energy(kept, [0.5, 0]), expected, rtol=1e-15)
    (tmp_path / "f.json").write_text(json.dumps(field.to_dict()))
    for name, reason in (("c", "affine (a, b), got c"), ("d", "one of eps, a, b, c, got d")):
        with pytest.raises(SystemExit, match="2"):
            sf._cli.main(line.format("no", f"{name}=1:2:3").split())
        assert reason in capsys.readouterr().err


def test_quantities_of_a_batch_with_a_hamiltonian(tmp_path):
    """Against single fields, from fractions; in runs, parts of datasets and stores."""
    x, eps = np.random.default_rng(3).uniform(-0.4, 0.4, (5, 1, 1, 2)), [0.125, -0.25]
    of_batch = [f(ENERGIES, x, eps) for f in (sf.modified_energy, sf.invariant_density)]
    for i, j in np.ndindex(ENERGIES.shape):
        given = {"a": VALUES[i], "b": ENERGIES.parameters["b"][j]}
        one = QuadraticField.from_hamiltonian(cubic, 2, **given)
        exact = [float(one.H([*map(F, point)])) for point in x[:, 0, 0]]
        for found in (sf.energy(ENERGIES, x), ENERGIES.H(x)):
            np.testing.assert_allclose(found[:, i, j], exact, 0, 1e-15)
        single = [f(one, x[:, 0, 0], eps[j]) for f in (sf.modified_energy, sf.invariant_density)]
        np.testing.assert_allclose([each[:, i, j] for each in of_batch], single, 1e-14, 1e-15)
    run = iterate(ENERGIES, x, eps, 20)
    assert np.array_equal(run.modified_energy()[0], of_batch[0])
    np.testing.assert_allclose(run.modified_energy()[-1], of_batch[0], 0, 1e-14)
    settings = {"store": tmp_path / "a.zarr", "dims": ("start", "a", "b"), "chunk": 3}
    ensemble(ENERGIES, x, eps, 20, **settings, reductions=["modified_energy_drift"])
    drift = sf.open_ensemble(tmp_path / "a.zarr").modified_energy_drift
    assert 0 < drift.max() < 1e-12
    part = Trajectories.from_xarray(run.to_xarray(dims=settings["dims"]).isel(a=3, b=1))
    assert np.array_equal(part.modified_energy(), run.modified_energy()[:, :, 3, 1])
    assert sf.body_from_dict(part.body.to_dict()) == part.body
    none = QuadraticField.from_hamiltonian(cubic, 2, a=[])
    assert iterate(none, [0.1, 0.2], 0.1, 3).modified_energy().shape == (4, 0)
    other = QuadraticField.from_hamiltonian(lambda x, a: a * x[0] ** 2, 2, a=[1, 2])
    for change in ({"H": other.H}, {"K": 2 * ENERGIES.K}, {"linear": np.eye(2)}):
        with pytest.raises(ValueError, match="H"):
            replace(ENERGIES, **change)


@pytest.mark.parametrize(
    ("f", "value"),
    [
        (lambda x, a: (np.sin(a) * x[0],), 1.5), (lambda x, a: (x[0] / a,), 2),
        (lambda x, a: ((1 if a > 1 else 2) * x[0],), 2), (lambda x, a: (a * a * x[0],), [1, 2]),
    ],
)  # fmt: skip
def test_other_functions_of_parameters(f, value):
    field = QuadraticField.from_function(f, 1, a=value)
    assert "affine" not in field.to_dict()
    expected = [f([1.0], a)[0] for a in np.atleast_1d(value)]
    np.testing.assert_allclose(np.atleast_1d(field.linear[..., 0, 0]).astype(float), expected)


def test_bad_parameters():
    map = MAPS["quadratic"]
    assert {*schema_of(map), *HEADER, *TAKEN, *reductions_of(map)} - {"resume/state"} - {
        name for name in schema_of(map) if name.startswith("resume/")
    } <= _RESERVED
    for name in (*(_RESERVED - {"dimension"}), "a b"):
        with pytest.raises(ValueError, match=f"parameters: expected .*{name!r}"):
            QuadraticField.from_function(lambda x, **given: (x[0],), 1, **{name: 2})
    for value in ("1", True, np.inf, [np.nan], [1j], [[1], [2, 3]]):
        with pytest.raises((TypeError, ValueError), match="a: expected"):
            QuadraticField.from_function(lambda x, a: (a * x[0],), 1, a=value)
    with pytest.raises(ValueError, match="coefficients: expected the range of float64"):
        QuadraticField.from_function(lambda x, a: (10**400 * x[0] * a,), 1, a=[1, 2])
    with pytest.raises(ValueError, match=r"got a \(2,\), b \(3,\)"):
        QuadraticField.from_function(lambda x, a, b: (a * x[0],), 1, a=[1, 2], b=[1, 2, 3])
    *rates, energy = SINGLE.to_dict()["affine"]
    assert rates == [[[1.0, 1]], [[-2.0, 0, "a"], ["6/7", 0, 0, "a"]]]
    assert energy == [[0.5, 1, 1], [1.0, 0, 0, "a"], ["-2/7", 0, 0, 0, "a"]]
    for terms, message in (
        ([rates[0], [[5.0, 0, "a"], ["6/7", 0, 0, "a"]], energy], "that of the coefficients"),
        ([*rates, energy[:2]], "that of the coefficients"),
        (rates, "that of the coefficients"),
        ([[], [[-2.0, 0, "b"], ["6/7", 0, 0, "b"]], []], "terms .* got an error: KeyError"),
        ([[[1.0, 5]], [], []], "terms .* got an error: IndexError"),
        ([[[1.0, 1]]], "that of the coefficients"),
        ({"a": 3}, "terms .* got an error"),
    ):
        with pytest.raises(ValueError, match=f"affine: expected {message}"):
            QuadraticField.from_dict(SINGLE.to_dict() | {"affine": terms})
    for values in ({"a": [1.0, 2.0]}, {"a": 1.0, "b": [1.0, 2.0, 3.0]}):
        with pytest.raises(ValueError, match=r"parameters: expected shapes that broadcast to \(\)"):
            QuadraticField.from_dict(SINGLE.to_dict() | {"parameters": values})


def test_hamiltonians_that_do_not_fit_their_field():
    for field, c, message in (
        (ENERGIES, [1.0, 2.0, 3.0], r"H: expected coefficients of shape \(11, 2\), got \(3,\)"),
        (SINGLE, [1.0, 2.0], "H: expected .* numbers, as of a single field, got lists"),
        (SINGLE, str(10**400), "H: expected coefficients in the range of float64"),
    ):
        whole = field.to_dict()
        with pytest.raises(ValueError, match=message):
            QuadraticField.from_dict(whole | {"H": [[c, 0, 0], *whole["H"][1:]]})
    for x, error in (("x", TypeError), (np.ones((3, 2)), ValueError)):
        with pytest.raises(error, match="x"):
            ENERGIES.H(x)


def test_a_hamiltonian_beyond_float64():
    """Its field may be in range: it has steps, but no energy and no files."""
    field = QuadraticField.from_hamiltonian(lambda x: x[1] + 10**400, 2)
    assert QuadraticField.from_dict(field.to_dict()) == field
    assert sf.step(field, [1.0, 2.0], 0.5).tolist() == [1.5, 2.0]
    with pytest.raises(ValueError, match="Hamiltonian with coefficients in the range of float64"):
        sf.energy(field, [1.0, 2.0])
    with pytest.raises(ValueError, match="H: expected coefficients in the range of float64"):
        QuadraticField.from_hamiltonian(lambda x, a: a * x[1] + F(10) ** 400, 2, a=[1.0, 2.0])


def test_replaced_coefficients_need_not_be_those_of_the_parameters():
    same = replace(SINGLE)
    assert (same, same.H, same.parameters) == (SINGLE, SINGLE.H, {})
    assert replace(BATCH, constant=np.zeros(3)).parameters == {}
    with pytest.raises(ValueError, match="H, K: expected those of the coefficients, got others"):
        replace(SINGLE, linear=np.eye(2))


@pytest.mark.parametrize("a", [2.0, [1.0, 2.0]])
def test_a_function_that_compares_a_parameter_is_not_taken_as_affine(a):
    """Symbols are not equal to 2, so the branch for all other values would be stored."""
    field = QuadraticField.from_function(lambda x, a: ((a if a == 2 else -a) * x[0],), 1, a=a)
    assert "affine" not in field.to_dict()
    assert_named(QuadraticField.from_dict(field.to_dict()), field)
