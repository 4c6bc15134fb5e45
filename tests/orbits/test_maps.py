"""Maps of one's own: orbits, exponents, fixed points, ends, and what refuses a map.

Right values are loops in Python and in NumPy, closed forms, and numbers that others have published.
"""

import math
import pickle

import numpy as np
import pytest
from systems import compiled_step, exponents_by_qr

import suslov_fast as sf
from suslov_fast import IntegrationWarning, Map, Status, iterate, lyapunov_exponents
from suslov_fast.core.maps import map_step

LN2 = math.log(2)


def henon(x, a, b):
    return 1 - a * x[0] ** 2 + x[1], b * x[0]


def standard(s, K):
    p = np.mod(s[1] + K * np.sin(s[0]), 2 * np.pi)
    return np.mod(s[0] + p, 2 * np.pi), p


def lattice(x, r):
    y = r * x * (1 - x)
    return 0.9 * y + 0.05 * (np.roll(y, 1) + np.roll(y, -1))


def ikeda(x, u):
    c, s = np.cos(x[1]), np.sin(x[1])
    return 1 + u * (x[0] * c - x[1] * s), u * (x[0] * s + x[1] * c)


def symplectic_euler(s, h):
    p = s[1] - h * np.sin(s[0])
    return s[0] + h * p, p


HENON = Map(henon, "x y", a=1.4, b=0.3)
STANDARD = Map(standard, "q p", K=0.9)
MAPS = {
    "Hénon": HENON,
    "standard": STANDARD,
    "logistic": Map(lambda x, r: r * x * (1 - x), "x", r=3.9),
    "Lyness": Map(lambda x, a: (x[1], (x[1] + a) / x[0]), "x y", a=3.0),
    "McMillan": Map(lambda x, a: (x[1], 2 * a * x[1] / (1 + x[1] ** 2) - x[0]), "x y", a=0.7),
    "Ikeda": Map(ikeda, 2, u=0.6),
    "tent": Map(lambda x: 1 - 2 * np.abs(x - 0.5), "x"),
    "Lozi": Map(lambda x: (1 - 1.7 * np.abs(x[0]) + x[1], 0.5 * x[0]), 2),
    "lattice": Map(lattice, 30, r=3.9),
    "Euler": Map(symplectic_euler, "q p", h=0.2),
    "clip": Map(lambda x: (np.clip(3 * x[0], -1, 1), np.where(x[0] > x[1], x[1] / 2, x[0] - 1)), 2),
    "table": Map(lambda x: np.interp(x, [0, 0.3, 1], [0, 1, 0.1]), "x"),
    "constant": Map(lambda x: (x[1], 0.25), 2),
    "swap": Map(lambda x: (x[1], x[0]), 2),
}
each = pytest.mark.parametrize("map", MAPS.values(), ids=MAPS)


def starts(map, *shape):
    return np.random.default_rng(3).uniform(0.1, 0.6, (*shape, map.dimension))


@each
def test_orbits_are_loops_of_the_map(map):
    x = starts(map, 37) / 3
    run = iterate(map, x, 50)
    state = x
    for n in range(50):
        assert np.array_equal(run.states[n], state)
        state = map(state)
    assert np.array_equal(run.final, state)
    assert np.array_equal(run.time, np.arange(51.0))
    assert np.array_equal(run.member(5).states, iterate(map, x[5], steps=50).states)
    assert np.array_equal(iterate(map, x, 50, save_every=7).states, run.states[::7])
    assert np.array_equal(iterate(map, run.states[20], 30, save_every=None).final, run.final)
    assert np.array_equal(sf.step(map, x), run.states[1])


@pytest.mark.parametrize(
    "name", ["Hénon", "standard", "logistic", "Ikeda", "Lozi", "Euler", "lattice"]
)
def test_exponents_are_those_of_qr(name):
    """Also where there are too many columns for a list, as in the lattice."""
    map, x = MAPS[name], starts(MAPS[name])
    found = lyapunov_exponents(map, x, steps=300)
    np.testing.assert_allclose(found, exponents_by_qr(map, x, steps=300), rtol=0, atol=1e-12)
    both = lyapunov_exponents(map, np.stack([x, x / 2, x]), 300)
    assert np.array_equal(both[[0, 2]], [found, found])


