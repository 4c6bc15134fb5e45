"""Changes of the state: balls that bounce, neurons that spike, patients with doses.

All are of the processor's time of one thread. Peers take trajectories one by one, and fewer.
"""

from functools import cache

import numpy as np
from work import OTHERS, OURS, Work, load

from suslov_fast import Event, Field, flow


def ball(x, e):
    return x[1], -9.81


def neuron(x, c, d):
    v, u = x
    return 0.04 * v**2 + 5 * v + 150 - u, 0.02 * (0.2 * v - u)


def patient(x, k):
    return -1.1 * x[0], 1.1 * x[0] - k * x[1]


def of_patient(x, k):
    return x[0] + 80, x[1]


DOSES = 12.0 * np.arange(14)
# f, names, the surface with its direction, or times; the new state; the last time; the batch.
PROBLEMS = {
    "balls": (ball, "h v", (lambda x: x[0], -1), lambda x, e: (x[0], -e * x[1]), 5.0, 1000),
    "neurons": (
        neuron, "v u", (lambda x: x[0] - 30, 1), lambda x, c, d: (c, x[1] + d), 1000.0, 200
    ),
    "patients": (patient, "gut blood", DOSES, of_patient, 168.0, 1000),
}  # fmt: skip
TITLES = {
    "balls": "1,000 balls to time 5",
    "neurons": "200 neurons of Izhikevich for a second",
    "patients": "1,000 patients, 14 doses each",
}


def starts(name, count):
    """Starts (count, 2), and parameters (count,) by name."""
    rng = np.random.default_rng(7)
    uniform = lambda low, high: rng.uniform(low, high, 1000)[:count]  # noqa: E731
    if name == "balls":
        return np.stack([uniform(0.5, 2), np.zeros(count)], axis=1), {"e": np.full(count, 0.9)}
    if name == "neurons":
        v = np.stack([uniform(-70, -60), np.full(count, -13.0)], axis=1)
        return v, {"c": uniform(-65, -55), "d": uniform(4, 8)}
    return np.zeros((count, 2)), {"k": uniform(0.05, 0.3)}


@cache
def by_flow(name, rtol=1e-9):
    """Return a function of the number of trajectories: last states, and the number of changes."""
    f, names, where, to, T, _ = PROBLEMS[name]
    if isinstance(where, np.ndarray):
        change = Event(times=where, to=to)
    else:
        change = Event(where[0], direction=where[1], to=to)

    @cache
    def of(count):
        x, parameters = starts(name, count)
        return Field(f, names, **parameters), x

    def call(count):
        field, x = of(count)
        motion = flow(field, x, time=T, events=change, rtol=rtol, threads=1)
        return motion.states[0], len(motion.events.time)

    return call


def changes(function, name, batch, size):
    """Return work in units of changes, with errors below 1e-6; as `motions.at_equal_error`."""
    call, count = load(function)(name), size(batch, 3)

    def check():
        found, wanted = call(count)[0], by_flow(name, 1e-12)(count)[0]
        error = abs(found - wanted).max() / abs(wanted).max()
        return np.array([max(error / 1e-6, 1.0)]), np.ones(1)

    return Work(lambda: call(count), by_flow(name)(count)[1], "change", check)


def add_cases(add):
    """Add changes by this package and by peers."""
    for name, title in TITLES.items():
        whole = PROBLEMS[name][-1]
        for key, whose, label, function, batch in (
            ("flow", OURS, "`flow`", by_flow, whole),
            ("heyoka", OTHERS, "heyoka, terminal events, one by one", "events.by_heyoka", 20),
            ("scipy", OTHERS, "SciPy, DOP853, one by one", "events.by_scipy", 2),
        ):
            arguments = changes, function, name, batch
            add("changes", f"{name}-{key}", whose, f"{title}: {label}", *arguments, one_thread=True)
