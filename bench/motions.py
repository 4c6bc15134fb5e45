"""Motions that integrators compute at equal error: systems, starts and references."""

import argparse
import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import problem
from standard_problems import hires, robertson
from work import OTHERS, OURS, C, Work, load

from suslov_fast import Field, flow, iterate


class System(NamedTuple):
    """Equations x' = f(x, m) in D variables, where the module m has sin and sqrt, as NumPy has.

    `starts(batch)` returns states (batch, D) at time 0; the motion ends at `time`.
    """

    title: str
    f: Callable
    D: int
    starts: Callable[[int], np.ndarray]
    time: float


def henon_heiles(z, m):
    x, y, u, v = z
    return u, v, -x - 2 * x * y, y * y - x * x - y


def euler_top(x, m):
    return x[1] * x[2] / 2, -(x[2] * x[0]), x[0] * x[1] / 3


def van_der_pol(x, m):
    return x[1], 1000 * (1 - x[0] * x[0]) * x[1] - x[0]


def kepler(z, m):
    x, y, u, v = z
    square = x * x + y * y
    cube = square * m.sqrt(square)
    return u, v, -x / cube, -y / cube


def pendulum(x, m):
    return x[1], -m.sin(x[0])


def rosenzweig_macarthur(x, m):
    n, p = x
    eaten = n * p / (1 + n)
    return n * (1 - n / 4) - eaten, eaten - p / 3


def on_an_ellipse(batch):
    """States on an orbit of eccentricity 0.6 and semi-axis 1, which returns after 2 pi."""
    angle = problem.starts(batch, 1, 0, 2 * np.pi)[:, 0]
    r, side = 1 - 0.6 * np.cos(angle), 0.8
    position = np.cos(angle) - 0.6, side * np.sin(angle)
    return np.stack([*position, -np.sin(angle) / r, side * np.cos(angle) / r], axis=-1)


def lattice(f):
    """A right-hand side of `problem`, which needs no functions."""
    return lambda x, m: f(x)


def near(start, part=0.05):
    """States that differ from one by up to this part of each component."""
    return lambda batch: start * problem.starts(batch, len(start), 1 - part, 1 + part)


def between(D, low, high):
    return lambda batch: problem.starts(batch, D, low, high)


SYSTEMS = {
    "henon-heiles": System(
        "Hénon and Heiles", henon_heiles, 4, lambda batch: problem.starts_field(batch, 4), 20.0
    ),
    "euler": System("Euler's top", euler_top, 3, between(3, -2, 2), 20.0),
    "lorenz": System(
        "Lorenz",
        lattice(problem.lorenz_system),
        3,
        lambda batch: problem.starts(batch, 3, -8, 8) + np.array([0, 0, 20]),
        2.0,
    ),
    "kepler": System("Kepler, e = 0.6", kepler, 4, on_an_ellipse, 2 * np.pi),
    "fput": System(
        "FPUT of 6",
        lattice(problem.fermi_pasta_ulam_tsingou),
        12,
        between(12, -0.3, 0.3),
        20.0,
    ),
    "pendulum": System("A pendulum", pendulum, 2, between(2, -2.5, 2.5), 20.0),
    "rosenzweig": System(
        "Rosenzweig and MacArthur", rosenzweig_macarthur, 2, between(2, 0.3, 2), 50.0
    ),
    "hires": System("HIRES", hires, 8, near(np.array([1, 0, 0, 0, 0, 0, 0, 0.0057])), 321.8122),
    "robertson": System("Robertson", robertson, 3, near(np.array([1.0, 0, 0])), 4e5),
    "van-der-pol": System("Van der Pol, 1000", van_der_pol, 2, near(np.array([2.0, 0.0])), 2000.0),
}
for D in (40, 128, 512):
    SYSTEMS[f"lorenz-96-{D}"] = System(
        f"Lorenz-96 of {D}", lattice(problem.lorenz_96), D, between(D, 7, 9), 1.0
    )
STIFF = "hires", "robertson", "van-der-pol"


@functools.cache
def field_of(name):
    system = SYSTEMS[name]
    return Field(lambda x: system.f(x, np), system.D)


@functools.cache
def reference(name, batch):
    """Return states at the last time: in long doubles, of stiff systems and lattices by `flow`."""
    x = SYSTEMS[name].starts(batch)
    if name in STIFF or name.startswith("lorenz-96"):
        return by_flow(name, 1e-11 if name in STIFF else 1e-13)(x)
    return extrapolated(SYSTEMS[name], x)


