"""Poles and overflow, and the warnings and errors about them."""

import pickle

import numpy as np
import pytest

import suslov_fast as sf

# With the body `unit` and eps = 1: x = Omega1 and y = -Omega2.
ON_THE_POLE, HEALTHY = [1.0, -3.0], [0.3, 0.1]


def test_starts_that_are_nan_are_told_by_runs_alone(body):
    with pytest.warns(sf.IntegrationWarning, match="first: 1 at step 0"):
        sf.iterate(body, [HEALTHY, [np.nan, 1.0]], 0.2, 5)
    assert np.isnan(sf.step(body, [np.nan, 1.0], 0.2)).all()
    assert all(each.message for each in sf.Status)


def test_raise_and_ignore(unit):
    with pytest.raises(sf.SingularStepError, match=r"^1 of 2 ") as caught:
        sf.iterate(unit, [HEALTHY, ON_THE_POLE], 1, 4, on_singular="raise")
    again = pickle.loads(pickle.dumps(caught.value))
    assert str(again) == str(caught.value)
    ignored = sf.iterate(unit, [HEALTHY, ON_THE_POLE], 1, 4, on_singular="ignore")
    assert again.trajectories == ignored


def test_memory(body):
    with pytest.raises(MemoryError):
        sf.iterate(body, np.ones((10**6, 2)), 0.1, 10**9)
    with pytest.raises(MemoryError):
        body.exact(np.ones((10**6, 2)), 0.1, np.arange(10**6))
    field, many = body.field(), np.ones((10**6, 2))
    family = sf.Field(lambda x, a: (a * x[1], x[0]), 2, a=many[:, :1])
    for system, starts in ((field, np.broadcast_to(1.0, (10**13, 2))), (family, many)):
        with pytest.raises(MemoryError):
            sf.flow(system, starts, time=1.0)


def test_a_pole_of_three_components():
    with pytest.warns(sf.IntegrationWarning, match=r"^1 of 2 "):
        lost = sf.Suslov3D(1, 1, 1, 0).step_full([[1.0, -3.0, 0.0], [0.3, 0.1, 0]], 1, 2)
    assert np.isnan(lost).all(axis=1).tolist() == [True, False]


UNIT = sf.Suslov3D(1, 1, 1, 0)
WARNING_CALLS = {
    "iterate": lambda: sf.iterate(UNIT, ON_THE_POLE, 1, 2),
    "jacobian": lambda: sf.kahan.jacobian(UNIT, ON_THE_POLE, 1),
    "run.reaction": lambda: UNIT.reaction(ON_THE_POLE, 1),
    "lyapunov_exponents": lambda: sf.lyapunov_exponents(UNIT, ON_THE_POLE, 1, 1),
    "exact": lambda: UNIT.exact([0.5, -9.0], 1, 2.5),
}


@pytest.mark.parametrize("name", WARNING_CALLS)
def test_warnings_point_at_the_line_of_the_user(name):
    with pytest.warns((UserWarning, RuntimeWarning)) as caught:
        WARNING_CALLS[name]()
    lines = WARNING_CALLS[name].__code__
    assert {(each.filename, each.lineno) for each in caught} == {(__file__, lines.co_firstlineno)}
