"""Tests of integrals that fields keep, and of subsystems: what is proved, and what is refused."""

import pickle
from fractions import Fraction

import numpy as np
import pytest

from suslov_fast import Event, Field, flow
from suslov_fast.fields.proofs import changes_of


def oscillator(c):
    return Field(lambda x, c: (x[1], -x[0] - c * x[1]), "x y", c=c)


def radius(x):
    return x @ x


KEPLER = Field(
    lambda x: (x[2], x[3], -x[0] / (x[0] ** 2 + x[1] ** 2) ** 1.5, -x[1] / (x[:2] @ x[:2]) ** 1.5),
    "x y u v",
)
DOUBLE_PENDULUM = Field.from_lagrangian(
    lambda q, v, g: (
        v[0] ** 2
        + v[1] ** 2 / 2
        + v[0] * v[1] * np.cos(q[0] - q[1])
        + g * (2 * np.cos(q[0]) + np.cos(q[1]))
    ),
    "a b",
    g=9.81,
)
PROVED = {
    "momentum": lambda: KEPLER.conserving(lambda x: x[0] * x[3] - x[1] * x[2]),
    "energy with roots": lambda: KEPLER.conserving(
        lambda x: (x[2] ** 2 + x[3] ** 2) / 2 - (x[0] ** 2 + x[1] ** 2) ** -0.5,
    ),
    "letters": lambda: Field(lambda x, k: (x[1], -k * x[0]), "x v", k=[1.0, 2.0]).conserving(
        lambda x, k: k * x[0] ** 2 + x[1] ** 2
    ),
    "logarithms": lambda: Field(
        lambda x: (x[0] * (1 - x[1]), 2 * x[1] * (x[0] - 1)), "u v"
    ).conserving(lambda x: 2 * (x[0] - np.log(x[0])) + x[1] - np.log(x[1])),
    "decimals": lambda: Field(
        lambda x: (0.3 * x[1] * x[2], -0.1 * x[0] * x[2], 0.7 * x[0] * x[1]), 3
    ).conserving(lambda x: 0.1 * x[0] ** 2 + 0.3 * x[1] ** 2),
    "H": lambda: Field.from_hamiltonian(
        lambda x: x[1] ** 2 / 2 + abs(np.sin(x[0])) ** 1.3, "q p"
    ).conserving(),
    "Lagrangian": DOUBLE_PENDULUM.conserving,
    "complex": lambda: Field(
        lambda z: (1j * (z[1] - abs(z[0]) ** 2 * z[0]), 1j * (z[0] - abs(z[1]) ** 2 * z[1])),
        "a b",
        complex=True,
    ).conserving(lambda z: abs(z[0]) ** 2 + abs(z[1]) ** 2),
}


@pytest.mark.parametrize("make", PROVED.values(), ids=PROVED)
def test_integrals_that_are_proved(make):
    field = make()
    assert changes_of(field) is None
    assert changes_of(pickle.loads(pickle.dumps(field))) is None


def test_integrals_that_are_not_proved_are_tested_again():
    kept = oscillator(0.0).conserving(radius)
    assert changes_of(kept).which == [0]  # for c = 0 alone
    assert kept.with_parameters(c=0.0) == kept
    for c in (1e-8, -1e-3, [0.0, 1e-8]):
        with pytest.raises(ValueError, match="function 0 changes"):
            kept.with_parameters(c=c)
    motion = flow(kept, [1.0, 0.0], time=1e4)
    assert radius(motion.final) == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize("members", [1, 3, 30, 5000])
def test_all_members_are_tested(members):
    c = np.zeros(members)
    oscillator(c).conserving(radius)
    c[-1] = 1e-8
    with pytest.raises(ValueError, match=r"function 0 changes .*c=1e-08"):
        oscillator(c).conserving(radius)


def test_small_changes_are_refused():
    with pytest.raises(ValueError, match="function 0 changes"):
        oscillator(2e-10).conserving(radius)
    with pytest.raises(ValueError, match="function 1 changes"):
        Field(lambda x: (x[1], -np.where(x[0] > 1.5, 0.01 * x[1], 0) - x[0]), 2).conserving(
            lambda x: 1.0 + 0 * x[0], radius
        )


# ------------------------------------------------------------------------------ subsystems
def test_subsystems_by_formulas():
    field = Field(
        lambda x, a: (-x[0] + x[1] * x[0] - x[0] * x[1], a * x[0] * x[1]), "x y", a=[1, 2]
    )
    assert str(field.subsystem("x")[0]) == "Field(x' = -x, a = 1.0)"
    cancels = Field(lambda x: (x[0] * (x[1] ** 2 + 1) / (2 * x[1] ** 2 + 2), x[1]), "x y")
    assert cancels.subsystem("x")([3.0]) == [1.5]
    jump = Field(lambda x: (-x[0] + np.where(x[1] > 6, 100, 0), 0 * x[1]), "x y")
    assert str(jump.subsystem("x", y=7)) == "Field(x' = -x + 100)"
    assert str(jump.subsystem("x", y=5)) == "Field(x' = -x)"


