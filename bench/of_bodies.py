"""Bodies: runs, jumps, motions and functions of a state, with peers and limits of the machine."""

from functools import partial

import numpy as np
import work
from formulas import EPS
from limits import divisions, new_memory, stores
from problem import BODY, body_nd, starts, starts_nd
from work import MACHINE, NUMPY, OTHERS, OURS, C, Work

import suslov_fast as sf
from suslov_fast import iterate


def last(omega0, steps):
    return iterate(BODY, omega0, EPS, steps, save_every=None).final


def saved(omega0, steps, every, _):
    return iterate(BODY, omega0, EPS, steps, save_every=every).states


def at(omega0, n):
    return BODY.exact(omega0, EPS, n)


FREE, FOUR = "C, dimensionless variables", "one division per four steps"
LAST = "`iterate(..., save_every=None)`"
STORE = "streaming", 16


def with_rotor(k, size):
    """Last states of bodies with a rotor; for k = 0 its steps are those of a body without one."""
    body, omega0 = sf.Suslov3D(4, 1, -0.5, -0.3, k), starts(size(65_536, 64))
    steps = size(200, 5)
    call = partial(iterate, body, omega0, EPS, steps, save_every=None)
    return Work(call, len(omega0) * steps, "step")


def scattered(count, size):
    return np.random.default_rng(1).integers(-(10**6), 10**6, size(count, 16))


moved = lambda omega0, time: sf.flow(BODY, omega0, time=time).states[0]  # noqa: E731


def last_nd(body, omega0, eps, steps, method="auto"):
    return iterate(body, omega0, eps, steps, save_every=None, method=method).final


gauss = partial(last_nd, method="gauss")


def orientations(what, n, size):
    """A function of a run of 4096 bodies in n dimensions, 100 steps, and of its states."""
    batch, steps = size(4096, 16), size(100, 5)
    body, omega0 = (BODY, starts(batch)) if n == 3 else (body_nd(n - 1), starts_nd(batch, n - 1))
    run = body, omega0, EPS, steps
    return Work(partial(what, *run, states=iterate(*run).states), batch * steps, "step")


