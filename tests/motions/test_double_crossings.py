"""Surfaces that a motion crosses and crosses back within a part of a step."""

import numpy as np
import pytest

import suslov_fast as sf

field = sf.Field


def time_above(c, phase):
    """Return how long the sine has been above c up to a phase, in radians, from 0."""
    turns, a = np.floor(phase / (2 * np.pi)), np.arcsin(c)
    rest = phase - 2 * np.pi * turns
    below = np.clip(rest, 0, np.pi - a) + np.clip(rest - (2 * np.pi + a), 0, -a)
    last = np.where(c >= 0, np.clip(rest - a, 0, np.pi - 2 * a), below)
    return turns * (np.pi - 2 * a) + last


def test_derivatives_of_hours_of_light():
    day = field(lambda s, c: (np.where(np.sin(s[1]) > c, 1.0, 0.0), 1.0), "light t", c=0.99)
    motion = sf.flow(day, [0.0, 0.0], time=200 * np.pi, derivatives="c")
    slope = -200 / np.sqrt(1 - 0.99**2)
    np.testing.assert_allclose(motion.derivatives["c"][0, 0], slope, rtol=1e-6)


def of_oscillators(f, levels, rng, low, **options):
    """States at the end, where 100 oscillators x = sin(t + p) have each of these levels c."""
    p, c = rng.uniform(low, low + 6.0, 100), np.array(levels)[:, np.newaxis]
    family = field(lambda s, c: (f(s[1] - c), s[2], -s[1]), "y x v", c=c)
    motion = sf.flow(family, np.stack([0 * p, np.sin(p), np.cos(p)], 1), **options)
    return motion.states[0, ..., 0], p, c


@pytest.mark.parametrize("stiff", [None, True])
@pytest.mark.parametrize("rtol", [1e-6, 1e-12])
def test_peaks_of_an_oscillator(rtol, stiff, rng):
    """It is the state that crosses c twice, between points of steps."""
    options = {"time": 20.0, "rtol": rtol, "stiff": stiff}
    levels = 0.99, 0.999, 0.9999
    found, p, c = of_oscillators(lambda a: np.where(a > 0, 1.0, 0.0), levels, rng, 0.0, **options)
    error = abs(found - time_above(c, p + 20.0) + time_above(c, p))
    assert (error < 200 * rtol / np.sqrt(1 - c)).all()


@pytest.mark.parametrize(("stiff", "rtol"), [(False, 1e-9), (True, 1e-12)])
def test_kinks_at_peaks_of_an_oscillator(stiff, rtol, rng):
    """The integral begins at 0, where x - c is 0 but for the rounding of x."""
    options = {"time": 8 * np.pi, "rtol": rtol, "stiff": stiff}
    levels = 0.99, 0.999, 0.9999, 0.99998
    found, _, c = of_oscillators(lambda a: np.maximum(a, 0.0), levels, rng, -1.0, **options)
    expected = 8 * (np.sqrt(1 - c * c) - c * np.arccos(c))
    np.testing.assert_allclose(found, expected + 0 * found, atol=200 * rtol)


@pytest.mark.parametrize(("stiff", "direction"), [(None, 1), (True, 0), (None, -1)])
def test_records_of_peaks(stiff, direction, rng):
    depth, p = np.array([1e-2, 1e-4, 1e-6, 1e-8][: 3 if stiff else 4]), rng.uniform(-1.0, 1.0, 100)
    level = (1 - depth[:, np.newaxis]) * (direction or 1)
    f, x0 = field(lambda s, level: (s[1], -s[0]), "x v", level=level), [np.cos(p), -np.sin(p)]
    options = {"time": -60.0 if direction else 60.0, "direction": direction, "stiff": stiff}
    options["surface"] = lambda s, level: s[0] - level
    found = sf.crossings(f, np.transpose(x0), **options)
    at = 2 * np.pi * np.arange(-12, 12) + (np.pi if direction < 0 else 0)
    for k, (i, j) in enumerate(np.ndindex(len(depth), len(p))):
        a = np.arccos(1 - depth[i])
        crossed = np.ravel(at + (a if direction else np.array([[-a], [a]]))) - p[j]
        times = np.sort(abs(crossed[crossed / options["time"] >= 0]))
        own = abs(found.time[found.trajectory == k])
        np.testing.assert_allclose(own, times[times < 60.0], atol=2e-8 / np.sqrt(depth[i]))


