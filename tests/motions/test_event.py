"""The class `Event` and the results of changes: text, equality, pickles, batches."""

import gc
import inspect
import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hybrid import TO_BLOOD, patient
from scipy.integrate import solve_ivp

import suslov_fast as sf
from suslov_fast import Event, Field, flow

PK = Field(patient, "gut blood", k=1.0, dose=100.0)
DOSES = Event(times=[0.0, 24.0, np.nan], **TO_BLOOD)
SHARED = Event(
    lambda x, k: k * np.exp(x[1]) - np.exp(x[1]) ** 2 - 1,
    to=lambda x: (np.exp(x[1]) * np.exp(x[1]), np.where(x[0] > 1, x[1], np.exp(x[1]))),
    direction=-1,
    most=3,
)


@pytest.mark.parametrize("change", [DOSES, SHARED, Event("gut", terminal=True), Event(times=[])])
def test_events_as_text(change):
    text = change.of(PK)
    again = Event.from_dict(json.loads(json.dumps(text.to_dict())))
    assert again == text == pickle.loads(pickle.dumps(text)) == again.of(PK)
    assert hash(again) == hash(text)
    assert "\n" not in repr(text)
    assert len(repr(change)) < 200
    assert change == change
    assert (change == text) != (callable(change.surface) or callable(change.to))
    for at in np.array([[0.5, 0.2], [2.0, -1.0]]):
        names = dict(zip(PK.names, at, strict=True)) | PK.parameters
        names |= {"exp": np.exp, "where": np.where}
        for name, definition in text.to_dict().get("definitions", {}).items():
            names[name] = eval(definition, names)
        if change.to is not None:
            known = {"dose": 100.0} if change is DOSES else {}
            right = change.to(at, **known)
            np.testing.assert_allclose([eval(each, names) for each in text.to], right, 1e-14)


@pytest.mark.parametrize("to", [(100, "blood"), ("100", "blood"), lambda x: (100.0, x[1])])
def test_new_states_by_component(to):
    motion = flow(PK, [3.0, 4.0], time=[1.0], events=Event(times=[1.0], to=to))
    assert motion.events.states[0].tolist() == [100.0, motion.events.before[0, 1]]


def falls(t, y):
    return y[1], -9.81


def as_in_scipy(**attributes):
    def surface(t, y):
        return y[0] - 0.2 * np.sin(9.0 * t)

    vars(surface).update(attributes)
    return surface


@pytest.mark.parametrize(
    "attributes",
    [
        {},
        {"direction": 0.5},
        {"direction": -3},
        {"terminal": 1},
        {"terminal": np.int64(2), "direction": 1},
    ],
)
def test_surfaces_as_scipy_takes_them(attributes):
    surface = as_in_scipy(**attributes)
    right = solve_ivp(falls, (0, 3), [-0.1, 9.81], "DOP853", events=surface, rtol=1e-11, atol=1e-11)
    motion = flow(falls, [-0.1, 9.81], time=[3.0], events=surface)
    np.testing.assert_allclose(motion.events.time, right.t_events[0], 0, 1e-8)
    np.testing.assert_allclose(motion.final, right.y[:, -1], 0, 1e-7)
    assert motion.end == pytest.approx(right.t[-1], abs=1e-8)
    found = sf.crossings(falls, [-0.1, 9.81], surface, time=3.0)
    assert found.time.tolist() == motion.events.time.tolist()


def test_arguments_come_before_attributes():
    surface = as_in_scipy(terminal=True, direction=1)
    event = Event(surface, direction="down", most=3)
    assert (event.terminal, event.direction, event.most) == (False, -1, 3)
    both = flow(PK, [3.0, 0.0], time=[5.0], events=["blood - 0.5", lambda x: x[0] - 1])
    assert both.events.which.tolist() == [0, 1]


def test_events_that_differ():
    first = Event(times=[1.0, np.nan])
    assert first == Event(times=[1.0, np.nan])
    assert first != Event(times=[1.0, 2.0])
    assert first != Event("x")
    assert Event("x", most=1) != Event("x", most=2)
    assert Event("x").from_dict({"surface": "x"}) == Event("x")
    assert first != 3
    levels = [Event("gut - 9"), Event("gut - 8")]
    none = [flow(PK, [3.0, 4.0], time=1.0, events=each).events for each in levels]
    assert len(none[0].time) == len(none[1].time) == 0
    assert none[0] != none[1]


# A value of each argument that is not its default.
ARGUMENTS = {
    "surface": lambda x: x[0] - 1,
    "to": ("0", "blood"),
    "terminal": True,
    "direction": -1,
    "times": [1.0, np.nan],
    "most": 2,
}


def test_every_argument_is_compared_shown_and_kept():
    assert ARGUMENTS.keys() == inspect.signature(Event).parameters.keys()
    for name, value in ARGUMENTS.items():
        base = {"times": [2.0]} if name == "times" else {"surface": lambda x: x[0]}
        plain, event = (Event(**given).of(PK) for given in (base, base | {name: value}))
        assert event != plain
        assert repr(event) != repr(plain)
        assert Event.from_dict(event.to_dict()) == event == replace(event)
        assert name in event.to_dict()


