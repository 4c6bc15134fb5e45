"""Each two of ten things that meet at the joints of the package: right, or one error.

All systems turn a point of the plane with the phase p(t) = w t, or w (t + sin(t) / 2) if they read
the time; so states, derivatives and exponents are known.
"""

import itertools
import pickle

import numpy as np
import pytest

from suslov_fast import Event, Field, compiled, flow, load, lyapunov_exponents

OF_SYSTEMS = "time", "complex", "constraints", "integrals", "families"
OF_CALLS = "events", "derivatives", "exponents", "files", "loops"
PAIRS = [*itertools.combinations(OF_SYSTEMS + OF_CALLS, 2)]
T, HIT = np.array([0.0, 0.7, 2.0, 5.0]), 1.0


class Turning:
    """A system with some of the things, a start, and its exact motion."""

    def __init__(self, things):
        self.things = things
        self.w = np.array([1.0, 2.0]) if "families" in things else 1.0
        self.reads_time, self.is_complex = "time" in things, "complex" in things
        self.is_mechanical = "constraints" in things
        self.x0 = [0.6 + 0.8j] if self.is_complex else [0.6, 0.8]
        self.field = self.lagrangian() if self.is_mechanical else self.oscillator()
        if "integrals" in things:
            square = lambda x: abs(x[0]) ** 2 if len(x) == 1 else x[:2] @ x[:2]  # noqa: E731
            self.field = self.field.conserving(square)

    def oscillator(self):
        def rates(t, x, w):
            speed = w * (1 + np.cos(t) / 2)
            return (1j * speed * x[0],) if self.is_complex else (-speed * x[1], speed * x[0])

        def steady(x, w):
            return (1j * w * x[0],) if self.is_complex else (-w * x[1], w * x[0])

        names = "z" if self.is_complex else "x y"
        given = {"complex": True} if self.is_complex else {}
        return Field(rates if self.reads_time else steady, names, w=self.w, **given)

    def lagrangian(self):
        """A point on the unit circle; w is its mass, which changes nothing."""
        given = {"complex": True} if self.is_complex else {}

        def push(q, v, t, w):
            return -w * np.sin(t) / 2 * np.stack([-q[1], q[0]])

        speed = 1.5 if self.reads_time else 1.0
        self.x0 = [0.6, 0.8, -0.8 * speed, 0.6 * speed]
        return Field.from_lagrangian(
            lambda q, v, w: w * (v @ v) / 2,
            "x y",
            constraints=lambda q, v: q @ q - 1,
            forces=push if self.reads_time else None,
            w=self.w,
            **given,
        )

    def turn(self, x):
        """A turn by a right angle, as the action of an event."""
        if self.is_complex:
            return (1j * x[0],)
        return (-x[1], x[0], -x[3], x[2]) if self.is_mechanical else (-x[1], x[0])

    def exact(self, t, is_hit):
        """Return the point (n, ...) of the plane as complex numbers."""
        w = np.ones_like(self.w) if self.is_mechanical else self.w
        t = np.reshape(t, (-1, *(1,) * np.ndim(w)))
        p = w * (t + self.reads_time * np.sin(t) / 2)
        return (0.6 + 0.8j) * np.exp(1j * p) * np.where(is_hit & (t >= HIT), 1j, 1.0)

    def point(self, states):
        return states[..., 0] if self.is_complex else states[..., 0] + 1j * states[..., 1]