def test_published_exponents():
    """Hénon's .4192 and log .3 - .4192; log 2 of the logistic map; of Arnold's cat."""
    x = np.random.default_rng(0).uniform(-0.1, 0.1, (32, 2))
    found = lyapunov_exponents(HENON, x, steps=20_000, transient=100)
    assert abs(found.mean(axis=0) - [0.41922, math.log(0.3) - 0.41922]).max() < 1e-3
    np.testing.assert_allclose(found.sum(axis=-1), math.log(0.3), rtol=1e-12)
    chaotic = MAPS["logistic"].with_parameters(r=4.0)
    found = lyapunov_exponents(chaotic, np.linspace(0.1, 0.4, 16)[:, None], 20_000, transient=100)
    assert abs(found.mean() - LN2) < 1e-4
    cat = Map(lambda x: (np.mod(2 * x[0] + x[1], 1.0), np.mod(x[0] + x[1], 1.0)), 2)
    found = lyapunov_exponents(cat, [0.3, 0.4], 1000, transient=100)
    golden = math.log((3 + 5**0.5) / 2)
    np.testing.assert_allclose(found, [golden, -golden], rtol=1e-12)


def test_fixed_points_have_multipliers():
    rates = np.linspace(2.6, 3.4, 5)
    found = sf.equilibria(MAPS["logistic"].with_parameters(r=rates), near=[0.6])
    np.testing.assert_allclose(found.states[:, 0], 1 - 1 / rates, rtol=1e-12)
    np.testing.assert_allclose(found.eigenvalues[:, 0], 2 - rates, rtol=1e-10)
    assert (found.stable == (rates < 3)).all()
    twice = Map(lambda x: HENON(HENON(x)), "x y")
    pair = sf.equilibria(twice, near=[1.0, -0.1]).states
    x = np.roots([1.4**2, -1.4 * 0.7, 0.7**2 - 1.4])  # of period 2
    assert abs(pair[0] - x).min() < 1e-12


@pytest.mark.parametrize("B", [1, 7, 8, 17, 1025])
def test_ends_are_those_of_a_loop(B):
    """Where f is infinite or NaN the orbit ends, and no other changes: statuses of a NumPy loop."""
    x = np.random.default_rng(B).uniform(-2.5, 2.5, (B, 2))
    if B > 3:
        x[2] = np.nan
    with np.errstate(all="ignore"):
        state, expected = x, np.full(B, -1)
        expected[np.isnan(x).any(axis=1)] = 0
        for n in range(1, 31):
            state = np.stack(henon(state.T, 1.4, 0.3), axis=1)
            ends = ~np.isfinite(state).all(axis=1)
            expected[ends & (expected < 0)], state[ends] = n, np.nan
    run = iterate(HENON, x, 30, on_singular="ignore")
    assert np.array_equal(run.failed_at, expected)
    assert np.array_equal(run.status, np.where(expected < 0, 0, Status.NONFINITE))
    exist = (expected < 0) | (run.n[:, None] < expected)
    assert np.array_equal(np.isfinite(run.states).all(axis=-1), exist)
    assert np.array_equal(
        run.final, np.where(exist[-1][:, None], run.final, np.nan), equal_nan=True
    )


@pytest.mark.parametrize("B", [1, 2, 9])
def test_a_sum_of_components_may_overflow(B):
    map = Map(lambda x: (10 * x[0], 10 * x[1]), 2)
    x = np.array([[1e306, 1e306], [-1e307, 1e307], [1.0, 2.0]])[np.arange(B) % 3]
    run = iterate(map, x, 3, on_singular="ignore")
    assert run.failed_at.tolist() == [[3, 2, -1][k % 3] for k in range(B)]
    assert np.array_equal(run.states[1], 10 * x)
    assert np.array_equal(run.states[2, ::3], 100 * x[::3])
    status, out = compiled_step(map, 10 * x[0])
    assert status == Status.OK
    assert np.array_equal(out, 100 * x[0])
    np.testing.assert_allclose(lyapunov_exponents(map, x[0], 2), math.log(10), rtol=1e-15)


@pytest.mark.parametrize("power", [lambda x, p: x**p, lambda x, p: p**x], ids=["x**p", "p**x"])
def test_powers_do_not_hide_a_missing_state(power):
    """NaN**0 and 1**NaN are 1; the orbit has ended all the same, and other orbits go on."""
    p = np.array([0.0, 1.0, 2.0])
    map = Map(lambda x, p: (power(x[0], p),), "x", p=p)
    run = iterate(map, [[[np.nan]], [[0.5]]], 2, on_singular="ignore")
    assert run.failed_at.tolist() == [[0] * 3, [-1] * 3]
    assert np.isnan(run.states[:, 0]).all()
    np.testing.assert_allclose(run.final[1, :, 0], power(power(0.5, p), p), rtol=1e-15)
    for k in range(3):
        status, out = compiled_step(map[k], [np.nan])
        assert status == Status.NONFINITE
        assert np.isnan(out).all()