def extrapolated(system, x, steps=160, columns=range(2, 22, 2)):
    """Return states at the last time by Gragg's rule, extrapolated to order 20, in long doubles.

    With 320 steps they are the same to 6e-14 of the largest component.
    """
    rates = lambda x: np.stack(np.broadcast_arrays(*system.f(x, np)))  # noqa: E731
    x, length = x.T.astype(np.longdouble), np.longdouble(system.time) / steps
    for _ in range(steps):
        row, first = [], rates(x)
        for n in columns:
            h = length / n
            before, now = x, x + h * first
            for _ in range(n - 1):
                before, now = now, before + 2 * h * rates(now)
            ends = [(before + now + h * rates(now)) / 2]
            for end, other in zip(row, columns[: len(row)][::-1], strict=True):
                ratio = np.longdouble(n) / other
                ends.append(ends[-1] + (ends[-1] - end) / (ratio * ratio - 1))
            row = ends
        x = row[-1]
    return x.T.astype(float)


def by_flow(name, tolerance):
    """Return a function of starts, which computes on one thread, as the other methods do."""
    field, time = field_of(name), SYSTEMS[name].time
    return lambda x: flow(field, x, time=time, rtol=tolerance, threads=1).states[0]


def by_steps(name, method, count):
    options = {"save_every": None, "method": method, "threads": 1}
    eps = SYSTEMS[name].time / count
    return lambda x: iterate(field_of(name), x, eps, count, **options).final


def at_equal_error(function, name, arguments, batch, below, size):
    """Return work: motions with an error below a bound, relative to the largest component.

    `function(name, *arguments)` makes a function of starts. The check compares the ratio of error
    and bound, if it exceeds 1, with 1.
    """
    call, batch = load(function)(name, *arguments), size(batch, 16)
    x = SYSTEMS[name].starts(batch)

    def check():
        wanted = reference(name, batch)
        error = abs(call(x) - wanted).max() / abs(wanted).max()
        return np.array([max(error / below, 1.0)]), np.ones(1)

    return Work(lambda: call(x), len(x), "trajectory", check)


# The largest tolerances of a search, by `main`, whose errors are below these bounds; None if errors
# of rounding are not.
BELOW = 1e-3, 1e-6, 1e-9, 1e-12
TOLERANCES = {
    ("euler", "flow"): (1e-05, 5e-08, 7.9e-11, 2e-13),
    ("euler", "dop853"): (0.00013, 1.3e-07, 2e-10, 2.5e-13),
    ("euler", "heyoka"): (0.01, 5e-06, 2e-09, 5e-12),
    ("lorenz", "flow"): (3.2e-06, 1.3e-08, 1.6e-11, None),
    ("lorenz", "dop853"): (2.5e-06, 2e-09, 2.5e-12, None),
    ("lorenz", "heyoka"): (0.00032, 1e-07, 2.5e-10, None),
    ("kepler", "flow"): (3.2e-05, 1e-07, 7.9e-10, None),
    ("kepler", "dop853"): (1.6e-05, 1e-08, 2e-11, None),
    ("kepler", "heyoka"): (0.00032, 7.9e-07, 2e-09, 6.3e-13),
    ("fput", "flow"): (0.0079, 3.2e-06, 1e-08, 1.6e-11),
    ("fput", "dop853"): (0.0004, 6.3e-07, 6.3e-10, 7.9e-13),
    ("fput", "heyoka"): (0.002, 5e-06, 1e-07, 3.2e-11),
    ("pendulum", "flow"): (0.00032, 1e-07, 4e-10, 7.9e-13),
    ("pendulum", "dop853"): (3.2e-05, 3.2e-08, 6.3e-11, None),
    ("pendulum", "heyoka"): (0.00032, 7.9e-07, 2e-09, 5e-12),
    ("rosenzweig", "flow"): (6.3e-05, 3.2e-08, 2e-11, None),
    ("rosenzweig", "dop853"): (1.6e-06, 7.9e-08, 2e-10, None),
    ("rosenzweig", "heyoka"): (0.00032, 7.9e-07, 2e-09, 6.3e-13),
}
# The same below 1e-6: stiff systems, and lattices.
STIFF_TOLERANCES = {
    ("hires", "flow"): 1.6e-5,
    ("hires", "lsoda"): 1e-7,
    ("robertson", "flow"): 7.9e-3,
    ("robertson", "lsoda"): 6.3e-5,
    ("van-der-pol", "flow"): 4e-7,
    ("van-der-pol", "lsoda"): 7.9e-8,
}
LATTICE_TOLERANCES = {
    ("lorenz-96-40", "flow"): 1.3e-7,
    ("lorenz-96-40", "dop853"): 1e-8,
    ("lorenz-96-128", "flow"): 2e-7,
    ("lorenz-96-128", "dop853"): 6.3e-9,
}
METHODS = {
    "flow": (OURS, "`flow`", by_flow),
    "dop853": (C, "C, DOP853, 8 at once", "dop853.in_lanes"),
    "heyoka": (OTHERS, "heyoka, Taylor integrator, 16 at once", "motions.by_heyoka"),
    "lsoda": (OTHERS, "SciPy, `odeint`, f by Numba", "motions.by_odeint"),
}


