import copy
import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from test_promises import Chain

import suslov_fast as sf
from suslov_fast._bodies.base import Body
from suslov_fast._engine.problem import Map
from suslov_fast._maps import MAPS, map_named


def random_inertia(rng, shape=()):
    root = rng.normal(size=(*shape, 3, 3))
    matter = root @ root.swapaxes(-2, -1) + 0.1 * np.eye(3)
    return np.trace(matter, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - matter


def adapted(rotation, inertia):
    return rotation @ inertia @ rotation.swapaxes(-2, -1)


GYROSTAT = sf.SuslovGyrostat(2.3, 1.4, 0.5, -0.7, 0.9)
BODIES = [
    sf.Suslov3D(4, 1, -0.5, -0.3), sf.Suslov3D([[4.0], [0.1]], [1, 2, 3], -0.5, 1 / 3),
    sf.Suslov3D(4, 2, -0.5, -0.3, I3=[3.0, 4.0]), sf.SuslovND([1.3, 2.1, 3.7], [0.4, -0.7, 0.5]),
    sf.SuslovND(np.ones((2, 5)), np.full((3, 1, 5), 0.1)),
    GYROSTAT, sf.SuslovGyrostat(2.3, 1.4, 0.5, -0.7, [[0.0], [-0.9]]),
]  # fmt: skip
SHAPES = [(), (2, 3), (2,), (), (3, 2), (), (2, 1)]
each_body = pytest.mark.parametrize("body", BODIES, ids=lambda body: type(body).__name__)


def test_parameters_are_kept():
    I1 = np.array([1.0, 2.0, 3.0])
    body = sf.Suslov3D(I1, np.int32(1), -0.5, np.float32(0.25))
    I1[0] = 7
    assert body.I1.tolist() == [1, 2, 3]
    assert body.parameters[1:] == (1.0, -0.5, 0.25)
    assert all(type(parameter) is float for parameter in body.parameters[1:])
    assert body.I3 is None
    assert GYROSTAT.parameters == (2.3, 1.4, 0.5, -0.7, 0.9)
    assert [body.shape for body in BODIES] == SHAPES
    assert hash(sf.Suslov3D(1, 1, 0.0, 1)) == hash(sf.Suslov3D(1, 1, -0.0, 1))


@each_body
def test_equality_copies_and_immutability(body):
    assert body.batch_of_one  # what is cached does not count in comparisons
    plain = json.loads(json.dumps(body.to_dict()))
    copies = [pickle.loads(pickle.dumps(body)), copy.copy(body), copy.deepcopy(body)]
    for twin in [*copies, type(body).from_dict(plain), replace(body)]:
        assert twin == body
        assert hash(twin) == hash(body)
        assert twin.shape == body.shape
        assert twin.to_dict() == plain
    assert sf.body_from_dict(plain) == body
    kind, name = list(plain)[:2]
    assert plain[kind] == type(body).__name__
    assert replace(body, **{name: np.multiply(plain[name], 1.01)}) != body
    assert body != 4
    with pytest.raises(AttributeError):
        setattr(body, name, 3)
    for array in (each for each in body._values.values() if np.ndim(each)):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 7
        with pytest.raises(ValueError, match="cannot set WRITEABLE flag"):
            array.flags.writeable = True
    with pytest.raises(ValueError, match="expected the names"):
        type(body).from_dict({"body": plain[kind], "I1": 1})
    with pytest.raises(ValueError, match=f"body: expected '{plain[kind]}', got 'Other'"):
        type(body).from_dict(plain | {"body": "Other"})
    with pytest.raises(ValueError, match=r"body: expected one of 'Suslov3D', .* got 'Other'"):
        sf.body_from_dict(plain | {"body": "Other"})
    with pytest.raises(TypeError, match=r"parameters: expected a dictionary, .* got list"):
        type(body).from_dict([1])


def test_I3_is_a_part_of_a_body():
    with_it, without = (sf.Suslov3D(4, 2, -0.5, -0.3, I3) for I3 in (3, None))
    assert with_it != without
    assert with_it.to_dict() == without.to_dict() | {"I3": 3}
    omega = [1.0, 0.5, 0.1]
    whole = sf.iterate_full(without, omega, 0.2, 5, 3)
    for run in (sf.iterate_full(with_it, omega, 0.2, 5), whole.extend(0)):
        assert (run.omega == whole.omega).all()
        assert run.body == with_it
    assert (sf.step_full(with_it, omega, 0.2) == whole.omega[1]).all()
    assert sf.iterate_full(with_it, omega, 0.2, 5, 4).body.I3 == 4
    with pytest.raises(TypeError, match="I3: expected a number, or a body whose I3 is set"):
        sf.step_full(without, omega, 0.2)
    assert (sf.step(with_it, omega[:2], 0.2) == sf.step(without, omega[:2], 0.2)).all()


def test_an_I3_that_no_body_has():
    """One warning for a batch, none for copies, flat bodies, or the limits of the interval."""
    message = "I3: expected one that a body with these parameters can have .* got 20.0"
    for kind, k in ((sf.Suslov3D, ()), (sf.SuslovGyrostat, (0.1,))):
        for I3 in (20, [[3, 20], [20, 4]]):
            with pytest.warns(UserWarning, match=message) as caught:
                body = kind(4, 2, -0.5, -0.3, *k, I3=I3)
            assert [each.filename for each in caught] == [__file__]
            assert pickle.loads(pickle.dumps(body)) == body
    with pytest.warns(UserWarning, match=r"I3: .* got 3\.0"):
        sf.step_full(sf.Suslov3D(4, 1, -0.5, -0.3), [1.0, 0.5, 0.1], 0.2, 3)
    for unit in (1.0, 1e-300, 1e300):
        parameters = np.multiply([4, 2, -0.5, -0.3], unit)
        low, high = sf.Suslov3D(*parameters).admissible_I3()
        for end, inside in ((low, 1 + 1e-9), (high, 1 - 1e-9)):
            sf.Suslov3D(*parameters, I3=end * inside)
            with pytest.warns(UserWarning, match="I3: expected one"):
                sf.Suslov3D(*parameters, I3=end / inside)
    plate, rotation = np.diag([1.0, 2.0, 3.0]), np.linalg.qr(np.vander([0.3, 1.0, 2.0]))[0]
    sf.Suslov3D.from_inertia(rotation @ plate @ rotation.T, [1, 2, 3])


def test_text(rng):
    body = sf.Suslov3D(rng.uniform(1, 2, 1000), 1, 0.1, 0.2)
    assert repr(body) == "<Suslov3D of shape (1000,): I1=(1000,), I2=1.0, I13=0.1, I23=0.2>"
    assert repr(GYROSTAT) == "SuslovGyrostat(I1=2.3, I2=1.4, I13=0.5, I23=-0.7, k=0.9)"
    assert max(len(repr(each)) for each in BODIES) < 120


SPECIAL_AXES = [[0, 0, -1], [1, 0, 0], [1e-9, 0, -1], [0, -1, 0]]


@pytest.mark.parametrize(
    ("shape", "axis"),
    [((), (3,)), ((50,), (50, 3)), ((4, 1), (3, 3)), *(((), axis) for axis in SPECIAL_AXES)],
)
def test_from_inertia(rng, shape, axis):
    inertia = random_inertia(rng, shape)
    axis = rng.normal(size=axis) if isinstance(axis, tuple) else np.array(axis)
    body, rotation = sf.Suslov3D.from_inertia(inertia, axis)
    assert rotation.shape[:-2] == body.shape == np.broadcast_shapes(shape, axis.shape[:-1])
    assert abs(adapted(rotation, np.eye(3)) - np.eye(3)).max() < 1e-14
    assert (np.linalg.det(rotation) > 0).all()
    length = np.linalg.norm(axis, axis=-1)[..., None]
    turned_axis = (rotation @ axis[..., None])[..., 0] / length
    assert abs(turned_axis - [0, 0, 1]).max() < 1e-14
    I1, I2, I13, I23 = body.parameters
    expected = np.array([[I1, 0 * I1, I13], [0 * I1, I2, I23], [I13, I23, body.I3]])
    turned = np.moveaxis(adapted(rotation, inertia), (-2, -1), (0, 1))
    assert abs(turned - expected).max() < 1e-14 * abs(inertia).max()


@pytest.mark.parametrize("axis", [[0, 0, 1], [0, 0, 5], [0, 0, 1e-200], [0, 0, 1e200]])
@pytest.mark.parametrize("I1", [2.0, 3.0, 4.0])
def test_an_adapted_basis_is_kept(axis, I1):
    inertia = [[I1, 0, -0.5], [0, 2, -0.3], [-0.5, -0.3, 3]]
    body, rotation = sf.Suslov3D.from_inertia(inertia, axis)
    assert body == sf.Suslov3D(I1, 2, -0.5, -0.3, 3)
    assert (rotation == np.eye(3)).all()


def test_admissible_I3(rng):
    """tr(T)/2 - T is positive definite just inside the interval but not just outside it."""
    I1, I2 = 10 ** rng.uniform(-1, 1, (2, 400))
    I13, I23 = rng.uniform(-1, 1, (2, 400)) * np.minimum(I1, I2)
    I13[::7] = 0.0
    I2[::5] = I1[::5]
    low, high = sf.Suslov3D(I1, I2, I13, I23).admissible_I3()

    def least(I3):
        zero = np.zeros(400)
        T = np.array([[I1, zero, I13], [zero, I2, I23], [I13, I23, I3 + zero]]).T
        return np.linalg.eigvalsh((I1 + I2 + I3)[:, None, None] / 2 * np.eye(3) - T)[:, 0]

    exists = ~np.isnan(low)
    assert 20 < exists.sum() < 380
    assert (np.isnan(high) == ~exists).all()
    width = 1e-6 * (high - low)
    for inside, outside in ((low + width, low - width), (high - width, high + width)):
        assert (least(np.where(exists, inside, 1))[exists] > 0).all()
        assert (least(np.where(exists, outside, 1))[exists] < 0).all()
    for I3 in np.linspace(0, 25, 101):
        assert (least(I3)[~exists] < 1e-12).all()
    low, high = sf.Suslov3D(3, 3, -0.2, -0.2).admissible_I3()
    for k in (-600, 600):
        ends = sf.Suslov3D(*np.ldexp([3, 3, -0.2, -0.2], k)).admissible_I3()
        assert ends == (np.ldexp(low, k), np.ldexp(high, k))
    assert sf.Suslov3D(3, 2, 0, 0).admissible_I3() == (1.0, 5.0)
    # For I1 = I2 the ends s obey s (2 I1 - s) = 4 (I13**2 + I23**2): for a thin rod one is small.
    low, high = sf.Suslov3D(3, 3, 3e-9, 4e-9).admissible_I3()
    assert (low, high) == pytest.approx((1e-16 / 6, 6), rel=1e-15)


@pytest.mark.parametrize("pole", [False, True])
def test_a_body_with_a_field_has_what_all_fields_have(rng, pole):
    """Next to a pole, too, whose eps is that of a real eigenvalue of f'."""
    top, x = Chain(0.0, 1.0), np.array([1.5, -0.5, 2.0])
    field = sf.QuadraticField.of(top)
    assert field == top.field()
    identity = sf.matrix(field, x, 0.0)
    slopes = 2 * (identity - sf.matrix(field, x, 1.0))
    real = max(np.linalg.eigvals(slopes), key=lambda value: value.real).real
    eps = 2 / real * (1 + 1e-9) if pole else 0.1
    states = xr.DataArray(x, dims="component", coords={"component": [*"abc"]})
    assert (sf.vector_field(top, states) == sf.vector_field(field, x)).all()
    for function in (sf.matrix, sf.jacobian):
        assert (function(top, states, eps) == function(field, x, eps)).all()
    exponents = sf.lyapunov_exponents(top, states, eps, 5)
    assert (exponents == sf.lyapunov_exponents(field, x, eps, 5)).all()
    assert np.isfinite(exponents).all()
    with pytest.raises(ValueError, match="the components"):
        sf.jacobian(top, states[::-1], eps)
    rest = np.array([2.0, 0.0, 0.0])
    assert (sf.multipliers(top, rest, 0.1) == sf.multipliers(field, rest, 0.1)).all()
    for function in (sf.first_integral, sf.criticality):
        with pytest.raises(TypeError, match=r"body: expected Suslov3D or .*, got Quadratic"):
            function(top, x, eps)
    with pytest.raises(TypeError, match=r"body: expected Suslov3D or .*, got Body"):
        sf.jacobian(Body(), x, eps)
    with pytest.raises(TypeError, match="body: expected one with a quadratic vector field, got"):
        sf.QuadraticField.of(Body())


def test_a_body_with_a_field_needs_no_kernel(monkeypatch, tmp_path):
    """Its record names what fields have."""
    of = vars(map_named("quadratic"))
    record = Map(**of | {"name": "top", "body": Chain, "title": "Top", "variable": "spin"})
    monkeypatch.setitem(MAPS, "top", record)
    top, starts = Chain(0.0, 1.0), np.array([[1.5, -0.5, 2.0], [0.3, 1.0, -1.0]])
    run = sf.iterate(top, starts, 0.1, 7)
    assert (run.spin == sf.iterate(top.field(), starts, 0.1, 7).x).all()
    assert (sf.step(top, run.spin[:-1], 0.1) == run.spin[1:]).all()
    run.save(tmp_path / "run.npz")
    assert sf.Trajectories.load(tmp_path / "run.npz").extend(3) == run.extend(3)
