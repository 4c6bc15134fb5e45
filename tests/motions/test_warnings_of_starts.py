"""Starts that are likely to be mistakes: at rest on a surface, beyond a table."""

import numpy as np
import pytest

import suslov_fast as sf

SURFACES = {
    "floor": ((lambda s: s[0] - 0.3, lambda s: (s[0], -0.5 * s[1], s[2])), [0.3, 0.0, 0.0]),
    "table": (
        (
            lambda s: s[0] - 0.5 * np.sin(s[2]),
            lambda s: (s[0], 1.5 * 0.5 * np.cos(s[2]) - 0.5 * s[1], s[2]),
        ),
        [0.0, 0.5, 0.0],
    ),
    "bowl": ((lambda s: s[0] - s[1] ** 2, None), [0.0, 0.0, 0.0]),
}


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("g", [9.81, [1.0, 1e3]])
def test_a_start_at_rest_on_its_floor(name, g):
    """A ball stays on the floor. Where no event acts, it falls, h0 - g t**2 / 2, and is told of."""
    (surface, to), x0 = SURFACES[name]
    ball = sf.Field(lambda s, g: (s[1], -g, 1.0), "h v t", g=g)
    event = sf.Event(surface, to=to, terminal=to is None, direction="down")
    if to is None:
        with pytest.warns(UserWarning, match=f"x0 rests .* in {np.size(g)} of {np.size(g)}"):
            motion = sf.flow(ball, x0, time=0.1, events=event)
        h = x0[0] + 0.1 * x0[1] - np.asarray(g) * 0.005
    else:
        motion = sf.flow(ball, x0, time=0.1, events=event)
        h = {"floor": 0.3, "table": 0.5 * np.sin(0.1)}[name]
    np.testing.assert_allclose(motion["h"][0], h, rtol=1e-9)
    for v in (-1.0, 2.0):  # with a speed it is no mistake
        sf.flow(ball, [x0[0], x0[1] + v, 0.0], time=1e-3, events=event)
    up = sf.Event(surface, to=to, terminal=to is None, direction="up")
    sf.flow(ball, x0, time=0.1, events=up)


def test_a_start_at_rest_is_told_of_beside_a_mode():
    """f slides along v = 0, and no event holds the ball."""
    f = sf.Field(lambda s: (s[1], -9.81, s[3], -s[2] - 0.15 * np.sign(s[3])), "h w x v")
    with pytest.warns(UserWarning, match="x0 rests"):
        motion = sf.flow(
            f, [0.0, 0.0, 1.0, 0.0], time=20.0, events=sf.Event("h", direction=-1, terminal=True)
        )
    np.testing.assert_allclose(motion.final, [-1962.0, -196.2, -0.1, 0.0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("start", "is_told"), [(-9.0, True), (-7.0, False), (7.0, False), (8.0, True)]
)
def test_times_before_or_after_a_table_are_told_of(start, is_told):
    table = [0, 4, 8], [1, 3, 1]
    field = sf.Field(lambda s: (np.interp(s[1], *table), 1.0), "x t")
    if is_told:
        with pytest.warns(UserWarning, match="from 0 to 8, and t from"):
            motion = sf.flow(field, [0.0, start], time=[1.0, 8.0])
    else:
        motion = sf.flow(field, [0.0, start], time=[1.0, 8.0])
    t = np.sort([*table[0], start, *(start + motion.time)])  # f is linear between these
    rates = np.interp(t, *table)
    area = np.append(0.0, np.cumsum(np.diff(t) * (rates[:-1] + rates[1:]) / 2))
    expected = np.interp(start + motion.time, t, area) - np.interp(start, t, area)
    np.testing.assert_allclose(motion["x"], expected, rtol=1e-9)