@pytest.mark.parametrize("stiff", [None, True])
@pytest.mark.parametrize(
    ("f", "x0"),
    [
        (lambda s: (1 - s[0], np.where(s[0] > 1, 1.0, 0.0)), [2.0, 0.0]),
        (lambda s: (-s[0], -2 * s[1], np.where(s[0] * s[1] > 0, 1.0, 0.0)), [2.0, 1.0, 0.0]),
    ],
)
def test_a_motion_that_comes_to_a_surface_takes_few_steps(f, x0, stiff):
    motion = sf.flow(field(f, len(x0)), [x0, x0], time=500.0, stiff=stiff)
    assert motion.ok.all()
    assert motion.steps.max() < 1000


@pytest.mark.parametrize("rate", [1e4, 1e8])
def test_a_fast_state_beside_a_surface(rate):
    """x - cos t is sin t / rate, which the end of a step knows better than points within it."""
    f = field(
        lambda s: (-rate * (s[0] - np.cos(s[2])), np.where(s[0] > np.cos(s[2]), 1.0, 0.0), 1.0), 3
    )
    motion = sf.flow(f, [1.0, 0.0, 0.0], time=20.0)
    np.testing.assert_allclose(motion.states[0, 1], 20.0 - 3 * np.pi, atol=1e-4 + 10 / rate)
    assert motion.steps < 1000


def test_a_kink_that_a_motion_comes_to_does_not_keep_it_from_the_last_time():
    f = field(lambda s: (s[1], 1 - s[0] - 20 * s[1], abs(s[0] - 1)), "x v y")
    np.testing.assert_allclose(
        sf.flow(f, [2.0, 1.0, 0.0], time=3000.0).states[0, 2], 21.0, rtol=1e-7
    )


@pytest.mark.parametrize(("stiff", "max_step"), [(None, 0.05), (True, 0.1)])
def test_a_time_just_before_a_surface_ends_no_solution(max_step, stiff):
    """Sixty steps of 0.1 end 5e-15 beyond t = 6, which is a surface, and asked for."""
    f = field(lambda s: (np.heaviside(s[1] - 6, 1.0) + (s[1] ** 2 > 49), 1.0), "x t")
    motion = sf.flow(f, [0.0, 0.0], time=[6.0, 12.0], max_step=max_step, stiff=stiff)
    np.testing.assert_allclose(motion.states[:, 0], [0.0, 11.0], atol=1e-9)


def counted(family, x0, surface, time):
    """How often each trajectory crosses a surface upwards, by records, and with actions."""
    acts = sf.Event(surface, direction=1, to=lambda s: tuple(s))
    for events in (sf.Event(surface, direction=1), acts):
        motion = sf.flow(family, x0, time=time, events=events)
        assert motion.ok.all()
        yield motion.events.count[..., 0]


SURVEYS = [(100, 3), pytest.param(2000, 8, marks=pytest.mark.slow)]
HUMPS = [("kink", 1e-6), ("parabola", 3e-4), ("bell", 4e-3), ("distance", 1e-4), ("root", 1e-4)]


