"""Systems with hidden components, at each place where states enter or leave the package.

Each is compared with the same equations written by hand: real variables, then t with the rate 1.
"""

import pickle
from typing import Any, NamedTuple

import numpy as np
import pytest

from suslov_fast import (
    Event,
    Field,
    IntegrationWarning,
    compiled,
    crossings,
    ensemble,
    equilibria,
    flow,
    integrability,
    iterate,
    kahan,
    load,
    lyapunov_exponents,
    periodic_orbit,
    step,
)

rng = np.random.default_rng(5)
T = np.linspace(0.0, 5.0, 6)


class Case(NamedTuple):
    """A system as users write it, and by hand, with a start, a surface, and a new state."""

    f: Any
    names: str
    hand: Any
    complex: Any
    x0: Any
    surface: Any
    of_hand: Any
    to: Any
    to_of_hand: Any
    takes_time: bool = True
    period: float | None = None

    def field(self, **parameters):
        given = {"complex": self.complex} if self.complex else {}
        return Field(self.f, self.names, **given, **({"k": 1.3} | parameters))

    def by_hand(self, **parameters):
        parts = [part for name in self.names.split() for part in self.parts_of(name)]
        names = [*parts, "t"] if self.takes_time else parts
        return Field(self.hand, names, **({"k": 1.3} | parameters))

    @property
    def size(self):
        return sum(len(self.parts_of(name)) for name in self.names.split())

    def parts_of(self, name):
        is_complex = self.complex is True or name == self.complex
        return [f"{name}_re", f"{name}_im"] if is_complex else [name]

    def flat(self, states):
        """Return states (..., n) of users as real parts."""
        columns = []
        for k, name in enumerate(self.names.split()):
            z = np.asarray(states)[..., k]
            columns += [z.real, z.imag] if len(self.parts_of(name)) == 2 else [z.real]
        return np.stack(columns, -1)

    def start(self, x0, t0=0.0):
        """Return the start of the system by hand."""
        x, t = self.flat(x0), np.asarray(t0)
        if not self.takes_time:
            return x
        batch = np.broadcast_shapes(x.shape[:-1], t.shape)
        x = np.broadcast_to(x, (*batch, x.shape[-1]))
        return np.concatenate([x, np.broadcast_to(t, batch)[..., None]], -1)

    def t0(self, t0):
        return {"t0": t0} if self.takes_time else {}

    def events(self):
        return (
            Event(self.surface, to=self.to, direction="down"),
            Event(self.of_hand, to=self.to_of_hand, direction="down"),
        )


