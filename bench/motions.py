"""Motions that integrators compute at equal error: systems, starts and references."""

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import problem
from work import OTHERS, OURS, Work, load

from suslov_fast import QuadraticField, flow, iterate


class System(NamedTuple):
    """Equations x' = f(x) in D variables, states at time 0 as (batch, D), and the last time."""

    title: str
    f: Callable
    D: int
    starts: Callable[[int], np.ndarray]
    time: float


def henon_heiles(z):
    x, y, u, v = z
    return u, v, -x - 2 * x * y, y * y - x * x - y


def euler_top(x):
    return x[1] * x[2] / 2, -(x[2] * x[0]), x[0] * x[1] / 3


def hires(y):
    pair = 280 * y[5] * y[7]
    return (
        -1.71 * y[0] + 0.43 * y[1] + 8.32 * y[2] + 0.0007,
        1.71 * y[0] - 8.75 * y[1],
        -10.03 * y[2] + 0.43 * y[3] + 0.035 * y[4],
        8.32 * y[1] + 1.71 * y[2] - 1.12 * y[3],
        -1.745 * y[4] + 0.43 * y[5] + 0.43 * y[6],
        -pair + 0.69 * y[3] + 1.71 * y[4] - 0.43 * y[5] + 0.69 * y[6],
        pair - 1.81 * y[6],
        -pair + 1.81 * y[6],
    )


def robertson(x):
    slow, back, fast = 0.04 * x[0], 1e4 * x[1] * x[2], 3e7 * x[1] * x[1]
    return back - slow, slow - back - fast, fast


def near(start, part=0.05):
    """States that differ from one by up to this part of each component."""
    return lambda batch: start * problem.starts(batch, len(start), 1 - part, 1 + part)


SYSTEMS = {
    "henon-heiles": System(
        "Hénon and Heiles", henon_heiles, 4, lambda batch: problem.starts_field(batch, 4), 20.0
    ),
    "euler": System("Euler's top", euler_top, 3, lambda batch: problem.starts(batch, 3), 20.0),
    "lorenz": System(
        "Lorenz",
        problem.lorenz_system,
        3,
        lambda batch: problem.starts(batch, 3, -8, 8) + np.array([0, 0, 20]),
        2.0,
    ),
    "fput": System(
        "FPUT of 6 oscillators",
        problem.fermi_pasta_ulam_tsingou,
        12,
        lambda batch: problem.starts(batch, 12, -0.3, 0.3),
        20.0,
    ),
    "hires": System("HIRES", hires, 8, near(np.array([1, 0, 0, 0, 0, 0, 0, 0.0057])), 321.8122),
    "robertson": System("Robertson", robertson, 3, near(np.array([1.0, 0, 0])), 4e5),
}


@functools.cache
def field_of(name):
    system = SYSTEMS[name]
    return QuadraticField.from_function(system.f, system.D)


@functools.cache
def reference(name, batch):
    """States at the last time, by `flow`; of stiff systems at a tolerance that it reaches soon."""
    rtol = 1e-11 if name in ("hires", "robertson") else 1e-13
    return flow(field_of(name), SYSTEMS[name].starts(batch), time=SYSTEMS[name].time, rtol=rtol).x[
        0
    ]


def by_flow(name, tolerance):
    """A function of starts, on one thread, as of the other methods."""
    time = SYSTEMS[name].time
    return lambda x: flow(field_of(name), x, time=time, rtol=tolerance, threads=1).x[0]


def by_steps(name, method, count):
    options = {"save_every": None, "method": method, "threads": 1}
    eps = SYSTEMS[name].time / count
    return lambda x: iterate(field_of(name), x, eps, count, **options).final


def at_equal_error(function, name, arguments, batch, below, size):
    """Motions whose largest error, beside the largest component, is below a bound.

    `function(name, *arguments)` makes a function of starts. In place of an error the work has 0, or
    by how much the bound is exceeded.
    """
    call, batch = load(function)(name, *arguments), size(batch, 16)
    x = SYSTEMS[name].starts(batch)

    def check():
        wanted = reference(name, batch)
        error = abs(call(x) - wanted).max() / abs(wanted).max()
        return np.array([max(error / below, 1.0)]), np.ones(1)

    return Work(lambda: call(x), len(x), "trajectory", check)


