"""Complex variables: NumPy's values of all functions, and motions and maps with exact solutions."""

import mpmath
import numpy as np
import pytest

from suslov_fast import Event, Field, Map, crossings, flow, iterate, load

rng = np.random.default_rng(0)
Z = rng.normal(size=200) + 1j * rng.normal(size=200)
A = np.array([[1, 2j, 0], [0, 1, 1], [1j, 0, 2.0]])
OF_ONE = {
    "exp log sqrt sin cos tan sinh cosh tanh conj square reciprocal angle abs real imag "
    "arcsin arccos arctan arcsinh arccosh arctanh expm1 exp2 log2 log10": None,
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


def test_quotients_and_functions_of_any_size():
    field = Field(lambda s: (1 / s[0], np.tanh(s[0]), np.log1p(s[0])), 3, complex=True)
    z = np.array([1e200 - 1e200j, 1e-200 + 2e-200j, 1e300j, 400 + 1j, -400 + 0.3j, 1e-9 + 1e-9j])
    found = field(np.stack([z] * 3, axis=-1))
    with mpmath.workdps(40):
        exact = [[1 / mpmath.mpc(a), mpmath.tanh(a), mpmath.log1p(a)] for a in z]
        np.testing.assert_allclose(found, np.array(exact, complex), rtol=1e-14)
    slope = -1 / (1e-100 + 2e-100j) ** 2  # NumPy's square is 5e-200
    found = field.jacobian([1e-100 + 2e-100j, 0.1, 0.1])[:2, :2]
    expected = [[slope.real, -slope.imag], [slope.imag, slope.real]]
    np.testing.assert_allclose(found, expected, rtol=1e-14)


def test_signs_and_powers_of_zero_are_those_of_numpy():
    def f(z):
        return np.sign(z[0]), z[0] ** (1 + 1j), z[0] ** 0.5

    assert Field(f, 3, complex=True)([0j, 0, 0]).tolist() == [*f(np.zeros(1, complex))] == [0, 0, 0]


def test_rates_make_a_function_complex():
    """x0 = 1.0 of z' = i z is the complex number 1."""
    motion = flow(lambda z: (1j * z[0], -z[1]), [1.0, 2.0], time=1.0)
    np.testing.assert_allclose(motion.final, [np.exp(1j), 2 * np.exp(-1)], rtol=1e-8)
    with pytest.raises(TypeError, match="complex="):
        Field(lambda z: (1j * z[0],), "z")


def test_complex_parameters_have_one_name():
    c = np.array([1j, 2j, -1 + 1j])
    family = Field(lambda z, c: (c * z[0],), "z", complex=True, c=c)
    assert family.parameters["c"].tolist() == c.tolist()
    assert family.sel(c=2j) == family[1]
    run = flow(family, [1 + 0j], time=[0, 0.5], derivatives="c x0")
    by_c = run.derivatives["c"][-1]  # d exp(c t) = t exp(c t) dc
    slopes = 0.5 * np.exp(0.5 * c)
    np.testing.assert_allclose(by_c[:, 0], np.stack([slopes.real, -slopes.imag], -1), rtol=1e-8)
    np.testing.assert_allclose(by_c[:, 1], np.stack([slopes.imag, slopes.real], -1), rtol=1e-8)
    event = Event(lambda z: abs(z[0]) - 0.5)
    events = flow(family[2], [1 + 0j], time=1.0, events=event, derivatives="c").events
    np.testing.assert_allclose(events.derivatives["c"].time, [[np.log(2), 0]], atol=1e-8)


def test_masses_are_complex_matrices():
    A = np.array([[1j, 0.2], [0.1, -1 + 0.5j]])
    z = Z[:10].reshape(5, 2)
    M = np.array([[2, 1j], [-0.5j, 3 + 1j]])
    field = Field(lambda z: A @ z, "z w", complex=True, mass=M)
    np.testing.assert_allclose(field(z), np.linalg.solve(M, (z @ A.T).T).T, rtol=1e-13)

    def of(z):
        return [[2 + z[0], 1j * z[1]], [-0.5j, 3 + 1j]]

    field = Field(lambda z: A @ z, "z w", complex=True, mass=of)
    expected = [np.linalg.solve(np.array(of(each)), A @ each) for each in z]
    np.testing.assert_allclose(field(z), expected, rtol=1e-12)
    mixed = Field(lambda z: [1j * z[0], -z[1]], "z r", complex="z", mass=[[1j, 2], [0, 2]])
    np.testing.assert_allclose(mixed([1 + 1j, 2]), [1 - 1j, -1], rtol=1e-14)
    with pytest.raises(ValueError, match="row of r"):
        Field(lambda z: [1j * z[0], -z[1]], "z r", complex="z", mass=[[1, 0], [1j, 1]])


def test_what_is_refused():
    for f, names, said in [
        (lambda z: (1j * z[0],), {}, "complex="),
        (lambda z: (np.where(z[0] > 1, 1, 0),), {"complex": True}, "greater of a complex"),
        (lambda z: (z[0],), {"complex": "w"}, "names of variables"),
        (lambda z: (z[0],), {"complex": True, "mass": [[1, 2]]}, "mass"),
    ]:
        with pytest.raises((TypeError, ValueError), match=said):
            Field(f, "z", **names)
    assert Field(lambda x, complex: (complex * x[0],), "x", complex=2.0)([3.0]) == [6]