CASES = {
    "real": Case(
        f=lambda y, k: (y[1], -k * np.sin(y[0])),
        names="x v",
        hand=lambda s, k: (s[1], -k * np.sin(s[0])),
        complex=False,
        x0=[0.4, 0.3],
        surface=lambda y: y[0] - 0.1,
        of_hand=lambda s: s[0] - 0.1,
        to=lambda y: (y[0], -0.9 * y[1]),
        to_of_hand=lambda s: (s[0], -0.9 * s[1]),
        takes_time=False,
        period=5.7,
    ),
    "f(t, y)": Case(
        f=lambda t, y, k: (y[1], -k * y[0] - 0.2 * y[1] + 0.3 * np.cos(2 * t)),
        names="x v",
        hand=lambda s, k: (s[1], -k * s[0] - 0.2 * s[1] + 0.3 * np.cos(2 * s[2]), 1.0),
        complex=False,
        x0=[0.4, 0.3],
        surface=lambda t, y: y[0] - 0.1 * np.cos(t),
        of_hand=lambda s: s[0] - 0.1 * np.cos(s[2]),
        to=lambda t, y: (y[0], -0.9 * y[1] + 0.01 * t),
        to_of_hand=lambda s: (s[0], -0.9 * s[1] + 0.01 * s[2], s[2]),
        period=np.pi,
    ),
    "f(t, y) without t": Case(
        f=lambda t, y, k: [y[1], -k * np.sin(y[0])],
        names="x v",
        hand=lambda s, k: (s[1], -k * np.sin(s[0]), 1.0),
        complex=False,
        x0=[0.4, 0.3],
        surface=lambda t, y: y[0] - 0.1 * np.cos(t),
        of_hand=lambda s: s[0] - 0.1 * np.cos(s[2]),
        to=lambda t, y: (y[0], -0.9 * y[1] + 0.01 * t),
        to_of_hand=lambda s: (s[0], -0.9 * s[1] + 0.01 * s[2], s[2]),
        period=5.7,
    ),
    "complex": Case(
        f=lambda z, k: ((1j * k + 0.2 - 0.2 * abs(z[0]) ** 2) * z[0],),
        names="z",
        hand=lambda s, k: (
            (0.2 - 0.2 * (s[0] ** 2 + s[1] ** 2)) * s[0] - k * s[1],
            (0.2 - 0.2 * (s[0] ** 2 + s[1] ** 2)) * s[1] + k * s[0],
        ),
        complex=True,
        x0=[0.9 + 0.2j],
        surface=lambda z: z[0].real - 0.1,
        of_hand=lambda s: s[0] - 0.1,
        to=lambda z: ((0.9 - 0.1j) * z[0],),
        to_of_hand=lambda s: (0.9 * s[0] + 0.1 * s[1], 0.9 * s[1] - 0.1 * s[0]),
        takes_time=False,
        period=4.8,
    ),
    "complex f(t, z)": Case(
        f=lambda t, z, k: (1j * k * z[0] - 0.2 * z[0] + 0.3 * np.exp(2j * t),),
        names="z",
        hand=lambda s, k: (
            -k * s[1] - 0.2 * s[0] + 0.3 * np.cos(2 * s[2]),
            k * s[0] - 0.2 * s[1] + 0.3 * np.sin(2 * s[2]),
            1.0,
        ),
        complex=True,
        x0=[0.9 + 0.2j],
        surface=lambda t, z: z[0].real - 0.1 * np.cos(t),
        of_hand=lambda s: s[0] - 0.1 * np.cos(s[2]),
        to=lambda t, z: ((0.9 - 0.1j) * z[0] + 0.01 * t,),
        to_of_hand=lambda s: (
            0.9 * s[0] + 0.1 * s[1] + 0.01 * s[2],
            0.9 * s[1] - 0.1 * s[0],
            s[2],
        ),
        period=np.pi,
    ),
    "mixed f(s, t)": Case(
        f=lambda s, t, k: (0.3 * np.cos(2 * t) - 0.2 * s[0], 1j * (k + s[0]) * s[1] - s[1] / 5 + 1),
        names="g z",
        hand=lambda s, k: (
            0.3 * np.cos(2 * s[3]) - 0.2 * s[0],
            -(k + s[0]) * s[2] - s[1] / 5 + 1,
            (k + s[0]) * s[1] - s[2] / 5,
            1.0,
        ),
        complex="z",
        x0=[0.1, 0.9 + 0.2j],
        surface=lambda s, t: s[1].real - 0.1 * np.cos(t),
        of_hand=lambda s: s[1] - 0.1 * np.cos(s[3]),
        to=lambda s, t: (s[0] + 0.01 * t, (0.9 - 0.1j) * s[1]),
        to_of_hand=lambda s: (
            s[0] + 0.01 * s[3],
            0.9 * s[1] + 0.1 * s[2],
            0.9 * s[2] - 0.1 * s[1],
            s[3],
        ),
        period=np.pi,
    ),
}
each_case = pytest.mark.parametrize("case", CASES.values(), ids=CASES)


def close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9)


def starts_of(case, count=3):
    """Return starts of users (count, n), and times at them."""
    scales = rng.uniform(0.5, 1.5, (count, 1))
    return scales * np.array(case.x0), rng.uniform(0, 2, count) * case.takes_time


