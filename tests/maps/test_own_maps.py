"""Maps and bodies of a user's own: each function is right for them, or refuses them."""

import dataclasses
import os
import pickle
import re
import subprocess
import sys
from pathlib import Path
from unittest import mock

import children
import numba
import numpy as np
import own
import pytest
from test_kernels import try_kernel

import suslov_fast as sf
from suslov_fast import compiled, ensemble, iterate, maps
from suslov_fast.core.compiling import cache
from suslov_fast.engine import threads
from suslov_fast.maps import KAHAN, Formula, Steps, by_field

HENON = sf.QuadraticField.from_hamiltonian(
    lambda x: sum(each**2 for each in x) / 2 + x[0] ** 2 * x[1] - x[1] ** 3 / 3, 4
)
START = np.array([[0.1, -0.2, 0.3, 0.1], [0.2, 0.1, -0.1, 0.2], [np.nan, 0, 0, 0], [9, 9, 9, 9.0]])
SLEIGHS, SPEEDS = own.Sleigh([1.0, 2.0, 3.0], 1.5, 0.4), [[1.0, 0.5]] * 3


@pytest.fixture(autouse=True)
def _registered():
    with mock.patch.dict(maps.MAPS):
        maps.register(own.MIDPOINT)
        maps.register(own.SLEIGH)
        maps.register(own.MIXED)
        yield


def midpoint(eps=0.1, steps=40, **options):
    return iterate(HENON, START, eps, steps, method="midpoint", on_singular="ignore", **options)


@pytest.mark.slow
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


def test_the_kernel_of_own_steps_keeps_the_contract():
    try_kernel(own.MIDPOINT, "midpoint", HENON, START, 0.1)
    run = midpoint(steps=33, save_every=7).extend(7, on_singular="ignore")
    assert run == midpoint(save_every=7)
    np.testing.assert_array_equal(run.x, midpoint().x[run.n])


def counting(x, out, eps, work, values):
    """Statuses of a counter, the state: 1 from 3 to 5, 2 from 5 on, a failure at 8."""
    out[0] = x[0] + values
    if out[0] == 8.0:
        return -1
    return 0 if out[0] < 3.0 else (1 if out[0] < 5.0 else 2)


def counter(step=counting, work=0, values=(1.0,)):
    """A map by this step, and a body for it."""
    kind = type("Counter", (own.Sleigh,), {"dimension": 1, "labels": ("x",)})
    steps = Steps(
        maps.steps_of(step, work), lambda body, eps, batch: (np.array(values), np.atleast_1d(eps))
    )
    new = {"name": "counter", "body": kind, "methods": {"auto": steps}, "formulas": {}}
    maps.register(dataclasses.replace(own.SLEIGH, **new))
    return kind(1.0, 1.0, 1.0)


@pytest.mark.slow
def test_a_positive_status_of_a_step_is_kept_with_its_first_step(tmp_path):
    body = counter()
    starts = [[0.0], [2.5], [4.5], [9.0]]
    run = iterate(body, starts, 0.1, 4, on_singular="ignore")
    assert run.status.tolist() == [1, 1, 2, 2]
    assert run.failed_at.tolist() == [3, 1, 1, 1]
    assert run.extend(3, on_singular="ignore").status.tolist() == [1, 1, 2, 2]
    assert run.extend(3, on_singular="ignore").failed_at.tolist() == [3, 1, 1, 1]
    longer = run.extend(4, on_singular="ignore")
    assert longer == iterate(body, starts, 0.1, 8, on_singular="ignore")
    assert longer.status.tolist() == [-1, 1, 2, 2]
    assert longer.failed_at.tolist() == [8, 1, 1, 1]
    assert np.isnan(longer.final[0])
    # One that ends at a crossing keeps the status of before, whatever follows in the same piece.
    for start, at, status, first in ((0, 2.5, 1, 3), (4, 6.5, 2, 1), (0, 1.5, 0, -1)):
        points = sf.crossings(
            body, [start], 0.1, 20, lambda x, at=at: x[..., 0] - at, direction=1, most=1,
            on_singular="ignore",
        )  # fmt: skip
        assert (points.status, points.failed_at) == (status, first)


def changes(x, out, eps, work, values, numbers):
    out[0] = x[0]
    numbers[0] = 2.0
    return 0


