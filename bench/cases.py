"""All benchmarks, by table: calls of the public API, peers, and limits of the machine.

Peers are named "module.function" of the folder `peers`, and imported when they run; without their
library they are skipped. Errors of peers that iterate the map are relative to its orbit, those of
integrators relative to the continuous motion at the same time.
"""

import re
from functools import partial
from pathlib import Path

import events
import inside
import motions
import numpy as np
import problem
import work
from formulas import EPS, Formulas
from limits import copy, divisions, new_memory, stores
from problem import BODY, EPS_FIELD, body_nd, dense_field, sparse_field, starts, starts_nd
from work import MACHINE, NUMPY, OTHERS, OURS, C, Work

import suslov_fast as sf
from suslov_fast import iterate

CASES: list[work.Case] = []


def add(table, key, whose, label, kind, *arguments, **more):
    """Add a case of a kind of work; the kinds and their arguments are those of `work`."""
    CASES.append(work.Case(table, key, whose, label, partial(kind, *arguments), **more))


# ------------------------------------------------------------------ three dimensions


def last(omega0, steps):
    return iterate(BODY, omega0, EPS, steps, save_every=None).final


def saved(omega0, steps, every, _):
    return iterate(BODY, omega0, EPS, steps, save_every=every).states


def at(omega0, n):
    return BODY.exact(omega0, EPS, n)


