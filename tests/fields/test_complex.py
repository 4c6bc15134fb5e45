"""Complex variables: NumPy's values of all functions, and motions and maps with exact solutions."""

import numpy as np
import pytest

from suslov_fast import Event, Field, Map, crossings, flow, iterate, load

rng = np.random.default_rng(0)
Z = rng.normal(size=200) + 1j * rng.normal(size=200)
A = np.array([[1, 2j, 0], [0, 1, 1], [1j, 0, 2.0]])
OF_ONE = {
    "exp log sqrt sin cos tan sinh cosh tanh conj square reciprocal angle abs real imag": None,
    "**2": lambda z: z**2,
    "**-3": lambda z: z**-3,
    "**0": lambda z: z**0,
    "**0.5": lambda z: z**0.5,
    "**-1.3": lambda z: z**-1.3,
    "**(1+2j)": lambda z: z ** (1 + 2j),
    "2**z": lambda z: 2**z,
    "abs**4": lambda z: abs(z) ** 4,
    "1/z": lambda z: 1 / z,
    "1j-z": lambda z: 1j - z,
    "where": lambda z: np.where(abs(z) > 1, z, 1j),
    "==": lambda z: np.where(z == 1, 2, z),
}
functions = {name: getattr(np, name) for name in next(iter(OF_ONE)).split()} | OF_ONE
of_one = {name: f for name, f in functions.items() if f}
of_arrays = {
    "sum": lambda z: z.sum(),
    "A@z": lambda z: (A @ z)[0],
    "z@A": lambda z: (z @ A)[0],
    "A.conj().T": lambda z: (A.conj().T @ z)[1],
    "conj(z)@A@z": lambda z: np.conj(z) @ A @ z,
    "vdot": lambda z: np.vdot(z, 1j * z),
    "norm": np.linalg.norm,
    "norm 2": lambda z: np.linalg.norm(z, 2),
    "norm of a matrix": lambda z: np.linalg.norm(np.outer(z, z)),
    "norm fro": lambda z: np.linalg.norm(np.outer(z, z), "fro"),
    "norm axis": lambda z: np.linalg.norm(z, axis=0),
    "correlate": lambda z: np.correlate(z, z)[0],
    "convolve": lambda z: np.convolve(z, z)[2],
    "var": np.var,
    "iscomplexobj": lambda z: z[0] if np.iscomplexobj(z) else z[1],
    "isrealobj": lambda z: z[0] if np.isrealobj(z) else z[1],
    "roll": lambda z: np.roll(z, 1)[0],
    "einsum": lambda z: np.einsum("i,i", z, z.conj()),
}


@pytest.mark.parametrize("name", of_one)
def test_functions_are_those_of_numpy(name):
    f = of_one[name]
    field = Field(lambda s: (f(s[0]) + 0j,), "z", complex=True)
    np.testing.assert_allclose(field(Z[:, None])[:, 0], f(Z) + 0j, rtol=1e-13, atol=1e-15)
    h = 1e-6
    slopes = (f(Z + h) - f(Z - h)) / (2 * h), (f(Z + 1j * h) - f(Z - 1j * h)) / (2 * h)
    found = field.jacobian(Z[:, None])
    columns = found[:, 0] + 1j * found[:, 1]
    smooth = abs(abs(Z) - 1) > 1e-5
    far = smooth & (abs(Z) > 0.2) & ((Z.real > 0) | (abs(Z.imag) > 0.1))
    np.testing.assert_allclose(columns[far].T, np.array(slopes)[:, far], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("name", of_arrays)
def test_functions_of_arrays_are_those_of_numpy(name):
    f, z = of_arrays[name], Z[:3]
    field = Field(lambda z: (f(z) + 0j, 0j, 0j), 3, complex=True)
    assert field(z)[0] == pytest.approx(complex(f(z)), rel=1e-13)


def test_large_complex_matrices_are_products():
    H = rng.normal(size=(40, 40)) + 1j * rng.normal(size=(40, 40))
    field, z = Field(lambda z: H @ z, 40, complex=True), Z[:40]
    np.testing.assert_allclose(field(z), H @ z, rtol=1e-12, atol=1e-12)
    assert len(field._equations.products[0].operations) < 500


def test_a_motion_is_exact_and_goes_through_files(tmp_path):
    motion = flow(lambda z: (1j * z[0],), [1 + 0j], time=[0, 1, 2])
    np.testing.assert_allclose(motion["x1"], np.exp(1j * motion.time), rtol=1e-9)
    motion.save(tmp_path / "m.npz")
    assert load(tmp_path / "m.npz") == motion
    again = flow(motion.body, motion.states[1], time=1.0)
    np.testing.assert_allclose(again.states[0], np.exp([2j]), rtol=1e-9)
    assert Field.from_dict(motion.body.to_dict()) == motion.body


def test_mixed_variables_events_and_parameters():
    f = Field(lambda s, c: (c * s[0] * np.cos(s[1]), 1.0), "z t", complex="z", c=[1j, -1 + 1j])
    motion = flow(f, {"z": 1 + 0j, "t": 0.0}, time=2.0)
    np.testing.assert_allclose(motion["z"][0], np.exp(np.array([1j, -1 + 1j]) * np.sin(2)), 1e-8)
    assert motion["t"].tolist() == [[2, 2]]
    decay = Field(lambda z: ((1j - 1) * z[0],), "z", complex=True)
    half = Event(lambda z: abs(z[0]) - 0.5, direction="down", to=lambda z: (2j * z[0],))
    events = flow(decay, [1 + 0j], time=1.0, events=half).events
    assert events.time == pytest.approx([np.log(2)])
    np.testing.assert_allclose(events.states, 2j * events.before)
    times = crossings(decay, [1 + 0j], "abs(z) - 0.5", time=1.0).time
    assert times == pytest.approx([np.log(2)])


def test_maps_and_the_map_of_kahan():
    c = rng.uniform(-0.2, 0.2, 50) + 1j * rng.uniform(-0.2, 0.2, 50)
    run = iterate(Map(lambda z, c: (z[0] ** 2 + c,), "z", complex=True, c=c), [0j], steps=20)
    z = 0 * c
    for _ in range(20):
        z = z**2 + c
    np.testing.assert_allclose(run["z"][-1], z, rtol=1e-12)
    riccati = Field(lambda z: (1 + z[0] ** 2,), "z", complex=True)
    orbit, z = iterate(riccati, [0.3j], eps=0.1, steps=50), 0.3j
    for _ in range(50):
        z = (z + 0.1) / (1 - 0.1 * z)
    assert orbit["z"][-1] == pytest.approx(z, rel=1e-12)


def test_what_is_refused():
    for f, names, said in [
        (lambda z: (1j * z[0],), {}, "complex="),
        (lambda z: (np.where(z[0] > 1, 1, 0),), {"complex": True}, "greater of a complex"),
        (lambda z: (z[0],), {"complex": "w"}, "names of variables"),
        (lambda z: (z[0],), {"complex": True, "mass": [[1]]}, "mass"),
    ]:
        with pytest.raises((TypeError, ValueError), match=said):
            Field(f, "z", **names)
    assert Field(lambda x, complex: (complex * x[0],), "x", complex=2.0)([3.0]) == [6]