def remembers(x, out, eps, work, values):
    work[0] += 1.0
    out[0] = work[0]
    return 0


def writes(x, out, eps, work, values):
    work[0] = out[0] = x[0]
    return 0


def reads(x, out, eps, work, values):
    out[0] = x[0] + x[1]
    return 0


def moves(x, out, eps, work, values):
    x[0] += values
    out[0] = x[0]
    return 0


def rounds(x, out, eps, work, values):
    values[0] = round(values[0], 1)
    out[0] = x[0] + eps * values[0]
    return 0


def strange(x, out, eps, work, values):
    out[0] = x[0]
    return 99


@pytest.mark.parametrize(
    ("step", "options", "error", "words"),
    [
        (writes, {}, ValueError, "work of 0"),
        (reads, {"work": 1}, ValueError, "x and out of 1 numbers"),
        (remembers, {"work": 1}, ValueError, "remember"),
        (moves, {}, ValueError, "not to x"),
        (rounds, {"values": [[0.57]]}, ValueError, "nor to its row"),
        (strange, {}, ValueError, "Status"),
        (changes, {}, TypeError, r"\*row"),
        pytest.param(
            lambda x, out, eps, work, values: None, {}, TypeError, "return a Status",
            marks=pytest.mark.compiled,
        ),
    ],
)  # fmt: skip
def test_steps_that_break_the_contract_do_not_run(step, options, error, words):
    with pytest.raises(error, match=f"^step must.*{words}"):
        iterate(counter(step, **options), [0.0], 0.1, 3)


def test_kernels_are_made_of_functions():
    with pytest.raises(TypeError, match=r"^step must"):
        maps.steps_of(5)
    with pytest.raises(ValueError, match=r"^work must"):
        maps.steps_of(counting, -1)


def test_arguments_of_a_step_are_checked():
    """Its memory, and eps, which is the last array."""
    for work, error in ((lambda D: -D, ValueError), (lambda D: D / 2, TypeError)):
        with pytest.raises(error, match=r"^work\b"):
            iterate(counter(work=work), [0.0], 0.1, 3)
        maps.MAPS.pop("counter")
    steps = Steps(maps.steps_of(counting), lambda *given: (np.ones(1), np.ones(1, int)))
    with pytest.raises(TypeError, match=r"^eps\b"):
        registered(**steps._asdict())


@pytest.mark.compiled
@pytest.mark.skipif(numba.config.BOUNDSCHECK == 1, reason="Numba itself raises an IndexError")
def test_steps_whose_functions_write_beyond_arrays_do_not_run():
    @numba.njit
    def fill(work):
        work[2] = 1.0

    def helped(x, out, eps, work, values):
        fill(work)
        out[0] = x[0]
        return 0

    with pytest.raises(ValueError, match=r"^step\b"):
        iterate(counter(helped, 2), [0.0], 0.1, 3)


@pytest.mark.compiled
@pytest.mark.slow
def test_an_exception_of_a_step_ends_the_run(monkeypatch):
    """A parallel loop of Numba would ignore it, and leave states unwritten."""

    def raises(x, out, eps, work, values):
        if x[0] == 7.0:
            raise ValueError("seven")
        out[0] = x[0]
        return 0

    body = counter(raises)
    monkeypatch.setattr(threads, "CROSSOVER", 0)
    assert iterate(body, np.full((20, 1), 0.3), 0.1, 3, threads=children.TWO_THREADS).ok
    with pytest.raises(ValueError, match="seven"):
        iterate(body, [[0.3]] * 9 + [[7.0]] + [[0.3]] * 9, 0.1, 3, threads=children.TWO_THREADS)


def test_an_edit_of_a_step_compiles_anew():
    """The kernel's own text is that of all steps; its digest sees the step and the work."""

    def digest(text, work=0):
        names = {"NUMBER": 2.0}
        exec(text, names)
        return cache._digest_of(maps.steps_of(names["step"], work).py_func)

    text = "def step(x, out, eps, work):\n    out[0] = 3.0 * NUMBER * x[0]\n    return 0"
    digests = [digest(text), digest(text.replace("3.0", "4.0")), digest(text, 5)]
    digests += [digest(f"NUMBER = 3.0\n{text}"), digest(text, lambda D: D)]
    assert len({*digests}) == 5
    assert digest(text) == digests[0]