@each_case
def test_values(case):
    field, hand = case.field(), case.by_hand()
    x, t = starts_of(case)
    at, size = {"t": t} if case.takes_time else {}, case.size
    close(case.flat(field(x, **at)), hand(case.start(x, t))[:, :size])
    close(field.jacobian(x, **at), hand.jacobian(case.start(x, t))[:, :size, :size])
    assert field.names == tuple(case.names.split())
    assert field.dimension == len(field.names)


@each_case
def test_flow_of_batches_and_families(case):
    k = [[1.1], [1.3]]
    field, hand = case.field(k=k), case.by_hand(k=k)
    x, t = starts_of(case)
    motion, same = flow(field, x, time=T, **case.t0(t)), flow(hand, case.start(x, t), time=T)
    assert motion.states.shape == (6, 2, 3, field.dimension)
    close(case.flat(motion.states), same.states[..., : case.size])
    close(case.flat(motion.final), same.final[..., : case.size])
    close(motion["z" if case.complex else "x"], motion.states[..., -1 if case.complex else 0])
    one = flow(field[1, 0], x[2], time=T, **case.t0(t[2]))
    np.testing.assert_array_equal(one.states, motion.member((1, 2)).states)
    again = flow(field, motion.states[3], time=T[3:] - T[3], **case.t0(t + T[3]))
    close(again.states[-1], motion.states[-1])


@each_case
def test_tolerances_of_variables(case):
    atol = tuple(1e-5 * (1 + np.arange(len(case.x0))))
    motion = flow(case.field(), case.x0, time=T, atol=atol)
    counts = [len(case.parts_of(name)) for name in case.names.split()]
    parts = [*np.repeat(atol, counts), *[0.0] * case.takes_time]
    same = flow(case.by_hand(), case.start(case.x0), time=T, atol=parts)
    if case is not CASES["f(t, y) without t"]:  # its hand form carries t, which costs digits
        close(case.flat(motion.states), same.states[..., : case.size])
        assert motion.steps == same.steps
    assert motion.atol == atol
    with pytest.raises(ValueError, match=f"atol must be a number, or {len(atol)}"):
        flow(case.field(), case.x0, time=T, atol=[*atol, 0.0])


@each_case
def test_events_and_derivatives(case):
    event, by_hand = case.events()
    x, t = starts_of(case)
    size = case.size
    given = {"time": T, "derivatives": "x0 k"}
    motion = flow(case.field(), x, events=event, **case.t0(t), **given)
    same = flow(case.by_hand(), case.start(x, t), events=by_hand, **given)
    close(case.flat(motion.states), same.states[..., : case.size])
    close(motion.derivatives["x0"], same.derivatives["x0"][..., :size, :size])
    close(motion.derivatives["k"], same.derivatives["k"][..., :size])
    events, others = motion.events, same.events
    assert len(events.time) == len(others.time) > 2
    close(events.time, others.time)
    close(case.flat(events.before), others.before[:, : case.size])
    close(case.flat(events.states), others.states[:, : case.size])
    for name, columns in (("x0", np.s_[..., :size]), ("k", np.s_[...])):
        mine, theirs = events.derivatives[name], others.derivatives[name]
        close(mine.time, theirs.time[columns])
        close(mine.states, theirs.states[:, :size][columns])
    text = event.of(case.field())
    assert Event.from_dict(text.to_dict()) == text
    close(flow(case.field(), x, time=T, events=text, **case.t0(t)).states, motion.states)


@each_case
def test_crossings(case):
    x, t = starts_of(case)
    found = crossings(case.field(), x, case.surface, time=6.0, transient=0.5, **case.t0(t))
    same = crossings(case.by_hand(), case.start(x, t), case.of_hand, time=6.0, transient=0.5)
    assert len(found.time) == len(same.time) > 2
    close(found.time, same.time)
    close(case.flat(found.states), same.states[:, : case.size])
    assert found.to_dataframe().columns.tolist()[-len(case.x0) :] == case.names.split()