def test_results_of_events():
    own = PK.with_parameters(dose=[50.0, 100.0, 200.0])
    motion = flow(own, [0.0, 0.0], time=[10.0, 72.0], events=[Event(times=[5.0]), DOSES])
    changes = motion.events
    assert len(changes.states) == 9
    assert changes.trajectory.tolist() == [0] * 3 + [1] * 3 + [2] * 3
    assert changes.which.tolist() == [1, 0, 1] * 3
    assert changes.time.tolist() == [0.0, 5.0, 24.0] * 3
    assert changes.count.tolist() == [[1, 2]] * 3
    is_record = changes.which == 0
    np.testing.assert_array_equal(changes.before[is_record], changes.states[is_record])
    np.testing.assert_array_equal(changes["gut"], changes.states[:, 0])
    assert [each.times is None for each in changes.given] == [False, False]
    again = pickle.loads(pickle.dumps(motion))
    assert again == motion
    assert again.events == changes
    other = flow(own, [0.0, 0.0], time=[10.0, 72.0], events=[Event(times=[5.5]), DOSES])
    assert other != motion
    assert flow(PK, [0.0, 0.0], time=1.0).events is None
    with pytest.raises(KeyError, match="derivatives="):
        changes.derivatives["k"]


def test_times_broadcast_with_the_batch():
    times = np.array([[1.0, np.nan], [1.0, 2.0], [3.0, 5.0]])
    add = {"to": lambda x: (x[0] + 1, x[1])}
    motion = flow(PK, [0.0, 0.0], time=4.0, events=Event(times=times, **add))
    assert motion.states.shape == (1, 3, 2)
    assert motion.events.count[:, 0].tolist() == [1, 2, 1]
    columns = flow(PK, np.zeros((2, 1, 2)), time=4.0, events=Event(times=times, **add))
    np.testing.assert_array_equal(columns.states, np.stack([motion.states] * 2, axis=1))
    for k, own in enumerate(times):
        alone = flow(PK, [0.0, 0.0], time=4.0, events=Event(times=own, **add))
        np.testing.assert_array_equal(alone.states, motion.states[:, k])


def test_a_change_serves_several_systems():
    double = Event(times=1.0, to=lambda x: 2 * x)
    for dimension in (1, 2, 3):
        still = Field(lambda x: 0 * x, dimension)
        for given in (double, [double], (double,)):
            motion = flow(still, np.ones(dimension), time=2.0, events=given)
            assert motion.states.tolist() == [[2.0] * dimension]
    body = sf.Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    motion = flow(body, [1.0, 0.5], time=1.0, events=double)
    np.testing.assert_allclose(
        motion.states, 2 * flow(body, [1.0, 0.5], time=1.0).states, rtol=1e-8
    )


RATE = 3.0


def tripled(c):
    return RATE * c


def test_functions_have_the_values_of_names_when_the_change_was_made():
    body = Field(lambda c: (-0.1 * c[0],), "c")
    pairs = [*zip([0, 8, 16], [100, 50, 70], strict=True)]
    doses = [Event(times=[t], to=lambda c: c + a) for t, a in pairs]  # noqa: B023
    right = sum(a * np.exp(-0.1 * (24 - t)) for t, a in pairs)
    np.testing.assert_allclose(flow(body, [0.0], time=24.0, events=doses).states, [[right]])
    names = {"Event": Event, "pairs": pairs}
    exec("d = []\nfor t, a in pairs:\n    d.append(Event(times=[t], to=lambda c: c + a))", names)
    found = flow(body, [0.0], time=24.0, events=names["d"])
    np.testing.assert_allclose(found.states, [[right]], rtol=1e-9)
    assert Event("c", to=tripled) == Event("c", to=tripled)


def test_names_of_a_surface_and_of_what_it_calls(monkeypatch):
    clock = Field(lambda x: (1.0,), "t")
    change = Event(lambda x: tripled(x[0]) - 6, direction=1)
    monkeypatch.setitem(globals(), "RATE", 1.0)
    np.testing.assert_allclose(flow(clock, [0.0], time=9.0, events=change).events.time, [2.0])


def test_events_of_one_trajectory():
    """Each falls for its own time; the table of a notebook has a row for each event."""
    ball = Field(lambda s: (s[1], -2.0), "h v")
    heights = np.array([[1.0, 4.0], [9.0, 16.0]])
    starts = np.stack([heights, np.zeros((2, 2))], axis=-1)
    events = sf.flow(ball, starts, time=10.0, events=Event("h", terminal=True)).events
    times = [events.of(k).time.tolist() for k in range(4)]
    assert times == [pytest.approx([each]) for each in (1.0, 2.0, 3.0, 4.0)]
    assert events._repr_html_().count("<tr>") == 5
    one = sf.flow(ball, [1.0, 0.0], time=10.0, events=Event("h"))
    assert one.events.of(0) == one.events
    assert "<td>OK</td><td>10</td>" in one._repr_html_()
    with pytest.raises(ValueError, match="from 0 to 3"):
        events.of(4)


def test_symbols_of_functions_are_freed():
    """New functions in each call, as in a loop over levels, do not fill the memory."""
    kinds, field = set(), Field(lambda s: (s[0],), "x")

    def surface(s, level):
        kinds.add(type(s[0]))
        return s[0] - level

    def count(n):
        for level in range(n):
            Field(lambda s, own=level: (surface(s, own),), "x")
            flow(field, [1.0], time=1.0, events=Event(lambda s, own=level: surface(s, own)))
        gc.collect()
        return sum(type(each) in kinds for each in gc.get_objects())

    assert count(20) >= count(40)