@pytest.mark.slow
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
    assert re.search(r"'midpoint'.* import the module that registers it", done.stderr)


def test_stores_hold_the_map(tmp_path):
    pytest.importorskip("zarr")
    store = tmp_path / "runs.zarr"
    data = ensemble(HENON, START, 0.1, 40, store=store, method="midpoint", save_every=10)
    np.testing.assert_array_equal(data.x, midpoint(save_every=10).x)
    assert data.attrs["map"] == "midpoint"
    with pytest.raises(ValueError, match="map: Kahan, the store has midpoint"):
        ensemble(HENON, START, 0.1, 40, store=store, save_every=10)


@pytest.mark.slow
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
    with pytest.raises(TypeError, match=r"attitude\b"):
        iterate(SLEIGHS, SPEEDS, 0.3, 5, attitude=True)
    refused = (
        "to_xy closed_form first_integral reaction to_matrix to_vector momentum attitude".split()
    )
    for name in (*refused, "exact", "limits"):
        given = (SPEEDS,) if name.startswith(("to_", "momentum")) else (SPEEDS, 0.3)
        given = (*given, 3) if name == "exact" else given
        with pytest.raises(TypeError, match=r"^(body|system)\b"):
            getattr(sf, name)(SLEIGHS, *given)
    for f in (compiled.frame, sf.plot_phase):
        with pytest.raises(TypeError, match=r"^(body|system)\b"):
            f(SLEIGHS[0], 0.3, *(2.0,) * (f is sf.plot_phase))
    with pytest.raises(TypeError, match=r"^(body|system)\b"):
        sf.scattering_angle(SLEIGHS)


def test_compiled_steps_are_those_of_the_map_or_refused():
    class Midpoint(own.Sleigh):
        """A sleigh with the steps of another map."""

    methods = {"auto": own.MIDPOINT.methods["midpoint"]}
    maps.register(dataclasses.replace(own.SLEIGH, name="new", body=Midpoint, methods=methods))
    with pytest.raises(TypeError, match=r"^body must.*compiled steps, not Midpoint: Sleigh"):
        compiled.system(Midpoint(1.0, 1.5, 0.4), 0.1)


def of_midpoint(problem):
    """The Jacobian of the explicit midpoint rule, for fields and bodies."""
    f, x, h = problem.body, problem.omega, np.asarray(problem.eps)[..., None, None]
    f, one = f.field() if hasattr(f, "field") else f, np.eye(x.shape[-1])
    slopes = [2.0 * (one - sf.matrix(f, y, 1.0)) for y in (x, x + 0.5 * h[..., 0] * f(x))]
    return one + h * slopes[1] @ (one + 0.5 * h * slopes[0])