@each_case
def test_exponents(case):
    field, start = case.field(), case.start(case.x0, 0.5 * case.takes_time)
    found = lyapunov_exponents(field, case.x0, time=20.0, **case.t0(0.5))
    close(found, lyapunov_exponents(case.by_hand(), start, time=20.0))
    assert found.shape == (case.size,)


@each_case
@pytest.mark.filterwarnings("ignore:periodic_orbit found a member of a family")
def test_periodic_orbits(case):
    found = periodic_orbit(case.field(), case.x0, case.period, **case.t0(0.5))
    start = case.start(case.x0, 0.5 * case.takes_time)
    same = periodic_orbit(case.by_hand(), start, case.period)
    close(case.flat(found.state), same.state[: case.size])
    close(found.multipliers, same.multipliers)
    assert found.period == pytest.approx(same.period)
    assert found.state.shape == (len(case.x0),)


@each_case
def test_equilibria(case):
    field = case.field()
    reads_time = "cos(2*t)" in str(field)
    if reads_time:
        with pytest.raises(TypeError, match="does not read the time"):
            equilibria(field, np.multiply(0.01, case.x0))
        return
    found = equilibria(field, np.multiply(0.01, case.x0))
    close(case.flat(found.states), np.zeros(2))
    assert found.eigenvalues.shape == (2,)


@each_case
def test_files_and_pickles(case, tmp_path):
    field, (event, _) = case.field(), case.events()
    assert pickle.loads(pickle.dumps(field)) == field == Field.from_dict(field.to_dict())
    assert hash(field) == hash(case.field())
    assert (field == case.by_hand()) == (case is CASES["real"])
    given = {"time": T, "events": event, "derivatives": "x0"} | case.t0(0.5)
    motion = flow(field, [case.x0, case.x0], **given)
    motion.save(tmp_path / "motion.npz")
    read = load(tmp_path / "motion.npz")
    assert read == motion == pickle.loads(pickle.dumps(motion))
    assert read.events == motion.events
    assert read.names == tuple(case.names.split())
    given.pop("derivatives")
    again, once = (flow(each, case.x0, **given) for each in (read.body, field))
    np.testing.assert_array_equal(again.states, once.states)
    table = motion.to_dataframe()
    assert table.columns.tolist() == ["trajectory", "time", *case.names.split()]
    assert motion.to_xarray()["component"].values.tolist() == case.names.split()


@each_case
def test_figures(case):
    motion = flow(case.field(), case.x0, time=T)
    name = case.names.split()[-1]
    assert len(motion.plot("time", name).lines) == (2 if case.complex else 1)
    assert motion.plot("t", case.names.split()[0]).get_xlabel() == "$t$"
    motion.plot()


@each_case
def test_ensembles(case, tmp_path):
    pytest.importorskip("zarr")
    x, t = starts_of(case, 8)
    data = ensemble(case.field(), x, tmp_path / "store", time=T, chunks=3, **case.t0(t))
    motion = flow(case.field(), x, time=T, **case.t0(t))
    np.testing.assert_array_equal(data.states.values, motion.states)


@each_case
def test_loops_have_all_components(case):
    """Loops of users hold states of the engine: parts, then the time, if f takes it."""
    event, by_hand = case.events()
    system = compiled.system(case.field(), time=2.0, events=event)
    x = case.start(case.x0, 0.5)[: system.dimension]
    memory, out = compiled.work(system), np.empty(system.dimension)
    assert compiled.step_system(system, x, out, memory) == 0
    start = case.start(case.x0, 0.5 * case.takes_time)
    same = flow(case.by_hand(), start, time=2.0, events=by_hand)
    close(out, same.states[0][: system.dimension])