@pytest.mark.parametrize(("N", "widths"), SURVEYS)
@pytest.mark.parametrize(("kind", "least"), HUMPS)
def test_humps_that_oscillators_pass(kind, least, N, widths, rng):
    """Oscillators x = cos(t + p) pass humps with the value 0 where x is w away from the top c."""
    surface = {
        "kink": lambda s, c, w: w - abs(s[0] - c),
        "parabola": lambda s, c, w: w * w - (s[0] - c) ** 2,
        "bell": lambda s, c, w: np.exp(-((s[0] - c) ** 2) / (2 * w * w)) - np.exp(-0.5),
        "distance": lambda s, c, w: 2 * w - np.hypot(s[0] - c, w * np.sqrt(3.0)),
        "root": lambda s, c, w: 1 / (w * w + (s[0] - c) ** 2) - 1 / (2 * w * w),
    }[kind]
    for w in np.geomspace(0.1, least, widths):
        c, p = rng.uniform(-0.9, 0.9, N), rng.uniform(0, 2 * np.pi, N)
        family = field(lambda s, c, w: (s[1], -s[0]), "x v", c=c, w=w)
        x0 = np.stack([np.cos(p), -np.sin(p)], 1)
        turns = 2 * np.pi * np.arange(-1, 5)[:, np.newaxis]
        with np.errstate(invalid="ignore"):  # a level beyond 1 is not reached
            times = np.stack([np.arccos(c + w) + turns - p, turns - np.arccos(c - w) - p])
        right = ((times > 0) & (times < 20)).sum(axis=(0, 1))
        for found in counted(family, x0, surface, 20.0):
            np.testing.assert_array_equal(found, right)


@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
def test_targets_that_orbits_pass(rtol, rng):
    """Of radius .003; passages miss its centre by up to .0028, at any place and speed."""
    b, angle, v, t0 = (rng.uniform(*of, 100) for of in ((0, 28e-4), (0, 6.3), (0.5, 2), (0.5, 3)))
    centre, along = rng.uniform(-0.5, 0.5, (2, 100)), np.array([np.cos(angle), np.sin(angle)])
    place, speed = centre + b * np.array([-along[1], along[0]]), v * along  # at the time t0
    c, s = np.cos(t0), np.sin(t0)
    x0 = np.concatenate([place * c - speed * s, speed * c + place * s]).T
    family = field(lambda s, p, q: (s[2], s[3], -s[0], -s[1]), 4, p=centre[0], q=centre[1])

    def inside(s, p, q):
        return 0.003 - np.hypot(s[0] - p, s[1] - q)

    options = {"time": 6.0, "rtol": rtol}
    motion = sf.flow(family, x0, events=sf.Event(inside, terminal=True), **options)
    assert (motion.end < t0).all()
    assert (sf.crossings(family, x0, inside, **options).count >= 2).all()


@pytest.mark.parametrize(("N", "_"), SURVEYS)
@pytest.mark.parametrize("kind", ["clocks", "angles", "phases"])
def test_waves_as_surfaces(kind, N, _, rng):
    w, p = 10 ** rng.uniform(-1, 1.5, N), rng.uniform(0, 6, N)
    b, v = rng.uniform(0, 1, N), 10 ** rng.uniform(-1, 1.5, N)
    b = b * w / v * (kind == "phases")  # phases that grow, faster and slower
    if kind == "angles":
        angles = field(lambda s: (s[1], 0 * s[1]), "angle I")
        given = angles, np.stack([p, w], 1), lambda s: np.sin(s[0])
    else:
        clocks = field(lambda s, **_: (1.0,), "t", w=w, p=p, b=b, v=v)
        given = clocks, [0.0], lambda s, w, p, b, v: np.sin(w * s[0] + p + b * np.sin(v * s[0]))
        if kind == "clocks":
            given = clocks, [0.0], lambda s, w, p: np.sin(w * s[0] + p)
    turns = [np.floor(a / (2 * np.pi)) for a in (p, w * 50.0 + p + b * np.sin(v * 50.0))]
    right = turns[1] - turns[0]
    for found in counted(*given, 50.0):
        np.testing.assert_array_equal(found, right)


def test_powers_of_waves(rng):
    """Half turns with humps, of which many steps of a quarter of a turn would see none."""
    w, p, n, level = 10 ** rng.uniform(-0.5, 0.5, 50), rng.uniform(0, 6, 50), 64, 0.99
    clocks = field(lambda s, w, p: (1.0,), "t", w=w, p=p)
    found = sf.crossings(
        clocks, [0.0], lambda s, w, p: np.sin(w * s[0] + p) ** n - level, time=40.0
    )
    places = np.arccos(level ** (1 / n)) * np.array([[1], [-1]]) + np.pi / 2
    begin, end = (np.floor((phase - places) / np.pi) for phase in (p, w * 40 + p))
    np.testing.assert_array_equal(found.count[:, 0], (end - begin).sum(axis=0))