def check(things):
    """Check all that a system with these things, and calls of them, give."""
    system, close = Turning(things), np.testing.assert_allclose
    field, is_hit = system.field, "events" in things
    given = {"events": Event(times=[HIT], to=system.turn)} if is_hit else {}
    wrt = {"derivatives": "x0 w"} if "derivatives" in things else {}
    if "files" in things:
        field = pickle.loads(pickle.dumps(Field.from_dict(field.to_dict())))
        assert field == system.field
    motion = flow(field, system.x0, time=T, **given, **wrt)
    exact = system.exact(T, is_hit)
    close(system.point(motion.states), exact, atol=1e-8)
    close(
        system.point(flow(field, motion, time=1.0).final), system.exact(6.0, is_hit)[0], atol=1e-7
    )
    assert motion.ok.all()
    if {"constraints", "integrals"} & things:
        close(abs(system.point(motion.states)), 1.0, atol=2e-15)
    if "families" in things:
        close(motion.member(1).states, flow(field[1], system.x0, time=T, **given, **wrt).states, 0)
    if wrt and not system.is_mechanical:
        of_x0, of_w = motion.derivatives["x0"], motion.derivatives["w"]
        turned = exact / (0.6 + 0.8j)
        close(of_x0[..., 0] @ [1, 1j], turned, atol=1e-7)
        close(of_x0[..., 1] @ [1, 1j], 1j * turned, atol=1e-7)
        phase = np.reshape(T + system.reads_time * np.sin(T) / 2, (-1, *(1,) * np.ndim(system.w)))
        close(of_w @ [1, 1j], 1j * phase * exact, atol=1e-7)
    elif wrt:
        close(motion.derivatives["w"], 0.0, atol=1e-8)
    if "exponents" in things:
        rates = lyapunov_exponents(field, system.x0, time=50.0, **given)
        close(rates, np.zeros((*np.shape(system.w), 2)), atol=0.1)
    return system, field, motion, given, wrt


def check_files(motion, path):
    motion.save(path)
    again = load(path)
    assert again == motion
    assert again.derivatives.keys() == motion.derivatives.keys()
    np.testing.assert_array_equal(again(3.0), motion(3.0))


def check_loops(system, field, given, wrt):
    """A step of a loop has the bits of `flow`."""
    one, x0 = (field[0], system.x0) if field.shape else (field, system.x0)
    if field.shape:
        with pytest.raises(ValueError, match="a single field"):
            compiled.system(field, time=2.0, **given, **wrt)
    constants = compiled.system(one, time=2.0, **given, **wrt)
    x, out = np.zeros(constants.dimension), np.zeros(constants.dimension)
    x[: len(system.x0) * (1 + system.is_complex)] = np.array(x0).view(float)
    assert compiled.step_system(constants, x, out, compiled.work(constants)) == 0
    motion = flow(one, x0, time=2.0, **given, **wrt)
    states = np.ascontiguousarray(motion.states[0])
    np.testing.assert_array_equal(out[: states.view(float).size], states.view(float))
    return constants


@pytest.mark.parametrize("pair", PAIRS, ids=" ".join)
@pytest.mark.filterwarnings("ignore:times count")
def test_pairs(pair, tmp_path):
    things = {*pair}
    if things == {"complex", "constraints"}:
        with pytest.raises(TypeError, match="complex: only Field"):
            Turning(things)
        return
    if things == {"derivatives", "exponents"}:
        with pytest.raises(TypeError, match="derivatives"):
            lyapunov_exponents(Turning(things).field, [1, 0], time=1.0, derivatives="x0")
    system, field, motion, given, wrt = check(things)
    if "files" in things:
        check_files(motion, tmp_path / "motion.npz")
    if "loops" in things:
        check_loops(system, field, given, wrt)
    if things == {"exponents", "loops"}:  # by the derivatives of steps of a loop
        constants = compiled.system(field, time=1.0, derivatives="x0")
        memory, x, Q, logs = compiled.work(constants), np.zeros(6), np.eye(2), 0.0
        x[:2] = system.x0
        for _ in range(50):
            compiled.step_system(constants, x, x, memory)
            Q, R = np.linalg.qr(x[2:].reshape(2, 2) @ Q)
            logs = logs + np.log(abs(np.diag(R)))
        np.testing.assert_allclose(logs / 50, 0, atol=1e-8)