@each_case
def test_states_are_those_of_users(case):
    field, x0 = case.field(), np.array(case.x0)
    names = case.names.split()
    expected = flow(field, x0, time=T).states
    np.testing.assert_array_equal(
        flow(field, dict(zip(names, x0, strict=True)), time=T).states, expected
    )
    for wrong in (case.flat(x0) if case.complex else [*x0, 0.0], [*x0, 0.0], [*x0, 0j, 0j]):
        with pytest.raises((ValueError, TypeError), match="x0 must"):
            flow(field, wrong, time=T)
    real = flow(field, x0.real, time=T).states
    np.testing.assert_array_equal(real, flow(field, x0.real.astype(x0.dtype), time=T).states)
    broken = flow(field, [x0, np.nan * x0], time=T).states
    np.testing.assert_array_equal(broken[:, 0], expected)
    assert np.isnan(broken[:, 1]).all()
    if not case.takes_time:  # the time of equations that do not read it changes nothing
        np.testing.assert_array_equal(flow(field, x0, time=T, t0=3.0).states, expected)


@each_case
def test_motions_go_on(case):
    """A motion as x0 goes on at its end, and at its time."""
    x, t = starts_of(case)
    field, (event, _) = case.field(), case.events()
    first = flow(field, x, time=2.0, events=event, **case.t0(t))
    whole = flow(field, x, time=5.0, events=event, **case.t0(t))
    close(flow(field, first, time=3.0, events=event).final, whole.final)
    again = flow(field, flow(field, first, time=1.0, events=event), time=2.0, events=event)
    close(again.final, whole.final)
    back = flow(field, flow(field, x, time=1.0, **case.t0(t)), time=-1.0)
    close(back.final, x)
    found = crossings(field, first, case.surface, time=3.0)
    end = {"t0": t + 2.0} if case.takes_time else {}
    assert found == crossings(field, first.final, case.surface, time=3.0, **end)
    close(
        lyapunov_exponents(field, first, time=5.0),
        lyapunov_exponents(field, first.final, time=5.0, **end),
    )


def test_an_unread_time_is_no_component():
    f = lambda y, k: (y[1], -k * np.sin(y[0]))  # noqa: E731
    field, same = Field(f, "x v", k=1.3), Field(lambda t, y, k: f(y, k), "x v", k=1.3)
    assert field == same
    assert hash(field) == hash(same)
    both = [flow(each, [0.4, 0.3], time=T, t0=[0.0, 1.0]).states for each in (field, same)]
    np.testing.assert_array_equal(*both)
    event = Event(lambda t, y: y[0] - t, terminal=True)
    assert flow(field, [0.4, 0.3], time=9.0, t0=[0.0, -2.0], events=event).ok.all()
    end = flow(field, [0.4, 0.3], time=9.0, events=Event("x - t", terminal=True))
    assert end.final[0] == pytest.approx(end.end)
    own = Field(lambda s: (s[1], -s[0], 1.0), "x v t")
    with pytest.raises(TypeError, match="t is a variable"):
        flow(own, [0.4, 0.3, 0.0], time=1.0, t0=0.0)
    np.testing.assert_array_equal(
        flow(own, flow(own, [0.4, 0.3, 2.0], time=1.0), time=1.0).final[2], 4.0
    )


def test_kahans_map_of_a_field_with_time():
    field = Field(lambda t, y: (y[1] + t * y[0], -y[0]), "x v")
    hand = Field(lambda s: (s[1] + s[2] * s[0], -s[0], 1.0), "x v t")
    run, same = iterate(field, [1, 0], 0.1, 20, t0=0.5), iterate(hand, [1, 0, 0.5], 0.1, 20)
    np.testing.assert_array_equal(run.states, same.states[:, :2])
    np.testing.assert_array_equal(run.final, same.final[:2])
    np.testing.assert_array_equal(step(field, [1, 0], 0.1, t0=0.5), run.states[1])
    lotka = Field(lambda y: (y[0] - y[0] * y[1], y[0] * y[1] - y[1]), "u v")
    same = Field(lambda t, y: lotka(y), "u v")
    for function in (kahan.jacobian, lambda *given: lyapunov_exponents(*given, 10)):
        np.testing.assert_array_equal(*(function(each, [1, 2], 0.1) for each in (lotka, same)))
        with pytest.raises(TypeError, match="system must be one whose f does not read the time"):
            function(field, [1, 0], 0.1)
    assert str(integrability.kahan(same)) == str(integrability.kahan(lotka))
    with pytest.raises(TypeError, match="does not read the time"):
        integrability.kahan(field)


