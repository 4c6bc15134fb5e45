"""Bodies: parameters, families, copies, adapted bases, and the range of I3."""

import pickle

import numpy as np
import pytest
from last_digits import PROCESSORS, other_last_digits
from samples import random_inertia

from suslov_fast import Suslov3D, SuslovND, equilibria, flow, iterate, kahan

GYROSTAT = Suslov3D(2.3, 1.4, 0.5, -0.7, 0.9)
SINGLE = [Suslov3D(4, 1, -0.5, -0.3), SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5]), GYROSTAT]


def adapted(rotation, inertia):
    return rotation @ inertia @ rotation.swapaxes(-2, -1)


def test_parameters_are_kept():
    I1 = np.array([1.0, 2.0, 3.0])
    body = Suslov3D(I1, np.int32(1), -0.5, np.float32(0.25))
    I1[0] = 7
    assert body.I1.tolist() == [1, 2, 3]
    assert (body.I2, body.I13, body.I23, body.I3) == (1.0, -0.5, 0.25, None)
    assert type(body.I2) is float


def test_what_counts_as_equal():
    assert Suslov3D(1, 1, 0.0, 1) == Suslov3D(1, 1, -0.0, 1)
    assert hash(Suslov3D(1, 1, 0.0, 1)) == hash(Suslov3D(1, 1, -0.0, 1))
    assert Suslov3D(4, 2, -0.5, -0.3, I3=3) != Suslov3D(4, 2, -0.5, -0.3)
    assert Suslov3D(4, 1, -0.5, -0.3) == Suslov3D(4, 1, -0.5, -0.3, 0)
    assert Suslov3D(4, 1, -0.5, -0.3) != Suslov3D(4, 1, -0.5, -0.3, 1)
    assert SuslovND(J=[1, 2], I=[0.3, 0.4]) != SuslovND(J=[1, 2], I=[0.3, 0.5])
    large = Suslov3D(np.linspace(1, 2, 1000), 1, 0.1, 0.2)
    assert repr(large) == (
        "<Suslov3D of shape (1000,): I1: 1000 values from 1 to 2, I2=1.0, I13=0.1, I23=0.2>"
    )


def test_the_text_of_a_single_body_is_a_call(rng):
    tensor, matter = random_inertia(rng), random_inertia(rng, (3,)).reshape(9, 3)
    bodies = [
        Suslov3D.from_inertia(tensor, [0.1, -0.2, 1]),
        Suslov3D.from_inertia(tensor, [0.1, -0.2, 1], 1 / 3),
        SuslovND.from_mass_tensor(matter @ matter.T + np.eye(9), rng.normal(size=9)),
    ]
    for body in (*SINGLE, *bodies):
        assert eval(repr(body)) == body


GRID = Suslov3D([[4.0], [0.1]], [1, 2, 3], -0.5, np.full((1, 3), 1 / 3))
MASK = np.array([[True, False, True], [False, False, True]])
INDICES = [
    (1, 2), (-1, slice(1, None)), (slice(None), [2, 0]), [False, True], (slice(None), MASK[0]),
    MASK[:, 0], ~MASK[:, 0] & False, (0, MASK[0]), np.int64(1), (slice(1, 1),),
]  # fmt: skip


@pytest.mark.parametrize("index", INDICES, ids=repr)
def test_members_along_several_axes(index):
    """They have the parameters that NumPy selects, and share what all members share."""
    member = GRID[index]
    for name, value in GRID.parameters.items():
        expected = np.broadcast_to(value, GRID.shape)[index]
        assert member.shape == expected.shape
        assert (np.broadcast_to(member.parameters[name], expected.shape) == expected).all()
    assert np.ndim(member.I13) == 0
    several = SuslovND(J=np.arange(1.0, 25).reshape(2, 3, 4), I=[0.1, 0.2, 0.3, 0.4])
    assert (several.J[index] == several[index].J).all()
    assert several[index].I.tolist() == several.I.tolist()


def test_selection_by_value():
    bodies = Suslov3D([[4.0], [0.1]], [1, 2, 3], -0.5, 1 / 3)
    assert bodies.sel(I1=0.1) == bodies[1]
    assert bodies.sel(I2=2, I1=4) == bodies[0][1]
    assert Suslov3D([4.0], 1, 0, 0).sel(I1=4) == Suslov3D(4, 1, 0, 0)
    with pytest.raises(ValueError, match=r"I2 .* I1"):
        Suslov3D([4.0, 0.1], [1], -0.5, 1 / 3).sel(I2=1)  # its value is that of both members
    with pytest.raises(KeyError, match="I1"):  # equal, not close
        bodies.sel(I1=np.nextafter(4.0, 5.0))
    with pytest.raises(ValueError, match=r"I1 .* index"):
        Suslov3D([[1, 2], [3, 4]], 1, 0, 0).sel(I1=1.0)


