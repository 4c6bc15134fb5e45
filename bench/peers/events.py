"""Changes of the state by SciPy and heyoka, one trajectory after the other.

Each function makes a function of the number of trajectories, which returns their last states.
"""

import numpy as np
from events import PROBLEMS, starts
from scipy.integrate import solve_ivp


def _one_by_one(name, run):
    """Return a function of the number of trajectories; run(x, parameters) takes one."""

    def call(count):
        x, parameters = starts(name, count)
        own = [{key: values[k] for key, values in parameters.items()} for k in range(count)]
        return np.array([run(*each) for each in zip(x, own, strict=True)]), None

    return call


def by_scipy(name):
    f, _, where, to, T, _ = PROBLEMS[name]
    options = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-9}
    is_at_times = isinstance(where, np.ndarray)

    def run(x, p):
        t, own = 0.0, lambda t, x: f(x, **p)
        if is_at_times:
            for first, last in zip(where, [*where[1:], T], strict=True):
                x = solve_ivp(own, (first, last), to(x, **p), **options).y[:, -1]
            return x
        surface, direction = where
        event = lambda t, x: surface(x)  # noqa: E731
        event.terminal, event.direction = True, direction
        while True:
            found = solve_ivp(own, (t, T), x, events=event, **options)
            t, x = found.t[-1], found.y[:, -1]
            if found.status == 0:
                return x
            x = np.array(to(x, **p))

    return _one_by_one(name, run)


def by_heyoka(name):
    import heyoka

    f, names, where, to, T, _ = PROBLEMS[name]
    symbols = heyoka.make_vars(*names.split())
    keys = [*starts(name, 1)[1]]
    parameters = {key: heyoka.par[k] for k, key in enumerate(keys)}
    equations = [*zip(symbols, f(symbols, **parameters), strict=True)]
    if name == "balls":  # heyoka takes no numbers as equations
        equations[1] = symbols[1], heyoka.expression(-9.81)

    now = {}  # parameters of the trajectory

    def changed(integrator, *_):
        integrator.state[:] = to(integrator.state.copy(), **now)
        return True

    events = []
    if not isinstance(where, np.ndarray):
        way = getattr(heyoka.event_direction, {1: "positive", -1: "negative"}[where[1]])
        events = [heyoka.t_event(where[0](symbols), callback=changed, direction=way)]
    held = heyoka.taylor_adaptive(equations, [0.0, 0.0], t_events=events, tol=1e-9)

    def run(x, p):
        now.update(p)
        held.time, held.state[:] = 0.0, x
        held.pars[:] = [p[key] for key in keys][: len(held.pars)]
        if events:
            held.reset_cooldowns()
        for t in () if events else where:
            held.propagate_until(t)
            changed(held)
        held.propagate_until(T)
        return held.state.copy()

    return _one_by_one(name, run)