def test_complex_integrals_are_two():
    field = Field(lambda z: (1j * z[0], -1j * z[1]), "z w", complex=True)
    kept = field.conserving(lambda z: z[0] * z[1])
    assert kept == field.conserving(lambda z: ((z[0] * z[1]).real, (z[0] * z[1]).imag))
    z, w = flow(kept, [1 + 2j, 3 - 1j], time=[10.0, 100.0], rtol=1e-3).states.T
    np.testing.assert_allclose(z * w, (1 + 2j) * (3 - 1j), rtol=1e-9)


def test_conserved_and_subsystems_with_time():
    field = Field(lambda t, y: (y[1], -y[0], np.cos(t) - y[2]), "x v w")
    kept = field.conserving(lambda y: y[0] ** 2 + y[1] ** 2)
    states = flow(kept, [1.0, 0.0, 0.0], time=[10.0, 100.0], t0=0.0).states
    np.testing.assert_allclose(states[:, 0] ** 2 + states[:, 1] ** 2, 1.0, rtol=1e-14)
    part = field.subsystem("w")
    assert str(part) == "Field(w' = cos(t) - w)"
    close(flow(part, [0.0], time=3.0).states[0], flow(field, [1, 0, 0], time=3.0).states[0, 2:])


def test_integrals_of_complex_variables():
    field = Field(
        lambda t, z, k: (-1j * k * (1 + np.cos(t)) * z[0], z[0] - z[1]), "z w", complex=True, k=1.3
    )
    kept = field.conserving(lambda z: abs(z[0]) ** 2)
    assert kept == kept.conserving(lambda z: z[0].real ** 2 + z[0].imag ** 2) != field
    assert kept == pickle.loads(pickle.dumps(kept)) == Field.from_dict(kept.to_dict())
    motion = flow(kept, [0.6 + 0.8j, 0.1], time=[10.0, 100.0], rtol=1e-6, t0=0.5)
    np.testing.assert_allclose(abs(motion["z"]), 1.0, rtol=1e-15)
    part = kept.subsystem("z")
    assert part.names == ("z",)
    states = flow(part, [0.6 + 0.8j], time=[10.0, 100.0], t0=0.5).states
    angles = 1.3 * (motion.time + np.sin(0.5 + motion.time) - np.sin(0.5))
    close(states[:, 0], (0.6 + 0.8j) * np.exp(-1j * angles))
    np.testing.assert_allclose(abs(states), 1.0, rtol=1e-15)
    for changes in (lambda z: z[0] ** 2, lambda z: abs(z[1]) ** 2):
        with pytest.raises(ValueError, match="function 0 changes along the motion"):
            field.conserving(changes)


def test_integrals_that_read_the_time():
    """The state in a turning frame is constant, which fixes a state, though f reads no time."""
    field = Field(lambda t, y, k: (k * y[1], -k * y[0]), "x v", k=[1.0, 2.0])

    def turned(t, y, k):
        c, s = np.cos(k * t), np.sin(k * t)
        return y[0] * c - y[1] * s, y[0] * s + y[1] * c

    kept = field.conserving(turned)
    assert Field.from_dict(kept[0].to_dict()) == kept[0]
    motion = flow(kept, [1.0, 0.5], time=[10.0, 100.0], rtol=1e-3, t0=3.0)
    t = motion.time[:, np.newaxis] * kept.parameters["k"]
    exact = np.stack([np.cos(t) + 0.5 * np.sin(t), 0.5 * np.cos(t) - np.sin(t)], -1)
    np.testing.assert_allclose(motion.states, exact, atol=1e-13)
    found = equilibria(kept, [0.1, 0.2])
    np.testing.assert_allclose(found.states, 0, atol=1e-15)
    assert found.kind.tolist() == ["centre", "centre"]
    both = kept.conserving(lambda t, y, k: y[0] ** 2 + y[1] ** 2)
    run = iterate(both[0], [1.0, 0.5], 0.1, 50)  # integrals need not be of degree 2
    np.testing.assert_allclose((run.states**2).sum(axis=-1), 1.25, rtol=1e-14)
    np.testing.assert_array_equal(run.states, iterate(field[0], [1.0, 0.5], 0.1, 50).states)