def test_functions_of_a_second_method_of_a_class():
    """They are those of its map, and of no other; a map without a quantity refuses."""
    new = {"name": "second", "methods": {"second": own.MIDPOINT.methods["midpoint"]}}
    new["formulas"] = {"jacobian": Formula(of_midpoint)}
    maps.register(dataclasses.replace(own.SLEIGH, **new))
    body, x, method = own.Sleigh(2.0, 1.5, 0.4), np.array([1.0, 0.5]), {"method": "second"}
    Q, sums, orbit = np.eye(2), 0.0, iterate(body, x, 0.1, 50, **method).omega
    assert (orbit != iterate(body, x, 0.1, 50).omega)[1:].any(axis=-1).all()
    np.testing.assert_array_equal(sf.step(body, x, 0.1, **method), orbit[1])
    for state in orbit[:-1]:
        Q, R = np.linalg.qr(sf.jacobian(body, state, 0.1, **method) @ Q)
        sums += np.log(abs(np.diag(R)))
    rates = sf.lyapunov_exponents(body, x, 0.1, 50, **method)
    np.testing.assert_allclose(rates, -np.sort(-sums / 50), rtol=1e-12)
    assert abs(rates - sf.lyapunov_exponents(body, x, 0.1, 50)).max() > 1e-6
    step = 1e-6
    by_difference = [
        np.subtract(*(sf.step(body, x + d, 0.1, **method) for d in (d, -d))) / (2 * step)
        for d in step * np.eye(2)
    ]
    np.testing.assert_allclose(sf.jacobian(body, x, 0.1, **method).T, by_difference, atol=1e-9)
    slope = 0.1 * -2.0 * 0.4 * 2.0 / (1.5 + 2.0 * 0.16)  # f' has -c v on its diagonal
    values = sf.multipliers(body, [2.0, 0.0], 0.1, **method)
    np.testing.assert_allclose(values, [1.0, 1.0 + slope + slope**2 / 2], rtol=1e-13)
    both = sf.multipliers(body, [[2.0, 0.0], [0.0, 0.0], [2.0, 0.0]], 0.1, **method)
    np.testing.assert_array_equal(both, [values, [1.0, 1.0], values])
    with pytest.raises(ValueError, match=r"^x is not a fixed point: use jacobian"):
        sf.multipliers(body, [2.0, 0.1], 0.1, **method)
    points = sf.crossings(body, x, 0.1, 50, lambda x: x[..., 1] - 0.4, direction=0, **method)
    n = np.flatnonzero((orbit[:-1, 1] > 0.4) != (orbit[1:, 1] > 0.4))
    assert len(n) > 0
    np.testing.assert_array_equal(points.before, orbit[n])
    with pytest.raises(TypeError, match=r"^method\b"):
        sf.jacobian(HENON, START[0], 0.1, method="midpoint")
    with pytest.raises(TypeError, match=r"^(body|system)\b"):
        compiled.system(HENON, 0.1, method="midpoint")


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
    assert "import the module that defines it" in done.stderr
    assert "'Named'" in done.stderr


def changed(**changes):
    return lambda: maps.register(dataclasses.replace(own.MIDPOINT, **{"name": "new"} | changes))


def with_steps(**changes):
    of_record = {name: changes.pop(name) for name in [*changes] if name in vars(own.MIDPOINT)}
    steps = own.MIDPOINT.methods["midpoint"]._replace(**changes)
    return changed(methods={"new": steps}, **of_record)


@pytest.mark.parametrize(
    ("register", "error", "words"),
    [
        (changed(name="Kahan"), ValueError, "name "),
        (
            changed(),
            ValueError,
            "methods.*must be none of auto, .*, order8, .*midpoint",
        ),
        (changed(body=int), TypeError, "body "),
        (changed(variable="y"), ValueError, "variable "),
        (lambda: maps.register("midpoint"), TypeError, "record "),
        (changed(body=own.Body), ValueError, "methods: name one of midpoint auto"),
        (with_steps(kernel=own.midpoint_step), TypeError, r"methods\['new'\].kernel "),
        (with_steps(lanes=12), ValueError, r"methods\['new'\].lanes .*multiple of 8"),
        (with_steps(formulas={"energy": KAHAN}), TypeError, r"formulas\['energy'\] "),
        (
            with_steps(formulas={"enregy": Formula(len)}),
            ValueError,
            "formulas: .*'enregy': name it energy",
        ),
        (
            with_steps(formulas={"multipliers": Formula(len)}),
            ValueError,
            "formulas: leave out 'multipliers', because 'jacobian'",
        ),
        (with_steps(attitude=True), ValueError, "attitude"),
        (with_steps(conserved="energy"), ValueError, "conserved "),
        (with_steps(conserved=("jacobian",)), ValueError, "conserved.*vector_field, energy"),
    ],
)
def test_records_are_checked(register, error, words):
    with pytest.raises(error, match=f"^{words}"):
        register()


def test_a_formula_of_another_shape_is_refused():
    forgets = Formula(lambda problem: problem.omega[..., 0] * 1.0)
    of_states = Formula(lambda problem: problem.omega + 0.0 * np.asarray(problem.eps)[..., None])
    kind = type("Wrong", (own.Sleigh,), {})
    formulas = {"modified_energy": forgets, "energy": of_states}
    new = {"name": "new", "body": kind, "formulas": formulas, "conserved": ()}
    maps.register(dataclasses.replace(own.SLEIGH, **new))
    body = kind(2.0, 1.5, 0.4)
    assert sf.modified_energy(body, [1.0, 0.5], 0.1) == 1.0
    words = r"^modified_energy: .* 'new' returns the shape \(\), .*batch shape \(3,\)"
    with pytest.raises(ValueError, match=words):
        sf.modified_energy(body, [1.0, 0.5], [0.1, 0.2, 0.3])
    with pytest.raises(ValueError, match=r"^energy: .*returns the shape \(2,\), .*shape \(\)"):
        sf.energy(body, [1.0, 0.5])


