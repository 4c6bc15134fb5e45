"""What happens inside the steps of motions: states at many times, and crossings of a surface.

All are of 1,024 orbits of the system of Hénon and Heiles to time 20, at equal error, on one thread.
"""

import argparse
import functools

import motions
import numpy as np
from work import OTHERS, OURS, Work, load

from suslov_fast import crossings, flow

SYSTEM = "henon-heiles"
TIME = motions.SYSTEMS[SYSTEM].time
TIMES = np.linspace(0, TIME, 1001)
SURFACE = 1  # y = 0, crossed in both directions
WANTED = "1,001 times", "crossings of y = 0"


def by_trajectory(time, trajectory, batch):
    """Return times of crossings, a row for each trajectory, with zeros after the last crossing."""
    counts = np.bincount(trajectory, minlength=batch)
    rows = np.zeros((batch, counts.max(initial=0)))
    rows[np.arange(rows.shape[1]) < counts[:, np.newaxis]] = time
    return rows


def by_flow(wanted, tolerance):
    """Return a function of starts, for states (1001, batch, 4) or times of crossings (batch, k)."""
    field, options = motions.field_of(SYSTEM), {"rtol": tolerance, "threads": 1}
    if wanted == WANTED[0]:
        return lambda x: flow(field, x, time=TIMES, **options).states

    def run(x):
        found = crossings(field, x, time=TIME, surface=f"x{SURFACE + 1}", direction=0, **options)
        return by_trajectory(found.time, found.trajectory, len(x))

    return run


@functools.cache
def reference(wanted, batch):
    return by_flow(wanted, 1e-13)(motions.SYSTEMS[SYSTEM].starts(batch))


def error(wanted, call, batch):
    """Return the error relative to the largest component or time; inf if a crossing is missed."""
    found, right = call(motions.SYSTEMS[SYSTEM].starts(batch)), reference(wanted, batch)
    return abs(found - right).max() / abs(right).max() if found.shape == right.shape else np.inf


def inside(function, wanted, tolerance, batch, below, size):
    """Return work in units of orbits; its check is as that of `motions.at_equal_error`."""
    call, batch = load(function)(wanted, tolerance), size(batch, 4)
    x = motions.SYSTEMS[SYSTEM].starts(batch)
    check = lambda: (np.array([max(error(wanted, call, batch) / below, 1.0)]), np.ones(1))  # noqa: E731
    return Work(lambda: call(x), batch, "trajectory", check)


BELOW = 1e-9
METHODS = {
    "flow": (OURS, "`flow`, `crossings`", by_flow),
    "heyoka": (OTHERS, "heyoka, Taylor integrator, 16 at once", "inside.by_heyoka"),
    "scipy": (OTHERS, "SciPy, DOP853, all in one system (events: one by one)", "inside.by_scipy"),
}
# The largest tolerances of a search, by `main`, whose errors are below the bound.
TOLERANCES = {
    ("flow", "1,001 times"): 1.3e-08,
    ("flow", "crossings of y = 0"): 7.9e-08,
    ("heyoka", "1,001 times"): 1.3e-08,
    ("heyoka", "crossings of y = 0"): 1.3e-08,
    ("scipy", "1,001 times"): 1.6e-10,
    ("scipy", "crossings of y = 0"): 1e-08,
}


def batch_of(key, wanted):
    return 16 if (key, wanted) == ("scipy", WANTED[1]) else 1024


def add_cases(add):
    """Add states at many times, and crossings, by this package and by peers."""
    for (key, wanted), tolerance in TOLERANCES.items():
        whose, label, function = METHODS[key]
        arguments = inside, function, wanted, tolerance, batch_of(key, wanted), BELOW
        add("inside", key, whose, label, *arguments, x=wanted, one_thread=True)


def search(key, wanted):
    """Return the largest tolerance of a grid with an error below the bound."""
    by_method, batch = load(METHODS[key][2]), batch_of(key, wanted)
    of = lambda tolerance: error(wanted, by_method(wanted, tolerance), batch)  # noqa: E731
    return motions.largest_tolerance(of, BELOW, 1e-5)


def main():
    """Print the tolerances of all methods at equal error."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    for key in METHODS:
        for wanted in WANTED:
            try:
                print(f"    {(key, wanted)}: {search(key, wanted)},", flush=True)
            except ImportError as missing:
                print(f"    # {key}, {wanted}: {missing}")


if __name__ == "__main__":
    main()