def add_cases(add):
    """Add runs in three and more dimensions, and what the machine can do."""
    # Slow peers do a part of the work; the last number is that of divisions per step.
    for key, whose, label, function, part, quotients in (
        ("exact", OURS, "`exact`, an evaluation counted as 1000 steps", at, 1, None),
        ("iterate", OURS, LAST, last, 1, 1),
        ("c-projective", C, f"{FREE}, {FOUR}", "c.projective", 1, 0.25),
        ("c-free", C, FREE, "c.parameter_free", 1, 1),
        ("c-printed", C, "C, formula (5) of the paper", "c.as_printed", 1, 2),
        ("numba-blocks", OTHERS, "Numba, dimensionless, in blocks", "numba_loops.in_blocks", 1, 1),
        ("numba", OTHERS, "Numba, `prange` over trajectories", "numba_loops.final", 16, None),
        ("numpy", NUMPY, "NumPy, over the batch", "numpy_batch.final", 64, None),
    ):
        more = {"limit": quotients and ("divisions", quotients), "one_thread": part >= 64}
        arguments = work.last_states, function, 65_536 // part, 1000
        add("last states", key, whose, label, *arguments, **more)
    for key, whose, label, function, batch in (
        ("new", OURS, "`iterate(...)`, new memory", saved, 65_536),
        ("c-streaming", C, f"{FREE}, streaming stores", "c.stored_streaming", 65_536),
        ("c-plain", C, f"{FREE}, plain stores", "c.stored", 65_536),
    ):
        arguments = work.saved_states, function, batch, 257, 1, key  # the key says which memory
        add("saved states", key, whose, label, *arguments, limit=STORE)
    for batch in (1, 2, 5, 9, 100, 1001, 10_007):
        arguments = work.saved_states, saved, batch, 1_000_000 // batch, 1, "aligned"
        add("few orbits", "iterate", OURS, "`iterate`", *arguments, x=batch)
        function, label = "numba_loops.one_by_one", "Numba, dimensionless variables, one by one"
        arguments = work.saved_states, function, *arguments[2:]
        add("few orbits", "numba", OTHERS, label, *arguments, x=batch, one_thread=True)
    for every in (1, 10, 100, 1000):
        arguments = work.saved_states, saved, 4096, 50, every, "aligned"
        add("save_every", "iterate", OURS, "`iterate`", *arguments, x=every)
        numbers = partial(lambda every, size: every * np.arange(size(50, 3)), every)
        add("save_every", "exact", OURS, "`exact`", work.jumps, at, 4096, numbers, x=every)
    for batch in (10**k for k in range(7)):
        add("batch", "iterate", OURS, "`iterate`", work.last_states, last, batch, 50, x=batch)
    for k in (0, 0.7):
        add("rotors", "iterate", OURS, "`iterate`", with_rotor, k, x=k)
    for key, label, batch, numbers in (
        ("far", "`exact`", 65_536, lambda size: 10**6),
        ("rows", "`exact`, 256 n in a row", 16_384, lambda size: np.arange(size(256, 16))),
        ("scattered-4096", "`exact`, 244 scattered n", 4096, partial(scattered, 244)),
        ("scattered-1", "`exact`, 1,000,000 scattered n", 1, partial(scattered, 1_000_000)),
    ):
        add("jumps", key, OURS, label, work.jumps, at, batch, numbers)
    for key, whose, label, function, part in (
        ("flow", OURS, "`flow`, the closed form", moved, 1),
        ("numpy", NUMPY, "NumPy, Suslov's solution by `tanh` and `cosh`", "numpy_batch.flow", 1),
        ("heyoka", OTHERS, "heyoka, Taylor integrator, 16 at once", "integrators.by_heyoka", 16),
        ("scipy", OTHERS, "SciPy, DOP853, all in one system", "integrators.by_scipy", 16),
    ):
        arguments = work.motions, function, 65_536 // part
        add("motion", key, whose, label, *arguments, one_thread=whose != OURS)
    # Numbers of components, and the part of the work that methods of the order of n**3 do.
    for n, cubic in {2: 1, 4: 1, 8: 2, 16: 4, 32: 8, 64: 16, 128: 16}.items():
        for key, whose, label, function, part in (
            ("iterate", OURS, "`iterate`", last_nd, 1),
            ("gauss", OURS, '`iterate(..., method="gauss")`', gauss, cubic),
            ("c-rank2", C, "C, rank two, 32 trajectories at once", "c.rank2", 1),
            ("c-lanes", C, "C, elimination, 32 systems at once", "c.eliminate_lanes", cubic),
            ("c-elimination", C, "C, elimination, one system at a time", "c.eliminate", cubic),
            ("numpy", NUMPY, "NumPy, `linalg.solve`", "numpy_batch.solve", 4 * cubic),
        ):
            arguments = work.dimensions, function, n, part
            add("n dimensions", key, whose, label, *arguments, x=n, one_thread=True)
    for key, label, what in (
        ("all", "`iterate(..., attitude=True)`", lambda *run, states: iterate(*run, attitude=True)),
        ("exponents", "`lyapunov_exponents`", lambda *run, states: sf.lyapunov_exponents(*run)),
    ):
        for n in (3, 4):
            add("space", key, OURS, label, orientations, what, n, x=n)
    for table, key, label, limit, alone, *kind in (
        ("last states", "divisions", "one division per step", ("divisions", 1), False, divisions),
        ("saved states", "streaming", "streaming stores", STORE, False, stores, "streaming"),
        ("saved states", "plain", "plain stores", STORE, False, stores, "plain"),
        ("saved states", "ones", "`numpy.ones`, new memory", None, True, new_memory),
    ):
        add(table, key, MACHINE, f"*limit: {label}*", *kind, limit=limit, one_thread=alone)
