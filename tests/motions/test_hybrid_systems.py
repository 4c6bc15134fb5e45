"""Hybrid systems of `hybrid.SYSTEMS`, by each way: exact events and ends, bits, derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from children import TWO_THREADS
from hybrid import SYSTEMS

from suslov_fast import Field, Status, flow

pytestmark = pytest.mark.filterwarnings("ignore:.*slide along")
RECORDS = [
    name for name, own in SYSTEMS.items() if len(own.events) == 1 and own.events[0].to is None
]
SMOOTH = [name for name, own in SYSTEMS.items() if own.is_smooth]
ENDING = [name for name, own in SYSTEMS.items() if own.which]


def solved(own, **options):
    given = {"time": own.time, "events": own.events, "rtol": 1e-10} | options
    return flow(Field(own.f, own.names, **own.parameters), own.start, **given)


def merged(times):
    return np.sort(np.concatenate([[], *times]))


@pytest.mark.sampled(3 * len(SYSTEMS) // 2)
@pytest.mark.parametrize("stiff", [None, True])
@pytest.mark.parametrize("name", SYSTEMS)
def test_events_and_ends(name, stiff):
    own = SYSTEMS[name]
    motion = solved(own, stiff=stiff)
    assert motion.status == own.status
    np.testing.assert_allclose(motion.end, np.nan_to_num(own.stop, nan=own.time), rtol=1e-9)
    if own.end is not None:
        np.testing.assert_allclose(motion.final, own.end, own.digits, own.digits)
    if own.events:
        assert motion.events.which.tolist() == own.which
        np.testing.assert_allclose(motion.events.time, merged(own.times), own.digits, own.digits)
        assert motion.events.count.tolist() == [len(times) for times in own.times]


@pytest.mark.sampled(10)
@pytest.mark.parametrize("name", ENDING)
def test_terminal_events(name):
    """A motion ends at the second time of its first event, or at the first one if that is all."""
    own = SYSTEMS[name]
    k, events = own.which[0], [*own.events]
    most = min(2, len(own.times[k]))
    events[k] = replace(events[k], **({"most": 2} if most == 2 else {"terminal": True}))
    motion, right = solved(own, events=events), own.times[k][most - 1]
    assert motion.status == Status.STOPPED
    np.testing.assert_allclose(motion.end, right, own.digits, own.digits)
    assert motion.events.count[k] == most
    assert motion.events.which.tolist() == own.which[: len(motion.events.which)]
    np.testing.assert_array_equal(motion.final, motion.events.states[-1])
    assert np.isnan(motion.states).all() == (right < own.time)


@pytest.mark.sampled(12)
@pytest.mark.parametrize("name", SYSTEMS)
def test_units_and_the_direction_of_time(name):
    """x' = c f has the events at t/c: with all bits if c is 1, -1, or another power of 2."""
    own = SYSTEMS[name]
    field = Field(lambda s, pace, **p: tuple(pace * each for each in own.f(s, **p)),
                  own.names, pace=1.0, **own.parameters)  # fmt: skip
    usual = None
    for c in (1.0, -1.0, 2.0**40, -(2.0**-40)):
        events = [e if e.times is None else replace(e, times=np.array(e.times) / c)
                  for e in own.events]  # fmt: skip
        given = {"time": own.time / c, "events": events, "rtol": 1e-10}
        motion = flow(field.with_parameters(pace=c), own.start, **given)
        found = [motion.final, motion.end * c]
        found += [motion.events.states, motion.events.time * c] if events else []
        usual = usual or found
        for one, other in zip(found, usual, strict=True):
            np.testing.assert_array_equal(one, other)
    if own.end is not None:
        np.testing.assert_allclose(usual[0], own.end, own.digits, own.digits)


@pytest.mark.parametrize("name", RECORDS)
def test_directions_of_records(name):
    """Up and down take turns; a change that leaves the state as it is comes at the same times."""
    own, given = SYSTEMS[name], SYSTEMS[name].events[0]
    events = [replace(given, direction=1), replace(given, direction=-1)]
    found = solved(own, events=[*events, replace(given, to=lambda s: s)]).events
    up, down, acts = (found.time[found.which == k] for k in range(3))
    right = {0: merged([up, down]), 1: up, -1: down}[given.direction]
    for times in (right, acts):
        np.testing.assert_allclose(times, own.times[0], own.digits, own.digits)
    assert abs(len(up) - len(down)) <= 1


@pytest.mark.sampled(8)
@pytest.mark.parametrize("name", SYSTEMS)
def test_alone_as_in_a_batch(name):
    own = SYSTEMS[name]
    by = {"derivatives": ("x0", *own.parameters)} if own.is_smooth else {}
    starts = np.array(own.start) + 0.01 * np.random.default_rng(1).random((40, len(own.start)))
    one, two = (solved(replace(own, start=starts), threads=n, **by) for n in (1, TWO_THREADS))
    pairs = [(one, two)]
    pairs += [(solved(replace(own, start=starts[k]), **by), one.member(k)) for k in (0, 1, 7, 39)]
    for a, b in pairs:
        assert a == b


def by_differences(own, h=1e-3):
    """Return derivatives of the last state, and of times and states of events, by all inputs."""
    values, D = np.array([*own.start, *own.parameters.values()]), len(own.start)
    near = h * np.eye(len(values))
    inputs = values + np.concatenate([near, -near, 2 * near, -2 * near])
    given = dict(zip(own.parameters, inputs[:, D:].T, strict=True))
    motion = solved(replace(own, start=inputs[:, :D], parameters=given), rtol=1e-12)
    found = [motion.final]
    if own.events:
        shape = len(inputs), len(own.which)
        found += [motion.events.time.reshape(shape)]
        found += [own.reshape(*shape, D) for own in (motion.events.states, motion.events.before)]
    for each in found:
        high, low, far, near = each.reshape(4, -1, *each.shape[1:])
        yield np.moveaxis((8 * (high - low) - (far - near)) / (12 * h), 0, -1)


@pytest.mark.sampled(8)
@pytest.mark.parametrize("name", SMOOTH)
def test_derivatives(name):
    own = SYSTEMS[name]
    stiff = [None, True][SMOOTH.index(name) % 2]
    motion = solved(own, derivatives=("x0", *own.parameters), stiff=stiff)
    found = [motion.derivatives]
    if own.events:
        of_events = motion.events.derivatives.items()
        parts = "time", "states", "before"
        found += [{name: getattr(own, part) for name, own in of_events} for part in parts]
    for each, right in zip(found, by_differences(own), strict=True):
        columns = [each["x0"], *(each[name][..., np.newaxis] for name in own.parameters)]
        columns = np.concatenate(columns, axis=-1).reshape(right.shape)
        np.testing.assert_allclose(columns, right, 1e-6, 1e-6 * max(1.0, abs(right).max()))