def test_choices_of_constants_do_not_hide_a_missing_state():
    """f(NaN) may be a number; the orbit has ended all the same, in iterate, step and loops."""
    map = Map(lambda x: (np.where(x[0] > 0, 1 / (x[0] - 1), 2.0), 0.5), 2)
    run = iterate(map, [[1.0, 0.0], [3.0, 0.0], [np.nan, 0.0]], 4, on_singular="ignore")
    assert run.failed_at.tolist() == [1, -1, 0]
    assert np.isnan(run.states[1:, [0, 2]]).all()
    assert np.isnan(map([np.nan, 0.0])).all()
    with pytest.warns(IntegrationWarning, match="1 of 2"):
        iterate(map, [[1.0, 0.0], [3.0, 0.0]], 4)


@pytest.mark.parametrize(
    "choice",
    [
        lambda p: np.where((p > 0) & (p < 2), p, 1.5),
        lambda p: np.maximum(p, 0.5),
        np.sign,
        lambda p: np.where(p > 0, np.where(p > 2, p, 3.0), 0.25),
    ],
    ids=["where", "maximum", "sign", "twice"],
)
def test_choices_between_parameters(choice):
    """Alone, and beside a choice of states by the same truth value, with columns, too."""
    p = np.array([-1.0, 1.0, 2.0, 3.0])
    map = Map(lambda x, p: (choice(p) * x[0], np.where(p > 0, x[1], -x[1])), 2, p=p)
    run = iterate(map, [3.0, 5.0], steps=2)
    assert np.array_equal(run.final[:, 0], choice(p) ** 2 * 3.0)
    assert np.array_equal(run.states[1, :, 1], [-5.0, 5.0, 5.0, 5.0])
    assert np.array_equal(iterate(map[3], [3.0, 5.0], steps=2).final, run.final[3])
    expected = np.sort([np.log(abs(choice(p))), 0 * p], axis=0)[::-1].T
    np.testing.assert_allclose(lyapunov_exponents(map, [3.0, 5.0], 4), expected, atol=1e-12)
    status, out = compiled_step(map[0], [3.0, 5.0])
    assert status == Status.OK
    assert np.array_equal(out, run.states[1, 0])


def test_long_lists_have_the_same_bits(monkeypatch):
    """NumPy takes maps of more operations than LLVM compiles soon."""
    x = starts(MAPS["lattice"], 9)
    expected = iterate(MAPS["lattice"], x, 20)
    monkeypatch.setattr(map_step, "LONGEST_MAP", 100)
    map_step.map_step.cache_clear()
    other = Map(lambda x, r: lattice(x, r), 30, r=3.9)
    assert not other._operations.usual
    assert iterate(other, x, 20) == expected
    map_step.map_step.cache_clear()
    with pytest.raises(ValueError, match="operations"):
        sf.compiled.system(other)


def test_files_datasets_and_stores(tmp_path):
    family = Map(lambda x, a, eps: henon(x, a, eps), "x y", a=[1.0, 1.2, 1.4], eps=0.3)
    run = iterate(family, np.zeros((3, 2)), 20)
    run.save(tmp_path / "run.npz")
    assert sf.load(tmp_path / "run.npz") == run
    assert pickle.loads(pickle.dumps(run)) == run
    data = run.to_xarray()
    assert data.eps.item() == 0.3
    assert np.array_equal(data.time, run.n)
    assert "eps" not in repr(run)
    store = sf.ensemble(family, np.zeros((3, 2)), tmp_path / "store.zarr", steps=20, chunks=2)
    assert np.array_equal(store.states, run.states)


def test_loops_of_users():
    constants = sf.compiled.system(HENON)
    memory, x = sf.compiled.work(constants), np.array([0.1, 0.2])
    twin = pickle.loads(pickle.dumps(constants))
    for expected in iterate(HENON, x, 20).states[1:]:
        assert sf.compiled.step_system(twin, x, x, memory) == Status.OK
        assert np.array_equal(x, expected)
    for lost in ([1e200, 0.0], [np.nan, 1.0]):
        status, out = compiled_step(HENON, lost)
        assert status == Status.NONFINITE
        assert np.isnan(out).all()