def test_admissible_I3(rng):
    """tr(T)/2 - T is positive definite just inside the interval but not just outside it."""
    I1, I2 = 10 ** rng.uniform(-1, 1, (2, 400))
    I13, I23 = rng.uniform(-1, 1, (2, 400)) * np.minimum(I1, I2)
    I13[::7] = 0.0
    I2[::5] = I1[::5]
    low, high = Suslov3D(I1, I2, I13, I23).admissible_I3()

    def least(I3):
        zero = np.zeros(400)
        T = np.array([[I1, zero, I13], [zero, I2, I23], [I13, I23, I3 + zero]]).T
        return np.linalg.eigvalsh((I1 + I2 + I3)[:, None, None] / 2 * np.eye(3) - T)[:, 0]

    exists = ~np.isnan(low)
    assert 20 < exists.sum() < 380
    width = 1e-6 * (high - low)
    for end, inwards in ((low, width), (high, -width)):
        assert (least(np.where(exists, end + inwards, 1))[exists] > 0).all()
        assert (least(np.where(exists, end - inwards, 1))[exists] < 0).all()
    for I3 in np.linspace(0, 25, 101):
        assert (least(I3)[~exists] < 1e-12).all()
    assert Suslov3D(3, 2, 0, 0).admissible_I3() == (1.0, 5.0)


def test_flat_bodies_have_rounding_errors(rng):
    """Plates that are moved away and back, for which the triangle inequality is an equality."""
    for _ in range(200):
        p, d = rng.uniform(0.1, 2.0, 2), rng.uniform(-10, 10, 3)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        shift = d @ d * np.eye(3) - np.outer(d, d)
        tensor = turn @ np.diag([*p, p.sum()]) @ turn.T + shift - shift
        Suslov3D.from_inertia((tensor + tensor.T) / 2, rng.normal(size=3))
    Suslov3D.from_inertia(np.diag([1, 1, 2 + 1.9e-12]), [0, 0, 1])
    with pytest.raises(ValueError, match="triangle"):
        Suslov3D.from_inertia(np.diag([1, 1, 2 + 3e-12]), [0, 0, 1])


SPECIAL_AXES = [[0, 0, -1], [1, 0, 0], [1e-9, 0, -1], [0, -1, 0]]


@pytest.mark.parametrize(
    ("shape", "axis"),
    [((), (3,)), ((50,), (50, 3)), ((4, 1), (3, 3)), *(((), axis) for axis in SPECIAL_AXES)],
)
def test_from_inertia(rng, shape, axis):
    inertia = random_inertia(rng, shape)
    axis = rng.normal(size=axis) if isinstance(axis, tuple) else np.array(axis)
    body = Suslov3D.from_inertia(inertia, axis)
    rotation = body.rotation
    assert rotation.shape[:-2] == body.shape == np.broadcast_shapes(shape, axis.shape[:-1])
    assert abs(adapted(rotation, np.eye(3)) - np.eye(3)).max() < 1e-14
    assert (np.linalg.det(rotation) > 0).all()
    length = np.linalg.norm(axis, axis=-1)[..., None]
    assert abs((rotation @ axis[..., None])[..., 0] / length - [0, 0, 1]).max() < 1e-14
    I1, I2, I13, I23 = body.I1, body.I2, body.I13, body.I23
    expected = np.array([[I1, 0 * I1, I13], [0 * I1, I2, I23], [I13, I23, body.I3]])
    turned = np.moveaxis(adapted(rotation, inertia), (-2, -1), (0, 1))
    assert abs(turned - expected).max() < 1e-14 * abs(inertia).max()


def test_an_adapted_basis_is_kept():
    for I1, axis in ((2.0, [0, 0, 1]), (3.0, [0, 0, 5]), (4.0, [0, 0, 1e-150])):
        inertia = [[I1, 0, -0.5], [0, 2, -0.3], [-0.5, -0.3, 3]]
        body = Suslov3D.from_inertia(inertia, axis)
        assert body == Suslov3D(I1, 2, -0.5, -0.3, I3=3)
        assert (body.rotation == np.eye(3)).all()


