"""Motions to a tolerance by others: heyoka, SciPy, and Runge and Kutta's method in Numba.

Each function makes a function of starts (batch, D), which returns the states at the last time.
Right-hand sides are compiled, by heyoka, by Numba or by gcc.
"""

import functools
import math
from types import SimpleNamespace

import numba
import numpy as np
from motions import SYSTEMS
from scipy.integrate import odeint, solve_ivp

from peers.integrators import SIDE_BY_SIDE, by_batches


class _Symbol:
    """A number in a program: its operations append lines that name their results."""

    def __init__(self, name, lines):
        self.name, self.lines = name, lines

    def line(self, text):
        result = f"t{len(self.lines)}"
        self.lines.append((result, text))
        return _Symbol(result, self.lines)

    def __pow__(self, power):
        return functools.reduce(lambda a, b: a * b, [self] * power)

    def __neg__(self):
        return self.line(f"-{self.name}")

    def __le__(self, other):
        return self.line(f"{self.name} <= {_text(other)}")


def _text(a):
    return a.name if isinstance(a, _Symbol) else repr(float(a))


def _add_operation(method, sign):
    forward = lambda a, b: a.line(f"{a.name} {sign} {_text(b)}")  # noqa: E731
    setattr(_Symbol, f"__{method}__", forward)
    backward = lambda a, b: a.line(f"{_text(b)} {sign} {a.name}")  # noqa: E731
    setattr(_Symbol, f"__r{method}__", backward)


for _method, _sign in (("add", "+"), ("sub", "-"), ("mul", "*"), ("truediv", "/")):
    _add_operation(_method, _sign)


def _function(name):
    return lambda a, *others: a.line(f"{name}({', '.join(map(_text, (a, *others)))})")


# In place of NumPy, for the functions that systems use.
FUNCTIONS = SimpleNamespace(
    **{name: _function(name) for name in ("sqrt", "sin", "cos", "exp")},
    power=_function("pow"),
    where=lambda truth, a, b: truth * a + (1.0 - truth) * b,
)


def lines_of(f, names):
    """Return lines (result, expression) of f, a function of symbols, and the names of its results.

    The text is valid in Python and in C.
    """
    lines = []
    found = f([_Symbol(name, lines) for name in names])
    return lines, [_text(each) for each in found]


def program(name):
    """Return the lines of a system, whose variables are x0, x1 ..."""
    system = SYSTEMS[name]
    return lines_of(lambda x: system.f(x, FUNCTIONS), [f"x{i}" for i in range(system.D)])


@functools.cache
def _rates(name):
    """Return a compiled function that writes f(x) to `out`."""
    lines, results = program(name)
    text = ["def rates(x, out):"] + [f"    x{i} = x[{i}]" for i in range(len(results))]
    text += [f"    {result} = {value}" for result, value in lines]
    text += [f"    out[{i}] = {result}" for i, result in enumerate(results)]
    names = {"sqrt": math.sqrt, "sin": math.sin}
    exec("\n".join(text), names)
    return numba.njit(error_model="numpy")(names["rates"])


@functools.cache
def compiled_f(name):
    rates = _rates(name)

    @numba.njit
    def right(t, x):
        out = np.zeros_like(x)
        rates(x, out)
        return out

    return right


@functools.cache
def _runge_kutta(name):
    rates = _rates(name)

    @numba.njit(error_model="numpy")
    def runge_kutta(x, eps, steps):
        D = x.shape[1]
        k, y, total = np.zeros(D), np.zeros(D), np.zeros(D)
        for state in x:
            for _ in range(steps):
                for i in range(D):
                    total[i], y[i] = 0.0, state[i]
                for part, weight in ((0.5, 1.0), (0.5, 2.0), (1.0, 2.0), (0.0, 1.0)):
                    rates(y, k)
                    for i in range(D):
                        total[i] += weight * k[i]
                        y[i] = state[i] + part * eps * k[i]
                for i in range(D):
                    state[i] += eps / 6 * total[i]

    return runge_kutta


def by_runge_kutta(name, steps):
    """So many equal steps of order 4, orbits one after the other."""

    def run(x):
        x = x.copy()
        _runge_kutta(name)(x, SYSTEMS[name].time / steps, steps)
        return x

    return run


def by_scipy(name, method, tolerance):
    """SciPy's `solve_ivp`, orbits one after the other."""
    settings = {"method": method, "rtol": tolerance, "atol": 1e-3 * tolerance}
    time = SYSTEMS[name].time
    right = compiled_f(name)
    return lambda x: np.array([solve_ivp(right, (0, time), s, **settings).y[:, -1] for s in x])


def by_odeint(name, tolerance):
    """SciPy's `odeint`, LSODA, orbits one after the other."""
    settings = {"rtol": tolerance, "atol": 1e-3 * tolerance, "tfirst": True, "mxstep": 100_000}
    times, right = [0.0, SYSTEMS[name].time], compiled_f(name)
    return lambda x: np.array([odeint(right, s, times, **settings)[-1] for s in x])


def heyoka_system(name):
    import heyoka

    variables = heyoka.make_vars(*(f"x{i}" for i in range(SYSTEMS[name].D)))
    return [*zip(variables, SYSTEMS[name].f(variables, heyoka), strict=True)]


def by_heyoka(name, tolerance):
    """heyoka's Taylor integrator in batches of 16, or of one orbit alone."""
    import heyoka

    D, time, system = SYSTEMS[name].D, SYSTEMS[name].time, heyoka_system(name)
    alone = heyoka.taylor_adaptive(system, np.zeros(D), tol=tolerance)
    several = heyoka.taylor_adaptive_batch(system, np.zeros((D, SIDE_BY_SIDE)), tol=tolerance)

    def run(x):
        if len(x) == 1:
            alone.time, alone.state[:] = 0.0, x[0]
            alone.propagate_until(time)
            return alone.state[np.newaxis].copy()
        return by_batches(several, x, time)

    return run


def by_ensemble(name, tolerance):
    """heyoka's ensemble of integrators of batches of 16, on one thread."""
    import heyoka

    D, time, system = SYSTEMS[name].D, SYSTEMS[name].time, heyoka_system(name)
    several = heyoka.taylor_adaptive_batch(system, np.zeros((D, SIDE_BY_SIDE)), tol=tolerance)

    def run(x):
        states = np.resize(x, (-(-len(x) // SIDE_BY_SIDE) * SIDE_BY_SIDE, D))
        parts = states.reshape(-1, SIDE_BY_SIDE, D)

        def begin(integrator, k):
            integrator.set_time(0.0)
            integrator.state[:] = parts[k].T
            return integrator

        found = heyoka.ensemble_propagate_until_batch(
            several, time, len(parts), begin, max_workers=1
        )
        return np.concatenate([each[0].state.T for each in found])[: len(x)]

    return run
