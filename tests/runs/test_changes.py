"""Changes of the state along motions: right values, order, ends, bits."""

import numpy as np
import pytest

from suslov_fast import Field, QuadraticField, Status, Suslov3D, flow
from suslov_fast.runs.changes import Change

DECAY = Field.from_function(lambda x: (-x[0],), "x")
GUT = Field.from_function(lambda x, k, dose: (-k * x[0], k * x[0] - 0.1 * x[1]), "gut blood",
                          k=1.0, dose=100.0)  # fmt: skip
DOSE = {"to": lambda x, dose: (x[0] + dose, x[1])}


def after_doses(times, dose, k, t):
    """Return the amounts in gut and blood at time t, after doses at these times."""
    s = t - np.asarray(times, float)
    s = s[s >= 0.0]
    in_gut = np.exp(-k * s)
    in_blood = k / (0.1 - k) * (in_gut - np.exp(-0.1 * s))
    return dose * np.array([in_gut.sum(), in_blood.sum()])


@pytest.mark.parametrize("stiff", [None, True, False])
def test_doses_of_subjects_at_times_of_their_own(stiff):
    rng = np.random.default_rng(0)
    times = np.sort(rng.uniform(0.0, 80.0, (20, 6)), axis=1)
    times[3, 4:], times[4, 0] = np.nan, 0.0
    own = GUT.with_parameters(k=rng.uniform(0.5, 2.0, 20), dose=rng.uniform(50, 100, 20))
    motion = flow(own, [0.0, 0.0], time=[0.0, 20.0, times[5, 2], 80.0], stiff=stiff,
                  changes=Change(times=times, **DOSE))  # fmt: skip
    pairs = zip(times, own.parameters["dose"], own.parameters["k"], strict=True)
    right = np.array([[after_doses(*each, t) for t in motion.time] for each in pairs])
    np.testing.assert_allclose(motion.x, right.swapaxes(0, 1), atol=3e-7)
    assert motion.ok
    assert motion.changes.count[:, 0].tolist() == (~np.isnan(times)).sum(axis=1).tolist()
    np.testing.assert_array_equal(motion.changes.time, times[~np.isnan(times)])
    given = motion.changes.states - motion.changes.before
    np.testing.assert_allclose(given[:, 0], own.parameters["dose"][motion.changes.trajectory])
    alone = flow(own[7], [0.0, 0.0], time=motion.time, stiff=stiff,
                 changes=Change(times=times[7], **DOSE))  # fmt: skip
    if times[5, 2] not in times[7]:
        np.testing.assert_array_equal(alone.x, motion.x[:, 7])


ADD = [Change(times=[1], to=lambda x: (x[0] + 12,)), Change(times=[1], to=lambda x: (10 * x[0],))]


@pytest.mark.parametrize(
    ("changes", "right"),
    [
        (Change(times=[1, 1], to=lambda x: (x[0] + 1,)), [0, 2]),
        (ADD, [0, 120]),
        (ADD[::-1], [0, 12]),
        (Change(times=[0], to=lambda x: (x[0] + 1,)), [1, np.exp(-1)]),
        (Change(times=[np.nan, -1, 2, np.inf], to=lambda x: (x[0] + 1,)), [0, 0]),
    ],
)
def test_order_and_times(changes, right):
    """At one instant in the order of the list; at a time asked, the state after it."""
    motion = flow(DECAY, [0.0], time=[0.0, 1.0], changes=changes)
    np.testing.assert_allclose(motion.x[:, 0], right, rtol=1e-9, atol=1e-15)


def test_backwards():
    change = Change(times=[-1.0], to=lambda x: (x[0] + 1,))
    motion = flow(DECAY, [1.0], time=[-2.0, -1.0, -0.5], changes=change)
    right = [np.e * (np.e + 1), np.e + 1, np.e**0.5]
    np.testing.assert_allclose(motion.x[:, 0], right, rtol=1e-9)


@pytest.mark.parametrize(("keywords", "end"), [({"ends": True}, 1.0), ({"most": 2}, 2.0)])
def test_times_that_end(keywords, end):
    motion = flow(DECAY, [1.0], time=[3.0, 1.0, 2.0], changes=Change(times=[1, 2, 3], **keywords))
    assert (motion.status, motion.end) == (Status.STOPPED, end)
    assert np.isnan(motion.x[:, 0]).tolist() == [True, False, end == 1.0]


def test_time_0_alone():
    motion = flow(DECAY, [1.0], time=0.0, changes=Change(times=[0, 0], to=lambda x: (3 * x[0],)))
    assert motion.x.tolist() == [[9.0]]
    assert motion.ok


def test_other_systems():
    """Quadratic fields have lists for changes, and bodies take steps."""

    def f(x, a):
        return a * x[0] * x[1], 1 - x[1]

    change = Change(times=[1], to=lambda x, a: (x[0] * a, 0))
    own = (each.from_function(f, "u v", a=[1.0, 2.0]) for each in (Field, QuadraticField))
    first, second = (flow(each, [1.0, 0.5], time=2.0, changes=change).x for each in own)
    np.testing.assert_allclose(first, second, rtol=1e-14)
    body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    motion = flow(body, [1.0, 0.5], time=2.0, changes=Change(times=[1.0]))
    np.testing.assert_allclose(motion.omega, flow(body, [1.0, 0.5], time=2.0).omega, rtol=1e-9)