@pytest.mark.parametrize("unit", [1e-46, 1.0, 1e37])
def test_products_that_are_rounding_errors_are_zero(rng, unit):
    """An axis of symmetry, of molecules and of planets too, has no products of inertia."""
    for _ in range(20):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        tensor = unit * turn @ np.diag([2.0, 2.5, 3.0]) @ turn.T
        body = Suslov3D.from_inertia((tensor + tensor.T) / 2, turn[:, 2])
        assert max(abs(body.I13), abs(body.I23)) in (0, pytest.approx(unit * 2e-15, rel=1))
        assert "-0.0" not in repr(body)
        matter = unit * turn @ np.diag([1.0, 2.0, 3.0]) @ turn.T
        SuslovND.from_mass_tensor((matter + matter.T) / 2, turn[:, 2])


def test_from_mass_tensor(rng):
    for n in (2, 3, 4, 7):
        root = rng.normal(size=(n, n))
        matter, axis = root @ root.T, rng.normal(size=n)
        body = SuslovND.from_mass_tensor(matter, axis)
        rotation = body.rotation
        turned = adapted(rotation, matter)
        assert body.dimension == n - 1
        assert np.linalg.det(rotation) > 0
        assert abs(turned[:-1, -1] - body.I).max() < 1e-13 * abs(matter).max()
        assert abs(np.diag(turned)[:-1] + turned[-1, -1] - body.J).max() < 1e-13 * body.J.max()
        assert abs(rotation @ axis / np.linalg.norm(axis) - np.eye(n)[-1]).max() < 1e-14
        block = turned[:-1, :-1]
        assert abs(block - np.diag(np.diag(block))).max() < 1e-14 * abs(matter).max()
        about_last = SuslovND.from_mass_tensor(matter, np.eye(n)[-1])
        assert SuslovND.from_mass_tensor(matter) == about_last


def test_constants_do_not_depend_on_the_processor(rng):
    """Orbits go on from them."""
    inertia, axes = random_inertia(rng, (4,)), rng.normal(size=(4, 3))
    root = rng.normal(size=(3, 6, 6))
    matter = root @ np.swapaxes(root, 1, 2)
    found = []
    for seed in PROCESSORS:
        with other_last_digits(seed):
            body = Suslov3D.from_inertia(inertia, axes)
            other = SuslovND.from_mass_tensor(matter, axes[:3, [0, 1, 2, 0, 1, 1]])
        found.append([*body.parameters.values(), body.rotation, other.J, other.I, other.rotation])
    for each in found[1:]:
        for one, first in zip(each, found[0], strict=True):
            np.testing.assert_array_equal(one, first)


def test_rotations_belong_to_members_and_their_copies(rng):
    """Members, copies, dictionaries and runs of members keep the rotation; equality ignores it."""
    families = [
        Suslov3D.from_inertia(random_inertia(rng, (3, 1)), rng.normal(size=(2, 3)), [0.0, 0.5]),
        SuslovND.from_mass_tensor(np.eye(4) + 0.1 * np.ones((4, 4)), rng.normal(size=(3, 2, 4))),
    ]
    for family in families:
        assert family.rotation.shape[:2] == family.shape == (3, 2)
        assert family.parameters.keys() & {"rotation"} == set()
        one = family[2, 1]
        copies = one, pickle.loads(pickle.dumps(one)), type(one).from_dict(one.to_dict())
        for each in (*copies, family[2][1], family[1:][1, -1]):
            assert (each.rotation == family.rotation[2, 1]).all()
        assert iterate(family, np.ones(one.dimension), 0.1, 2).member((2, 1)).body == one
        plain = type(one)(**one.parameters)
        assert plain.rotation is None
        assert plain == one


def test_members_of_a_family_with_and_without_rotors(rng):
    family, x = Suslov3D(4, 1, -0.5, -0.3, [0.0, 0.7]), rng.normal(size=2)
    for value in (
        lambda body: body(x),
        lambda body: body.exact(x, 0.2, 7),
        lambda body: np.array(body.limits(x, 0.2)).swapaxes(0, -2),
        lambda body: iterate(body, x, 0.2, 40).final,
        lambda body: flow(body, x, time=3.0).final,
        lambda body: kahan.invariant_density(body, x, 0.2),
        lambda body: kahan.multipliers(body, [0.0, 0.0], 0.2),
        lambda body: body.first_integral(x, 0.2),
        lambda body: body.momentum(x),
    ):
        for i in range(2):
            np.testing.assert_array_equal(value(family)[i], value(family[i]))
    resting = equilibria(family, near=[0.9, -1.4]).states
    np.testing.assert_allclose(family(resting), 0, atol=1e-14)
    assert resting[0].tolist() == equilibria(family[0], near=[0.9, -1.4]).states.tolist()


def test_numbers_that_no_body_has_are_told_of():
    J, I = [1.3, 2.1, 3.7], [0.4, 0.7, 0.5]
    with pytest.warns(UserWarning, match="I_1"):
        assert SuslovND(J=I, I=J).dimension == 3
