"""Quantities of ten million states, beside NumPy's formula and the copy of as many bytes."""

import functools

import numpy as np
import pytest
import revision
from peers import formulas
from problem import BODY, CHECKED, EPS
from results import Limit, Table, Whose

import suslov_fast

STATES = 10_000_000
WITH_EPS = (
    "first_integral",
    "modified_energy",
    "criticality",
    "invariant_density",
    "step",
    "jacobian",
)
WITHOUT = ("energy", "to_xy", "from_xy", "vector_field", "reaction")
NAMES = (*WITH_EPS, *WITHOUT, "discrete_reaction")
CONSTANTS = formulas.Constants(*map(float, BODY.parameters), EPS)
PRECISE = formulas.Constants(*map(np.longdouble, CONSTANTS))


@functools.cache
def states(size):
    """Random states, away from where a quantity is infinite."""
    found = np.random.default_rng(2).uniform(0.5, 2, (size, 2))
    found.flags.writeable = False
    return found


def ours(name):
    """The function of this package, of states alone."""
    public = "reaction" if name == "discrete_reaction" else name
    if not revision.supports(public):
        pytest.skip(f"this version has no {public}")
    function = getattr(suslov_fast, public)
    if name in WITHOUT:
        return lambda omega: function(BODY, omega)
    return lambda omega: function(BODY, omega, EPS)


def numpys(name, constants=CONSTANTS):
    """NumPy's formula, of states alone."""
    return lambda omega: getattr(formulas, name)(constants, *omega.T)


def row(name, function, size):
    """What the rows of one quantity have in common."""
    few = states(CHECKED)
    computed, expected = function(few), numpys(name, PRECISE)(few.astype(np.longdouble))
    shape = (CHECKED, -1)
    size_of = np.abs(expected).reshape(shape).max(axis=1)
    error = (np.abs(computed - expected).reshape(shape).max(axis=1) / size_of).max()
    moved = 16 + 8 * computed.size // CHECKED
    return {
        "table": Table.OBSERVABLES,
        "key": name,
        "label": "`reaction` with `eps`" if name == "discrete_reaction" else f"`{name}`",
        "unit": "states",
        "work": size,
        "error": float(error),
        "limit": (Limit.COPY, moved),
    }


@pytest.mark.parametrize("name", NAMES)
def bench_observable(measure, name, threads, set_threads):
    set_threads(threads)
    function, omega = ours(name), states(measure.size(STATES, 1000))
    measure(lambda: function(omega), rounds=1, threads=threads, **row(name, function, len(omega)))


@pytest.mark.other
@pytest.mark.parametrize("name", NAMES)
def bench_numpy(measure, name):
    function, omega = numpys(name), states(measure.size(STATES, 1000))
    whose = {"whose": Whose.NUMPY}
    measure(lambda: function(omega), rounds=1, **row(name, function, len(omega)) | whose)


def bench_a_body_for_each_orbit(measure, all_threads, set_threads):
    """A whole run of many bodies, time first."""
    if not revision.TIME_FIRST:
        pytest.skip("this version has another order of axes")
    set_threads(all_threads)
    batch = measure.size(10_000, 10)
    bodies = suslov_fast.Suslov3D(np.linspace(3, 5, batch), 1, -0.5, -0.3)
    run = states(measure.size(STATES, 1000)).reshape(-1, batch, 2)
    measure(
        lambda: suslov_fast.first_integral(bodies, run, EPS),
        rounds=2,
        table=Table.OBSERVABLES,
        key="first_integral-bodies",
        label="`first_integral` of a run, 10,000 bodies",
        unit="states",
        work=run.size // 2,
        threads=all_threads,
        limit=(Limit.COPY, 24),
    )