REFUSED = {
    "a member": (lambda x, a: (-x[0] + a * x[1], 0 * x[1]), {"a": [0, 1]}, "depends .* y"),
    "a parameter": (lambda x, a: (-x[0] + a * x[1], 0 * x[1]), {"a": 0.0}, "depends .* y"),
    "far away": (
        lambda x: (-x[0] + np.where(x[1] > 6, 100, 0), 0 * x[1]),
        {},
        "depends on other variables: y",
    ),
    "no value at 0": (lambda x: (x[0] * np.sin(x[1]) / np.sin(x[1]), x[1]), {}, "no value"),
}


@pytest.mark.parametrize(("f", "parameters", "said"), REFUSED.values(), ids=REFUSED)
def test_subsystems_that_depend_on_others(f, parameters, said):
    with pytest.raises(ValueError, match=said):
        Field(f, "x y", **parameters).subsystem("x")


def test_errors_of_subsystems():
    field = Field(lambda x: (-x[0], x[0] * x[1]), "x y")
    with pytest.raises(ValueError, match="variables of the field, x, y"):
        field.subsystem("w")
    with pytest.raises(ValueError, match="values of other variables, y, not z"):
        field.subsystem("x", z=1.0)


def test_fields_of_terms():
    turning = np.array([[0, 1], [-1, 0]])
    field = Field.from_terms(np.zeros((2, 2, 2)), turning)
    kept = field.conserving(radius)
    assert kept == Field(lambda x: (x[1], -x[0]), 2).conserving(radius)
    assert changes_of(kept) is None
    family = Field.from_terms(np.zeros((2, 2, 2, 2)), [turning, 2 * turning], names="c d")
    with pytest.raises(ValueError, match="function 0 changes"):
        Field.from_terms(np.zeros((2, 2, 2, 2)), [turning, turning + 1e-8]).conserving(radius)
    kept = family.conserving(radius)
    assert Field.from_dict(kept.to_dict()) == kept
    states = flow(kept, [1.0, 0.0], time=[10.0, 100.0], rtol=1e-3).states
    np.testing.assert_allclose((states**2).sum(axis=-1), 1.0, rtol=1e-12)
    decay = Field.from_terms([[[1, 0], [0, 0]], [[0, 1], [0, 0]]], [[Fraction(-1, 3), 0], [0, 2]])
    assert str(decay.subsystem("x1")) == "Field(x1' = x1*x1 + -1/3*x1)"
    late = flow(decay, [0.1, 1.0], time=9.0, events=Event(lambda t, x: x[0] - t, terminal=True))
    assert late.final[0] == pytest.approx(late.end)


def test_subsystems_keep_what_belongs_to_them():
    field = Field.from_hamiltonian(lambda x: (x[:2] @ x[:2] + x[2:] @ x[2:]) / 2, "a b c d")
    field = field.conserving(lambda x: x[0] ** 2 + x[2] ** 2, lambda x: x[1] ** 2 + x[3] ** 2)
    part = field.subsystem("a c")
    states = flow(part, [1.0, 0.0], time=[1e2, 1e4], rtol=1e-6).states
    np.testing.assert_allclose((states**2).sum(axis=1), 1.0, rtol=1e-14)
    with pytest.raises(TypeError, match="no Hamiltonian"):
        part.energy([1.0, 0.0])  # it depends on b and d
    forced = Field(lambda t, y: (np.cos(t) - y[0], -y[1]), "x y")
    assert forced.subsystem("x").jacobian([1.0], t=2.0) == [[-1.0]]
    assert forced.subsystem("y") == Field(lambda y: (-y[0],), "y")
    points = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[1], "x y z", constraints=lambda q, v: q[:2] @ q[:2] - 1
    )
    assert str(points.subsystem("z vz")) == "Field(z' = vz, vz' = 0)"
    with pytest.warns(UserWarning, match="has no constraints"):
        points.subsystem("x y vx vy")


def test_rates_that_are_the_first_variable():
    """dI/dt is x[0] itself."""
    field = Field(lambda x: (-0.5 * x[0], x[0]), "a b")
    with pytest.raises(ValueError, match="function 0 changes along the motion"):
        field.conserving(lambda x: x[1])
    kept = field.conserving(lambda x: 2 * x[0] + x[1])
    assert changes_of(kept) is None
    np.testing.assert_allclose(
        flow(kept, [1.0, 0.0], time=5.0).final, [np.exp(-2.5), 2 - 2 * np.exp(-2.5)]
    )