@pytest.mark.parametrize(("direction", "right"), [(1, 1000), (0, 2000)])
def test_counters_by_a_clock_go_on(direction, right):
    f = field(lambda s: (0.0, 1.0), "n t")
    count = sf.Event(lambda s: np.sin(2 * np.pi * s[1]), direction=direction,
                      to=lambda s: (s[0] + 1, s[1]))  # fmt: skip
    motion = sf.flow(f, [0.0, 0.0], time=1000.25, events=count)
    assert motion.states[0, 0] == right


@pytest.mark.parametrize(("N", "_"), SURVEYS)
def test_waves_and_pulses_in_conditions(N, _, rng):
    """N waves with up to 160 periods are above levels, and a fifth as many parabolas below."""
    w, p, c = (rng.uniform(low, high, N) for low, high in ((0, 2), (0, 6), (-0.99, 0.99)))
    w = 10**w
    f = field(lambda s, w, p, c: (np.where(np.sin(w * s[1] + p) > c, 1.0, 0.0), 1.0), "x t",
              w=w, p=p, c=c)  # fmt: skip
    found = sf.flow(f, [0.0, 0.0], time=10.0).states[0, :, 0]
    right = (time_above(c, w * 10.0 + p) - time_above(c, p)) / w
    np.testing.assert_allclose(found, right, atol=1e-8)
    a, w = rng.uniform(0.5, 9.5, N // 5), 10 ** rng.uniform(-3, -0.3, N // 5)
    f = field(lambda s, a, w: (np.where((s[1] - a) ** 2 < w * w, 1.0, 0.0), 1.0), "x t", a=a, w=w)
    found = sf.flow(f, [0.0, 0.0], time=10.0).states[0, :, 0]
    np.testing.assert_allclose(found, np.minimum(a + w, 10) - np.maximum(a - w, 0), atol=1e-8)


@pytest.mark.parametrize("count", [300, pytest.param(1500, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("wave", "inverse"), [(np.sin, np.arcsin), (np.cos, np.arccos)])
def test_waves_in_waves_with_shallow_tops(wave, inverse, count, rng):
    """wave(k sin(a)) = c at sin(a) = p / k, where p is an angle with wave(p) = c."""
    k, w, start = rng.uniform([1.6, 0.5, 0.0], [8.0, 8.0, 2 * np.pi], (2 * count, 3)).T
    slope = wave(k + np.pi / 2)  # of wave at k
    c = wave(k) - np.sign(slope) * 10 ** rng.uniform(-5, np.log10(0.03), 2 * count)
    good = np.flatnonzero((abs(c) < 1) & (abs(slope) > 0.05))[:count]
    k, w, start, c = (each[good] for each in (k, w, start, c))
    p = np.array([inverse(c), np.pi - inverse(c) if wave is np.sin else -inverse(c)])
    p = p[:, np.newaxis] + 2 * np.pi * np.arange(-2, 3)[:, np.newaxis]
    with np.errstate(invalid="ignore"):
        places = np.arcsin(p / k)  # NaN beyond the amplitude
    places = np.concatenate([places, np.pi - places], axis=1)
    turns = [np.floor((end - places) / (2 * np.pi)) for end in (start, start + 30 * w)]
    exact = np.nansum(turns[1] - turns[0], axis=(0, 1))

    def surface(s, k, w, start, c):
        return wave(k * np.sin(w * s[1] + start)) - c

    waves = field(lambda s, k, w, start, c: (0 * s[0], 1.0), "x t", k=k, w=w, start=start, c=c)
    for to in (None, ("x + 1", "t")):
        run = sf.flow(waves, np.zeros((count, 2)), time=30.0, events=sf.Event(surface, to=to))
        np.testing.assert_array_equal(run.events.count[:, 0], exact)