FREE, FOUR = "C, dimensionless variables", "one division per four steps"
OWN = "your own `prange` loop over `compiled."
LAST = "`iterate(..., save_every=None)`"
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
    add("last states", key, whose, label, work.last_states, function, 65_536 // part, 1000, **more)

STORE = "streaming", 16
for key, whose, label, function, batch in (
    ("new", OURS, "`iterate(...)`, new memory", saved, 65_536),
    ("c-streaming", C, f"{FREE}, streaming stores", "c.stored_streaming", 65_536),
    ("c-plain", C, f"{FREE}, plain stores", "c.stored", 65_536),
):
    arguments = work.saved_states, function, batch, 257, 1, key  # the key says which memory
    add("saved states", key, whose, label, *arguments, limit=STORE)
for batch in (1, 2, 5, 9, 100, 1001, 10_007):
    arguments = batch, 1_000_000 // batch, 1, "aligned"
    add("few orbits", "iterate", OURS, "`iterate`", work.saved_states, saved, *arguments, x=batch)
    function, label = "numba_loops.one_by_one", "Numba, dimensionless variables, one by one"
    more = {"x": batch, "one_thread": True}
    add("few orbits", "numba", OTHERS, label, work.saved_states, function, *arguments, **more)
for every in (1, 10, 100, 1000):
    arguments = work.saved_states, saved, 4096, 50, every, "aligned"
    add("save_every", "iterate", OURS, "`iterate`", *arguments, x=every)
    numbers = partial(lambda every, size: every * np.arange(size(50, 3)), every)
    add("save_every", "exact", OURS, "`exact`", work.jumps, at, 4096, numbers, x=every)
for batch in (10**k for k in range(7)):
    add("batch", "iterate", OURS, "`iterate`", work.last_states, last, batch, 50, x=batch)


def with_rotor(k, size):
    """Last states of bodies with a rotor; for k = 0 its steps are those of a body without one."""
    body, omega0 = sf.Suslov3D(4, 1, -0.5, -0.3, k), starts(size(65_536, 64))
    steps = size(200, 5)
    call = partial(iterate, body, omega0, EPS, steps, save_every=None)
    return Work(call, len(omega0) * steps, "step")


for k in (0, 0.7):
    add("rotors", "iterate", OURS, "`iterate`", with_rotor, k, x=k)


def scattered(count, size):
    return np.random.default_rng(1).integers(-(10**6), 10**6, size(count, 16))


for key, label, batch, numbers in (
    ("far", "`exact`", 65_536, lambda size: 10**6),
    ("rows", "`exact`, 256 n in a row", 16_384, lambda size: np.arange(size(256, 16))),
    ("scattered-4096", "`exact`, 244 scattered n", 4096, partial(scattered, 244)),
    ("scattered-1", "`exact`, 1,000,000 scattered n", 1, partial(scattered, 1_000_000)),
):
    add("jumps", key, OURS, label, work.jumps, at, batch, numbers)
moved = lambda omega0, time: sf.flow(BODY, omega0, time=time).states[0]  # noqa: E731
for key, whose, label, function, part in (
    ("flow", OURS, "`flow`, the closed form", moved, 1),
    ("numpy", NUMPY, "NumPy, Suslov's solution by `tanh` and `cosh`", "numpy_batch.flow", 1),
    ("heyoka", OTHERS, "heyoka, Taylor integrator, 16 at once", "integrators.by_heyoka", 16),
    ("scipy", OTHERS, "SciPy, DOP853, all in one system", "integrators.by_scipy", 16),
):
    arguments = work.motions, function, 65_536 // part
    add("motion", key, whose, label, *arguments, one_thread=whose != OURS)

# Functions of a state: the number of values per state; those in WITHOUT_EPS have no argument eps.
WITHOUT_EPS = {"energy": 1, "to_xy": 2, "vector_field": 2, "reaction": 1}
WITH_EPS = {"first_integral": 1, "modified_energy": 1, "criticality": 1, "invariant_density": 1}
QUANTITIES = WITHOUT_EPS | WITH_EPS | {"step": 2, "jacobian": 4}


def in_numpy(name, states):
    found = getattr(Formulas(), name)(*states.T)
    return np.stack(found, axis=-1) if isinstance(found, tuple) else found


for name, values in QUANTITIES.items():
    eps, more = {} if name in WITHOUT_EPS else {"eps": EPS}, {"one_thread": True}
    own = {"step": partial(sf.step, BODY), "vector_field": BODY}
    of_map = partial(getattr(sf.kahan, name), BODY) if name in sf.kahan.__all__ else None
    function = own.get(name) or of_map or getattr(BODY, name)
    call, limit = partial(function, **eps), ("copy", 16 + 8 * values)
    add("quantities", name, OURS, f"`{name}`", work.quantities, call, name, limit=limit, **more)
    if hasattr(Formulas, name):
        key, label, call = f"{name}-numpy", f"`{name}` in NumPy", partial(in_numpy, name)
        add("quantities", key, NUMPY, label, work.quantities, call, name, **more)

# ------------------------------------------------------------------ n dimensions, fields, space


def last_nd(body, omega0, eps, steps, method="auto"):
    return iterate(body, omega0, eps, steps, save_every=None, method=method).final


gauss = partial(last_nd, method="gauss")
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

exponents = lambda field, x, steps: sf.lyapunov_exponents(field, x, EPS_FIELD, steps)  # noqa: E731
last_field = lambda field, x, steps: last_nd(field, x, EPS_FIELD, steps)  # noqa: E731
BY_NUMPY, TAYLOR = "fields.in_numpy", "integrators.lorenz"
WRITTEN = "C: explicit formulas for D = 3 and 4, dense elimination otherwise"
ALL = 3, 4, 12, 32
for key, whose, label, function, part, reference, dimensions in (
    ("iterate", OURS, "`iterate`", last_field, 1, BY_NUMPY, ALL),
    ("exponents", OURS, "`lyapunov_exponents`", exponents, 1, None, ALL),
    ("own-system", OURS, f"{OWN}step_system`", "own_loops.of_field", 1, BY_NUMPY, ALL),
    ("c", C, WRITTEN, "fields.in_c", 1, BY_NUMPY, ALL),
    ("c-exact", C, f"{WRITTEN}, without FMA", "fields.in_c_without_fma", 1, BY_NUMPY, ALL),
    ("heyoka", OTHERS, "heyoka, compiled function", "fields.in_heyoka", 1, BY_NUMPY, (3,)),
    ("jax", OTHERS, "JAX, compiled loop", "fields.in_jax", 1, BY_NUMPY, (3,)),
    # The motion over the same time: what else one would use.
    ("taylor", OTHERS, "heyoka, Taylor integrator", TAYLOR, 16, f"{TAYLOR}_by_scipy", (3,)),
    ("numpy", NUMPY, "NumPy, `linalg.solve`", BY_NUMPY, 16, BY_NUMPY, ALL),
):
    more = {"one_thread": whose in (NUMPY, OTHERS)}
    for n in dimensions:
        steps = max(2304 // n // part, 1)
        arguments = work.fields, function, partial(sparse_field, n), 49_152 // n, steps, reference
        add("fields", key, whose, label, *arguments, x=n, **more)
    for n in (6, 12) if reference == BY_NUMPY and len(dimensions) > 1 else ():
        steps = max(576 // n // part, 1)
        arguments = work.fields, function, partial(dense_field, n), 49_152 // n, steps, reference
        add("dense fields", key, whose, label, *arguments, x=n, **more)
for table, batch in (("one orbit of a field", 1), ("eight orbits of a field", 8)):
    for key, label, function in (
        ("iterate", "`iterate`", last_field),
        ("own-system", "your own loop over `compiled.step_system`", "own_loops.of_one"),
        ("exponents", "`lyapunov_exponents`", exponents),
    ):
        for n in (3, 4, 12):
            reference = None if function is exponents else BY_NUMPY
            steps = 600_000 // n // batch
            arguments = work.fields, function, partial(sparse_field, n), batch, steps, reference
            add(table, key, OURS, label, *arguments, x=n, one_thread=True)


def many_variables(function, f, D, batch, steps, reference, size):
    """Steps of a lattice, or of a dense field if f is None."""
    D = size(D, 16)
    field = partial(dense_field, D) if f is None else partial(problem.lattice, f, D)
    return work.fields(function, field, batch, steps, reference, size)


SPSOLVE, RUNGE_KUTTA = "many.by_sparse", "many.by_runge_kutta"
for table, batch in (("many variables", 64), ("one orbit of many variables", 1)):
    for key, f, dimensions in (
        ("lorenz-96", problem.lorenz_96, (16, 64, 128, 512, 1024, 2048)),
        ("korteweg-de-vries", problem.korteweg_de_vries, (64, 256, 1024)),
        ("fput", problem.fermi_pasta_ulam_tsingou, (64, 256, 1024)),
        ("volterra", problem.volterra_chain, (64, 256, 1024)),
        ("grid", problem.fisher_on_a_grid, (64, 256)),
        ("dense", None, (48, 64)),
    ):
        for n in dimensions:
            # A call costs as much as some steps: with 3 in place of 24, D = 1024 takes 1.5 times as
            # long a step.
            steps = max(200_000 // n // batch, 24)
            reference = SPSOLVE if n <= 256 else None
            arguments, more = (f, n, batch, steps), {"x": n, "one_thread": True}
            add(table, key, OURS, f"`iterate`, {key}", many_variables, last_field, *arguments,
                reference, **more)  # fmt: skip
            for name, label, function in (
                ("spsolve", "SciPy, `sparse.linalg.spsolve`", SPSOLVE),
                ("rk4", "Numba, order 4 of Runge and Kutta", RUNGE_KUTTA),
            ):
                if key == "lorenz-96" and batch == 1:
                    peer = many_variables, function, f, n, 1, 2, None
                    add(table, name, OTHERS, f"{label}, {key}", *peer, **more)
for n, batch in ((3, 16_384), (4, 16_384), (12, 4096)):
    arguments = work.saved_states_of_field, n, batch, 101
    add("saved states of fields", "iterate", OURS, "`iterate`", *arguments, x=n)

# At the largest error of the table: steps of each order, tolerances of integrators. They are the
# least, and largest, with which the error is below it.
AT_ERRORS = {
    "order2": (OURS, "`iterate`", work.by_order, "auto", {1e-3: 450, 1e-6: 14_200}),
    "order4": (OURS, "", work.by_order, "order4", {1e-3: 22, 1e-6: 123, 1e-9: 687}),
    "order6": (OURS, "", work.by_order, "order6", {1e-3: 13, 1e-6: 34, 1e-9: 104}),
    "order8": (OURS, "", work.by_order, "order8", {1e-3: 10, 1e-6: 20, 1e-9: 44}),
    "flow": (OURS, "`flow`", work.by_flow, None, {1e-3: 3.2e-3, 1e-6: 1e-5, 1e-9: 3.2e-8}),
    "dop853": (
        C,
        "C, DOP853, 8 lanes",
        "dop853.in_lanes",
        "henon-heiles",
        {1e-3: 1.3e-3, 1e-6: 1e-6, 1e-9: 2e-9},
    ),
    "heyoka": (
        OTHERS,
        "heyoka, Taylor integrator, 16 at once",
        "integrators.henon_heiles",
        None,
        {1e-3: 1.6e-2, 1e-6: 4.2e-5, 1e-9: 1e-7},
    ),
    "scipy": (
        OTHERS,
        "SciPy, DOP853, all in one system",
        "integrators.henon_heiles_by_scipy",
        None,
        {1e-3: 5e-4, 1e-6: 3.9e-7, 1e-9: 5.2e-10},
    ),
}
for key, (whose, label, function, method, needed) in AT_ERRORS.items():
    for below, number in needed.items():
        argument = (number,) if method is None else (method, number)
        label = label or f'`iterate(..., method="{key}")`'
        arguments = work.at_equal_error, function, argument, below
        add("orders", key, whose, label, *arguments, x=below, one_thread=True)

motions.add_cases(add)
events.add_cases(add)
inside.add_cases(add)


def orientations(what, n, size):
    """A function of a run of 4096 bodies in n dimensions, 100 steps, and of its states."""
    batch, steps = size(4096, 16), size(100, 5)
    body, omega0 = (BODY, starts(batch)) if n == 3 else (body_nd(n - 1), starts_nd(batch, n - 1))
    run = body, omega0, EPS, steps
    return Work(partial(what, *run, states=iterate(*run).states), batch * steps, "step")


for key, label, what in (
    ("all", "`iterate(..., attitude=True)`", lambda *run, states: iterate(*run, attitude=True)),
    ("exponents", "`lyapunov_exponents`", lambda *run, states: sf.lyapunov_exponents(*run)),
):
    for n in (3, 4):
        add("space", key, OURS, label, orientations, what, n, x=n)

# ------------------------------------------------------------------ small calls, disks, processes

BODY_ND, STATE_ND = sf.SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5]), [1.0, 0.5, 0.2]
LORENZ, POINT = problem.sparse_field(3), [-8.0, 8.0, 27.0]
STATE, SYSTEM = [1.0, 0.5], np.random.default_rng(4).normal(size=(4, 4))
for key, whose, label, call in (
    ("iterate", OURS, "`iterate`, one orbit, 10 steps", lambda: iterate(BODY, STATE, EPS, 10)),
    ("iterate-nd", OURS, "`iterate`, n = 4", lambda: iterate(BODY_ND, STATE_ND, EPS, 10)),
    ("step", OURS, "`step`, one state", lambda: sf.step(BODY, STATE, EPS)),
    ("step-nd", OURS, "`step`, n = 4", lambda: sf.step(BODY_ND, STATE_ND, EPS)),
    ("exact", OURS, "`exact`, one state", lambda: BODY.exact(STATE, EPS, 10)),
    ("first_integral", OURS, "`first_integral`", lambda: BODY.first_integral(STATE, EPS)),
    ("step-field", OURS, "`step`, Lorenz", lambda: sf.step(LORENZ, POINT, EPS)),
    ("flow", OURS, "`flow`, Lorenz, to time 1", lambda: sf.flow(LORENZ, POINT, time=1.0)),
    ("solve", NUMPY, "`numpy.linalg.solve`, 4 x 4", lambda: np.linalg.solve(SYSTEM, SYSTEM[0])),
):
    add("calls", key, whose, label, lambda call, size: Work(call), call, one_thread=True)
BODY_3D, FIELD = "s.Suslov3D(4, 1, -.5, -.3)", "s.Field.from_terms(np.ones((2, 2, 2)))"
for key, label, code in (
    ("exact", "`exact`", f"{BODY_3D}.exact([1, 0.5], 0.2, 25)"),
    ("iterate", "`iterate`", f"s.iterate({BODY_3D}, np.ones((10_000, 2)), 0.2, 20)"),
    ("gyrostat", "gyrostat", "s.iterate(s.Suslov3D(4, 1, -.5, -.3, .7), [1, 0.5], 0.2, 20)"),
    ("nd", "n = 4", "s.iterate(s.SuslovND(J=[1.3, 2, 3], I=[.4, -.7, .5]), [1, .5, .2], 0.1, 20)"),
    ("field", "a field", f"s.iterate({FIELD}, [0.1, 0.1], 0.1, 20)"),
):
    for when, said in (("again", "compiled before"), ("first", "nothing compiled")):
        codes = [f"import numpy as np, suslov_fast as s; {code}"]
        arguments = work.processes, codes, when == "first"
        add("processes", f"{key}-{when}", OURS, f"{label}, {said}", *arguments, one_thread=True)
README = Path(__file__).parents[1] / "README.md"
codes = re.findall(r"^```python\n(.*?)^```", README.read_text(encoding="utf-8"), re.M | re.S)
label = f"the {len(codes)} Python blocks of README, nothing compiled"
add("processes", "readme-first", OURS, label, work.processes, codes, True, one_thread=True)
for name, whose in (("suslov_fast", OURS), ("numba", OTHERS)):
    arguments = work.processes, [f"import {name}"], False
    add("processes", f"import-{name}", whose, f"`import {name}`", *arguments, one_thread=True)

for table, key, label, limit, alone, *kind in (
    ("last states", "divisions", "one division per step", ("divisions", 1), False, divisions),
    ("saved states", "streaming", "streaming stores", STORE, False, stores, "streaming"),
    ("saved states", "plain", "plain stores", STORE, False, stores, "plain"),
    ("saved states", "ones", "`numpy.ones`, new memory", None, True, new_memory),
    ("quantities", "copy", "a copy of 24 bytes in C", ("copy", 24), True, copy),
):
    add(table, key, MACHINE, f"*limit: {label}*", *kind, limit=limit, one_thread=alone)
