"""Keys of equations: the number of a variable is no constant, though 1 == 1.0 and 0.0 == -0.0."""

import math

import numpy as np
import pytest

from suslov_fast import Event, Field, crossings, flow, lyapunov_exponents
from suslov_fast.core.llvm.compiler import known_codes


def test_zeros_keep_their_signs():
    field = Field(lambda s: (0 * s[0], 0 * s[1]), "x y")
    for zero in (0.0, -0.0):
        states = flow(field, [1.0, 1.0], time=1.0, events=Event(times=[0.5], to=(zero, "y")))
        assert math.copysign(1.0, states.events.states[0, 0]) == math.copysign(1.0, zero)


def test_exponents_and_derivatives_of_changes_that_differ_by_a_number():
    """Of x' = -x, y' = -y, where at time 1 x becomes its distance from (0, y) or from (0, 1)."""
    field = Field(lambda s: -s, "x y")
    for other in ("y", "1"):
        change = Event(times=[1.0], to=(f"hypot(x, {other})", "y"))
        run = flow(field, [1.0, 3.0], time=2.0, events=change, derivatives=("x0",))
        x, distance = math.exp(-1), math.exp(-1) * 3.0 if other == "y" else 1.0
        slope = x / math.hypot(x, distance)
        assert run.derivatives["x0"][-1, 0, 0] == pytest.approx(slope * math.exp(-2), rel=1e-7)
        exponents = lyapunov_exponents(field, [1.0, 3.0], time=2.0, events=change)
        assert exponents.sum() == pytest.approx(-2 + math.log(slope) / 2, abs=1e-7)


def test_events_that_differ_by_numbers_share_their_code():
    """Balls from h = 1 with g = 2, that keep a part e of their speed on a floor at -d."""
    ball, codes = Field(lambda s: (s[1], -2 + 0 * s[0]), "h v"), []
    for e, d in ((0.9, 0.2), (0.8, 0.3), (0.7, 0.4)):
        bounce = Event(lambda s: s[0] + d, to=lambda s: (s[0], -e * s[1]), direction=-1)  # noqa: B023
        for derivatives in ((), ("x0",)):
            run = flow(ball, [1.0, 0.0], time=2.0, events=bounce, derivatives=derivatives)
            t = 2.0 - math.sqrt(1 + d)
            assert run.states[-1, 0] == pytest.approx(e * 2 * (2 - t) * t - t**2 - d, abs=1e-8)
        codes.append(len(known_codes))
    assert codes[0] == codes[-1]


def test_a_number_takes_the_place_of_a_variable():
    """Surfaces x - y and x - 1, and new values n + 1 of two components, of which one is 1."""
    field = Field(lambda s: (-s[0], 0 * s[1], 0 * s[2]), "x y z")
    for surface, right in (("x - y", 4 / 3), ("x - 1", 2.0)):
        found = crossings(field, [2.0, 1.5, 0.3], surface, time=3.0)
        np.testing.assert_allclose(found.time, [math.log(right)], rtol=1e-8)
    field = Field(lambda s: (1.5 - s[0], 0 * s[1]), "v n")
    for to, count in (((0, "n + 1"), 9), (("v", "n + 1"), 1)):
        fires = Event("v - 1", direction=1, to=to)
        assert flow(field, [0.0, 0.0], time=10.0, events=fires).events.count == count


@pytest.mark.parametrize("derivatives", [(), ("x0",), ("b",)])
def test_functions_that_differ_by_numbers_share_their_code(derivatives):
    """Pendulums in a sweep have the bits of a family's members, and two codes."""
    values, b = [0.3, 0.7, 1.3, 3.1], 0.25

    def rates(s, a, b):
        return s[1], -a * np.sin(s[0]) - b * s[1] / 3.0, 1.5

    family = Field(rates, "x v t", a=values, b=b)
    states = [1.0, 0.0, 0.0]
    whole, codes = flow(family, states, time=[2.0, 5.0], derivatives=derivatives), []
    for k, a in enumerate(values):
        of_value = Field(lambda s, b: rates(s, a, b), "x v t", b=b)  # noqa: B023
        run = flow(of_value, states, time=[2.0, 5.0], derivatives=derivatives)
        np.testing.assert_array_equal(run.states, whole.states[:, k])
        for name in derivatives:
            own = whole.derivatives[name][:, k]
            np.testing.assert_array_equal(run.derivatives[name], own)
        codes.append(len(known_codes))
    assert codes[1] == codes[-1]