def add_cases(add):
    """Add motions by other methods to the orders; one orbit; other systems, and stiff ones."""
    by_heyoka, by_scipy = "motions.by_heyoka", "motions.by_scipy"
    by_runge_kutta = "motions.by_runge_kutta"
    for below, steps, tolerance in zip(
        BELOW[:3], (100, 450, 2753), (2e-3, 5.7e-6, 1.4e-8), strict=True
    ):
        for key, label, function, argument in (
            ("rk4", "Numba, order 4 of Runge and Kutta, one by one", by_runge_kutta, steps),
            ("ensemble", "heyoka, ensemble of 16 at once", "motions.by_ensemble", tolerance),
        ):
            arguments = at_equal_error, function, "henon-heiles", (argument,), 1024, below
            add("orders", key, OTHERS, label, *arguments, x=below, one_thread=True)
    for key, whose, label, function, *arguments in (
        ("order8", OURS, '`iterate(..., method="order8")`', by_steps, ("order8",), (20, 44)),
        ("flow", OURS, "`flow`", by_flow, (), (2.5e-6, 1e-8)),
        ("heyoka", OTHERS, "heyoka, integrator held", by_heyoka, (), (5.8e-6, 1.4e-8)),
        ("rk4", OTHERS, "Numba, order 4 of Runge and Kutta", by_runge_kutta, (), (449, 2478)),
        ("dop853", OTHERS, "SciPy, DOP853, compiled f", by_scipy, ("DOP853",), (3.8e-7, 6.4e-10)),
        ("lsoda", OTHERS, "SciPy, LSODA, compiled f", by_scipy, ("LSODA",), (4.1e-7, 2.5e-10)),
    ):
        given, numbers = arguments
        for below, number in zip(BELOW[1:3], numbers, strict=True):
            arguments = at_equal_error, function, "henon-heiles", (*given, number), 1, below
            add("one motion", key, whose, label, *arguments, x=below, one_thread=True)
    for (name, key), numbers in TOLERANCES.items():
        whose, label, function = METHODS[key]
        label = f"{SYSTEMS[name].title}: {label}"
        for below, number in zip(BELOW, numbers, strict=True):
            if number is None:
                continue
            arguments = at_equal_error, function, name, (number,), 1024, below
            add("more motions", f"{name}-{key}", whose, label, *arguments, x=below, one_thread=True)
    for (name, key), number in LATTICE_TOLERANCES.items():
        whose, label, function = METHODS[key]
        arguments = at_equal_error, function, name, (number,), 64, 1e-6
        label = f"{SYSTEMS[name].title}: {label}"
        add("lattices", f"{name}-{key}", whose, label, *arguments, x=1e-6, one_thread=True)
    for (name, key), number in STIFF_TOLERANCES.items():
        whose, label, function = METHODS[key]
        arguments = at_equal_error, function, name, (number,), 1024 if key == "flow" else 16, 1e-6
        label = f"{SYSTEMS[name].title}: {label}"
        add("stiff motions", f"{name}-{key}", whose, label, *arguments, x=1e-6, one_thread=True)


def search(name, key, below, batch):
    """Return the largest tolerance of a grid with an error below a bound."""
    by_method = load(METHODS[key][2])
    x, wanted = SYSTEMS[name].starts(batch), reference(name, batch)

    def error(tolerance):
        return abs(by_method(name, tolerance)(x) - wanted).max() / abs(wanted).max()

    return largest_tolerance(error, below)


def largest_tolerance(error, below, first=1e-2):
    """Return the largest tolerance of a grid from `first` to 1e-13 with a small error, or None."""
    grid = (float(f"{number:.1e}") for number in 10 ** np.arange(np.log10(first), -13.05, -0.1))
    return next((tolerance for tolerance in grid if error(tolerance) < below), None)


def main():
    """Print the tolerances of all methods at equal error."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("system", nargs="*", help=f"of {', '.join(SYSTEMS)}; by default all")
    named = parser.parse_args().system or [*SYSTEMS]
    if unknown := {*named} - {*SYSTEMS}:
        parser.error(f"no system {', '.join(sorted(unknown))}: there are {', '.join(SYSTEMS)}")
    for name in named:
        is_large = name.startswith("lorenz-96")
        bounds = (1e-6,) if is_large or name in STIFF else BELOW
        for key in ("flow", "lsoda") if name in STIFF else ("flow", "dop853", "heyoka"):
            batch = 16 if key == "lsoda" else 64 if is_large else 1024
            try:
                found = tuple(search(name, key, below, batch) for below in bounds)
            except ImportError as error:
                print(f"    # {name}, {key}: {error}")
                continue
            print(f"    {(name, key)}: {found},", flush=True)


if __name__ == "__main__":
    main()