def add_cases(add):
    """Add motions by other methods to the orders; one orbit; other systems, and stiff ones.

    Counts and tolerances are about the least, and largest, with which the error is below its bound.
    """
    by_heyoka, by_scipy = "motions.by_heyoka", "motions.by_scipy"
    for below, runge_kutta, ensemble in (
        (1e-3, 100, 2e-3),
        (1e-6, 450, 5.7e-6),
        (1e-9, 2753, 1.4e-8),
    ):
        for key, label, function, argument in (
            (
                "rk4",
                "Numba, order 4 of Runge and Kutta, one by one",
                "motions.by_runge_kutta",
                runge_kutta,
            ),
            ("ensemble", "heyoka, ensemble of 16 at once", "motions.by_ensemble", ensemble),
        ):
            arguments = at_equal_error, function, "henon-heiles", (argument,), 1024, below
            add("orders", key, OTHERS, label, *arguments, x=below, one_thread=True)
    for below, order8, rtol, tolerance, scipy, lsoda, runge_kutta in (
        (1e-6, 20, 2e-6, 5.8e-6, 3.8e-7, 4.1e-7, 449),
        (1e-9, 44, 5e-9, 1.4e-8, 6.4e-10, 2.5e-10, 2478),
    ):
        for key, whose, label, function, *arguments in (
            ("order8", OURS, '`iterate(..., method="order8")`', by_steps, "order8", order8),
            ("flow", OURS, "`flow`", by_flow, rtol),
            ("heyoka", OTHERS, "heyoka, Taylor integrator", by_heyoka, tolerance),
            (
                "rk4",
                OTHERS,
                "Numba, order 4 of Runge and Kutta",
                "motions.by_runge_kutta",
                runge_kutta,
            ),
            (
                "dop853",
                OTHERS,
                "SciPy, DOP853, compiled right-hand side",
                by_scipy,
                "DOP853",
                scipy,
            ),
            ("lsoda", OTHERS, "SciPy, LSODA, compiled right-hand side", by_scipy, "LSODA", lsoda),
        ):
            arguments = at_equal_error, function, "henon-heiles", arguments, 1, below
            add("one motion", key, whose, label, *arguments, x=below, one_thread=True)
    for name, below, rtol, tolerance in (
        ("euler", 1e-6, 2.2e-7, 5.8e-6),
        ("euler", 1e-9, 3.9e-10, 2e-9),
        ("lorenz", 1e-6, 8.8e-9, 1.1e-7),
        ("lorenz", 1e-9, 5.5e-11, 2.6e-10),
        ("fput", 1e-6, 9.8e-7, 5.8e-6),
        ("fput", 1e-9, 2.9e-9, 1e-7),
    ):
        for key, whose, label, function, *arguments in (
            ("flow", OURS, "`flow`", by_flow, rtol),
            ("heyoka", OTHERS, "heyoka, Taylor integrator, 16 at once", by_heyoka, tolerance),
        ):
            arguments = at_equal_error, function, name, arguments, 1024, below
            label = f"{SYSTEMS[name].title}: {label}"
            add("more motions", f"{name}-{key}", whose, label, *arguments, x=below, one_thread=True)
    for name, below, rtol, lsoda in (
        ("hires", 1e-6, 2.1e-6, 1e-7),
        ("robertson", 1e-6, 1e-3, 6.9e-5),
    ):
        for key, whose, label, batch, function, *arguments in (
            ("flow", OURS, "`flow`", 1024, by_flow, rtol),
            (
                "lsoda",
                OTHERS,
                "SciPy, LSODA, compiled right-hand side",
                16,
                by_scipy,
                "LSODA",
                lsoda,
            ),
        ):
            arguments = at_equal_error, function, name, arguments, batch, below
            label = f"{SYSTEMS[name].title}: {label}"
            add(
                "stiff motions", f"{name}-{key}", whose, label, *arguments, x=below, one_thread=True
            )