class Faster(own.Sleigh):
    """A sleigh with equations of its own, and no map."""

    def field(self):
        return sf.QuadraticField(2 * np.asarray(own.Sleigh.field(self).quadratic, float))


def test_a_class_with_other_equations_needs_a_record():
    given = 2.0, 1.5, 0.4
    with pytest.raises(TypeError, match=r"^(body|system)\b"):
        iterate(Faster(*given), SPEEDS[0], 0.1, 5)
    maps.register(dataclasses.replace(own.SLEIGH, name="faster", body=Faster))
    run = iterate(Faster(*given), SPEEDS[0], 0.1, 5)
    np.testing.assert_array_equal(run.omega, iterate(own.Sleigh(*given), SPEEDS[0], 0.2, 5).omega)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"field": lambda body: 5}, r"^field\(\) must be a body or a field, not int"),
        ({"dimension": 3}, "^labels must have 3 entries, the dimension of Wrong"),
        ({"dimension": 1, "labels": ("x",)}, r"^field\(\) must have 1 components"),
        (
            {"field": lambda body: SLEIGHS.field()},
            r"^field\(\) must have the shape \(\) of the body",
        ),
    ],
)
def test_bodies_that_contradict_themselves(changes, words):
    kind = type("Wrong", (own.Sleigh,), {"field": own.Sleigh.field} | changes)
    maps.register(dataclasses.replace(own.SLEIGH, name="new", body=kind))
    with pytest.raises((TypeError, ValueError), match=words):
        iterate(kind(2.0, 1.5, 0.4), [1.0] * changes.get("dimension", 2), 0.1, 5)


def registered(**changes):
    """Run one step by changed steps."""
    with_steps(**changes)()
    return iterate(HENON, START[:1], 0.1, 1, method="new")


@pytest.mark.slow
def test_parameters_with_different_numbers_of_axes(rng, tmp_path):
    """A number, a vector and a matrix, of each member or shared by all: rows have their shapes."""
    for make in own.RANDOM["mixed"]:
        bodies, x = make(rng, (4,)), rng.normal(size=(4, 3))
        run = iterate(bodies, x, 0.1, 6)
        for k, body in enumerate(bodies):
            assert iterate(body, x[k], 0.1, 6).x.tolist() == run.x[:, k].tolist()
        middle = x + 0.05 * bodies.field()(x)
        np.testing.assert_allclose(run.x[1], x + 0.1 * bodies.field()(middle), rtol=1e-13)
        run.save(tmp_path / "run.npz", overwrite=True)
        assert sf.Trajectories.load(tmp_path / "run.npz") == run
        points = sf.crossings(bodies, x, 0.1, 6, lambda x: x[..., 0], direction=0)
        for data in (run.to_xarray(), points.to_xarray()):
            assert data.b.dims[1:] == ("component",)
            assert "A" not in data or data.A.dims[-2:] == ("component", "A_1")


@pytest.mark.compiled
def test_the_error_of_a_step_that_numba_refuses_says_why():
    @maps.function
    def step(x, out, eps, work, scale, b, A):
        out[:] = undefined  # noqa: F821
        return 0

    methods = {"auto": Steps(maps.steps_of(step), maps.by_constants)}
    kind = type("New", (own.Mixed,), {})
    maps.register(dataclasses.replace(own.MIXED, name="new", body=kind, methods=methods))
    with pytest.raises(TypeError, match=r"^step must .*undefined"):
        iterate(kind(1.0, np.ones(3), np.eye(3)), np.ones(3), 0.1, 2)