def test_integrals_that_change_at_a_time():
    field = Field(lambda t, y, c: (y[1], -y[0] + np.where(t > 8, c * y[1], 0)), "x v", c=0.02)
    kept = field.conserving(lambda y: y[0] ** 2 + y[1] ** 2)
    flow(kept, [1.0, 0.0], time=7.0)  # no warning
    flow(kept.with_parameters(c=0.0), [1.0, 0.0], time=9.0)
    where = r"in 1 of 2 solutions \(first: trajectory 1 at t = 8\)"
    with pytest.warns(IntegrationWarning, match=where):
        flow(kept, [1.0, 0.0], time=[0.0, 2.0], t0=[0.0, 7.0])
    for function, *surface in ((crossings, "x"), (lyapunov_exponents,)):
        with pytest.warns(IntegrationWarning, match="function 0 changes along f"):
            function(kept, [1.0, 0.5], *surface, time=1.0, t0=9.0)


def test_an_unread_time_changes_no_bits():
    plain = Field(lambda y, k: (y[1], -k * np.sin(y[0])), "x v", k=[1.0, 2.0])
    idle = Field(lambda t, y, k: plain(y), "x v", k=[1.0, 2.0])
    bounce = Event("x", to=["x", "-v"])
    for more in ({}, {"events": bounce, "derivatives": "x0 k"}, {"atol": (1e-5, 1e-6)}):
        one, two = (flow(each, [0.4, 0.3], time=T, **more) for each in (plain, idle))
        np.testing.assert_array_equal(one.states, two.states)
        np.testing.assert_array_equal(one.steps, two.steps)
        assert one.atol == two.atol
    np.testing.assert_array_equal(flow(idle, [0.4, 0.3], time=T, t0=7.0, **more).states, two.states)


def test_mass_matrices_with_time():
    field = Field(lambda t, y: (y[1], -y[0]), "x v", mass=lambda t, y: [[1, 0], [0, 2 + np.sin(t)]])
    hand = Field(lambda t, y: (y[1], -y[0] / (2 + np.sin(t))), "x v")
    close(flow(field, [1, 0], time=3.0).states, flow(hand, [1, 0], time=3.0).states)


def test_sliding_with_time():
    def f(t, y, k):
        return y[1], -k * y[0] - np.sign(y[1]) + 1.5 * np.cos(t)

    field = Field(f, "x v", k=1.2)
    hand = Field(lambda s, k: (*f(s[2], s[:2], k), 1.0), "x v t", k=1.2)
    motion = flow(field, [1.0, 0.0], time=[2.0, 8.0], derivatives="x0 k", t0=0.5)
    same = flow(hand, [1.0, 0.0, 0.5], time=[2.0, 8.0], derivatives="x0 k")
    assert len(motion.phases.time) == len(same.phases.time) > 0
    close(motion.states, same.states[..., :2])
    close(motion.derivatives["x0"], same.derivatives["x0"][..., :2, :2])
    close(motion.derivatives["k"], same.derivatives["k"][..., :2])


@pytest.mark.parametrize("times", [[1.0, 2.0], [2.0, 1.0], [-1.0, -2.0], [-2.0, -1.0]])
def test_a_motion_goes_on_from_the_state_at_its_last_time(times):
    """The state at time s is s**2 / 2, also if the last of `time` is not the largest."""
    motion = flow(lambda t, y: (t,), [0.0], time=times, t0=0)
    last = flow(lambda t, y: (t,), motion, time=1.0).final
    assert last == pytest.approx([(times[-1] + 1) ** 2 / 2], abs=1e-12)
