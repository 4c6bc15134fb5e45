"""Random piecewise linear motions with cascades of events, against matrix exponentials."""

import numpy as np
import pytest
from scipy.linalg import expm

from suslov_fast import Event, Field, Status, flow

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:.*events that follow")]
T, MOST = 4.0, 70


class Endless(Exception):
    """More events at one instant than a motion may have."""


class System:
    """x' = A x + b, surfaces n . x = c with affine maps, and times with affine maps."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        D = rng.integers(1, 4)
        A = rng.normal(size=(D, D)) * 1.2
        self.A = A - np.eye(D) * max(0.0, np.linalg.eigvals(A).real.max() - 0.1)
        self.b, self.x, self.D = rng.normal(size=D), rng.normal(size=D), D
        surfaces, schedules = rng.integers(0, 4), rng.integers(0, 3)

        def affine():
            return rng.normal(size=(D, D)) * 0.5, rng.normal(size=D)

        self.surfaces = [
            (rng.normal(size=D), 0.7 * rng.normal(), int(rng.integers(-1, 2)), affine())
            for _ in range(surfaces)
        ]
        self.times = [
            (np.sort(rng.uniform(0.1, T, rng.integers(1, 5))), affine()) for _ in range(schedules)
        ]

        self.maps = [own for *_, own in (*self.surfaces, *self.times)]

    def events(self):
        def function(R, r):
            return lambda x: [R[i] @ x + r[i] for i in range(self.D)]

        found = [
            Event(lambda x, n=n, c=c: n @ x - c, direction=way, to=function(*own))
            for n, c, way, own in self.surfaces
        ]
        found += [Event(times=times, to=function(*own)) for times, own in self.times]
        return Field(function(self.A, self.b), " ".join("abc"[: self.D])), found

    def reference(self, parts=2000):
        """Return times and numbers of all events, and the last state."""
        D, S = self.D, len(self.surfaces)
        M = np.zeros((D + 1, D + 1))
        M[:D, :D], M[:D, D] = self.A, self.b
        stops = sorted((t, S + j) for j, (times, _) in enumerate(self.times) for t in times)
        z, t, found, h = np.append(self.x, 1.0), 0.0, [], T / parts
        whole = expm(M * h)

        def sides_of(z):
            return [n @ z[:D] - c >= 0.0 for n, c, *_ in self.surfaces]

        def moved(z, number):
            found.append((t, number))
            R, r = self.maps[number]
            return np.append(R @ z[:D] + r, 1.0)

        def cascade(z):
            before, most = -1, len(found) + MOST
            while before != len(found):
                before = len(found)
                for k, (_, _, way, _) in enumerate(self.surfaces):
                    now = sides_of(z)[k]
                    acts = now != sides[k] and way in (0, 1 if now else -1)
                    z = moved(z, k) if acts else z
                    sides[k] = sides_of(z)[k]
                if len(found) > most:
                    raise Endless
            return z

        sides = sides_of(z)
        while t < T and len(found) < 400:
            step = min(h, (stops[0][0] if stops else T) - t)
            following = (whole if step == h else expm(M * step)) @ z
            if sides_of(following) != sides:
                low, high = 0.0, step
                for _ in range(60):
                    middle = (low + high) / 2
                    if sides_of(expm(M * middle) @ z) == sides:
                        low = middle
                    else:
                        high = middle
                t += high
                z = cascade(expm(M * high) @ z)
                continue
            z, t = following, t + step
            if stops and t >= stops[0][0] - 1e-15:
                z = cascade(moved(z, stops.pop(0)[1]))
        return np.array(found).reshape(-1, 2), z[:D]


@pytest.mark.parametrize("first", range(0, 60, 15))
def test_random_systems_with_cascades(first):
    compared = 0
    for seed in range(first, first + 15):
        system = System(seed)
        if not system.surfaces and not system.times:
            continue
        field, events = system.events()
        try:
            right, last = system.reference()
        except Endless:
            right = last = None
        for rtol, max_step in ((1e-6, 0.03), (1e-9, None), (1e-11, 0.03)):
            given = {"rtol": rtol, "max_step": max_step}
            motion = flow(field, system.x, time=T, events=events, **given)
            if right is None:
                assert motion.status == Status.ACCUMULATES
                continue
            assert motion.events.which.tolist() == right[:, 1].tolist(), seed
            np.testing.assert_allclose(motion.events.time, right[:, 0], atol=1e4 * rtol)
            allowed = 1e5 * rtol * max(1.0, abs(last).max())
            np.testing.assert_allclose(motion.states[-1], last, atol=allowed)
        compared += right is not None
    assert compared >= 8