# The maps of the page for authors, as a module, without the runs of the page.
PAGE = Path(__file__).parents[2] / "docs" / "howto" / "discretization.md"
_section = PAGE.read_text(encoding="utf-8").partition("## A discretization of your own")[2]
MODULE = "import numpy as np\nfrom suslov_fast import QuadraticField\n" + "\n".join(
    re.sub(r"\n(run|change|print)\b.*", "", block)
    for block in re.findall(r"```python\n(.*?)```", _section, re.DOTALL)
)
DIVERGING = """
from dataclasses import replace

class Strong(QuadraticField):
    pass

maps.register(replace(
    maps.MAPS["implicit midpoint"], name="strong", body=Strong, methods={"auto": maps.FIELD},
))
RANDOM = {"strong": (lambda rng, shape: Strong(30 * rng.normal(size=(*shape, 5, 5, 5))),)}
"""


@pytest.mark.compiled
@pytest.mark.slow
def test_the_maps_of_the_page_keep_the_promises(tmp_path):
    """In a module of one's own; and a map whose random orbits diverge."""
    mixed = 'import own\nmaps.register(own.MIXED)\nRANDOM["mixed"] = own.RANDOM["mixed"]\n'
    (tmp_path / "my_maps.py").write_text(MODULE + DIVERGING + mixed, encoding="utf-8")
    tests = Path(__file__).parents[1] / "package" / "test_promises.py"
    words = "midpoint or mixed and (loop or parts or threads)"
    words += " or strong and (seldom or order or loop)"
    given = ["-q", "-x", "-p", "no:cacheprovider", tests, "--maps", "my_maps", "-k", words]
    places = os.pathsep.join(map(str, [tmp_path, tests.parent, *sys.path]))
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *given],
        env=os.environ | {"PYTHONPATH": places}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert int(re.search(r"(\d+) passed", done.stdout)[1]) > 30


def test_slopes_and_solutions_for_steps_of_ones_own(rng):
    """Beside the field itself, its Jacobian by `matrix`, and NumPy; with rows of any size."""
    constant = sf.QuadraticField.from_function(lambda x: (x[0] * x[1], 3 - x[1]), 2)
    for field, x in ((HENON, START[0]), (constant, np.array([2.0, 5.0]))):
        D = len(x)
        f, derivative = np.empty(D), np.full((D, D), np.nan)
        maps.slope_at(x, *field.terms, f, derivative)
        np.testing.assert_allclose(f, sf.vector_field(field, x), rtol=1e-15)
        slopes = 2 * (np.eye(D) - sf.matrix(field, x, 1.0))
        np.testing.assert_allclose(derivative, slopes, atol=1e-15)
    for D in (1, 2, 5, 9):
        A, y = rng.normal(size=(D, D)), rng.normal(size=D)
        A *= 10.0 ** rng.uniform(-100, 100, (D, 1))
        b = A @ y
        assert maps.solve(A.copy(), b) == sf.Status.OK
        np.testing.assert_allclose(b, y, rtol=1e-10)
    for A, status in (
        ([[1.0, 2], [2, 4]], sf.Status.SINGULAR),
        ([[0.0, 0], [0, 4]], sf.Status.SINGULAR),
        ([[np.nan, np.nan], [0, 4]], sf.Status.NONFINITE),
        ([[1.0, np.inf], [0, 4]], sf.Status.NONFINITE),
        ([[1e-300, 0], [0, 1.0]], sf.Status.NONFINITE),
    ):
        with np.errstate(all="ignore"):  # as Python
            assert maps.solve(np.array(A), np.array([1e300, 1.0])) == status


def test_arguments_of_kernels_are_checked():
    wrong = {
        "a tuple of arrays, not list": lambda *given: [*by_field(*given)],
        "1 or 1 rows.*not 3": lambda *given: (np.ones(3), *by_field(*given)),
        "an array of float64, not float32": lambda *given: (np.float32([1]), *by_field(*given)),
    }
    for words, arguments in wrong.items():
        with pytest.raises((TypeError, ValueError), match=words):
            registered(arguments=arguments)
        maps.MAPS.pop("new")

    def of_first_axis(body, eps, batch):  # right for a batch of one axis
        return *by_field(body, 0.1, batch)[:2], np.full(batch[0], eps)

    with_steps(arguments=of_first_axis)()
    with pytest.raises(ValueError, match=r"^arguments\[2\] must have 1 or 6 rows.*not 2"):
        iterate(HENON, np.zeros((2, 3, 4)), 0.1, 1, method="new")
