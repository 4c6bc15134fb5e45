"""Other ways to do the same work, one module for each library; who lacks one skips it.

Those that iterate the map are compared with its orbit; those that integrate the motion (s1) to the
same time, with the motion.
"""

import importlib
import warnings

import numpy as np
from cases import QUANTITIES, Case, Work, random_states
from formulas import EPS, Formulas
from problem import (
    CHECKED,
    CHECKED_ND,
    STEPS,
    STEPS_ND,
    aligned,
    motion,
    orbit,
    orbit_nd,
    problem_nd,
    relative_error,
    starts,
)

CASES = []


def load(module, function):
    """A function of a module here; ImportError without its library."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of libraries being imported
        return getattr(importlib.import_module(f"peers.{module}"), function)


def whose(module):
    return {"c": "C", "numpy_batch": "NumPy"}.get(module, "others")


def last_states(module, function, batch, steps):
    def make(size, threads):
        peer, omega0, n = load(module, function), starts(size(batch, 64)), size(steps, 20)
        checked = size(STEPS, 20)

        def error():
            computed = peer(starts(CHECKED), checked, threads)
            return relative_error(computed, orbit(CHECKED, checked)[-1])

        return Work(lambda: peer(omega0, n, threads), len(omega0) * n, error)

    return make


def saved_states(module, function, batch, steps):
    def make(size, threads):
        peer, omega0, n = load(module, function), starts(size(batch, 64)), size(steps, 20)
        out, few = (aligned((n + 1, count, 2)) for count in (len(omega0), CHECKED))

        def error():
            computed = peer(starts(CHECKED), n, threads, few)
            # Those that leave out state 0 begin with state 1.
            return relative_error(computed, orbit(CHECKED, n)[-len(computed) :])

        return Work(lambda: peer(omega0, n, threads, out), (n + 1) * len(omega0), error)

    return make


def motions(module, function, batch):
    def make(size, threads):
        peer, omega0, time = load(module, function), starts(size(batch, 2)), EPS * size(STEPS, 20)
        few = min(CHECKED, len(omega0))

        def error():
            return relative_error(peer(starts(few), time, threads), motion(few, time))

        return Work(lambda: peer(omega0, time, threads), len(omega0), error)

    return make


def jump(size, threads):
    peer, omega0 = load("numpy_batch", "jump"), starts(size(65_536, 64))

    def error():
        return relative_error(peer(starts(CHECKED), STEPS), orbit(CHECKED, STEPS)[-1])

    return Work(lambda: peer(omega0, 10**6), len(omega0), error)


def dimensions(module, function, components):
    cubic = function in ("eliminate", "solve")

    def make(size, threads):
        peer = load(module, function)
        body, omega0 = problem_nd(components, size(512, 16))
        steps = size(max(3, 4000 // components ** (2 if cubic else 1)), 3)
        if module == "numpy_batch":  # too slow for all of it
            steps = min(steps, max(1, 64 // components))
            omega0 = omega0[: 4096 // components] if cubic else omega0

        def error():
            computed = peer(body, problem_nd(components, CHECKED_ND)[1], EPS / 2, STEPS_ND)
            return relative_error(computed, orbit_nd(components))

        return Work(lambda: peer(body, omega0, EPS / 2, steps), len(omega0) * steps, error)

    return make


def quantity(name):
    def make(size, threads):
        states = random_states(size(10_000_000, 1000))
        function = getattr(Formulas(), name)

        def call():
            found = function(*states.T)
            return np.stack(found, axis=-1) if isinstance(found, tuple) else found

        return Work(call, len(states))

    return make


PRINTED, FREE, PRANGE = "(ds2) as printed", "parameter-free", "Numba, `prange` over trajectories, "
QUARTER = f"C, {FREE}, one division per four steps"
for key, label, module, function, batch, steps, divisions, threads in (
    ("c-projective", QUARTER, "c", "projective", 65_536, 1000, 0.25, "all"),
    ("c-free", f"C, {FREE}", "c", "parameter_free", 65_536, 1000, 1, "all"),
    ("c-printed", f"C, {PRINTED}", "c", "as_printed", 65_536, 1000, 2, "all"),
    ("heyoka", f"heyoka, compiled function, {FREE}", "heyoka_", "final", 65_536, 100, None, "all"),
    ("jax", f"JAX, `fori_loop`, {FREE}", "jax_", "final", 65_536, 200, None, "all"),
    ("numba", PRANGE + "(ds2)", "naive_numba", "final", 16_384, 250, None, "all"),
    ("pynamicalsys", "pynamicalsys, (ds2)", "pynamicalsys_", "final", 2048, 250, None, "all"),
    ("numpy", "NumPy, over the batch, (ds2)", "numpy_batch", "final", 4096, 250, None, "one"),
    ("python", "Python, (ds2)", "numpy_batch", "final_python", 64, 1000, None, "one"),
):
    limit = divisions and ("divisions", divisions)
    more = {"whose": whose(module) if key != "python" else "others", "threads": threads}
    make = last_states(module, function, batch, steps)
    CASES.append(Case("last states", key, label, "steps", make, limit=limit, **more))

for key, label, module, function, batch, steps, threads in (
    ("c-streaming", f"C, {FREE}, streaming stores", "c", "stored_streaming", 65_536, 256, "all"),
    ("c-plain", f"C, {FREE}, plain stores", "c", "stored", 65_536, 256, "all"),
    ("numba", PRANGE + "(ds2)", "naive_numba", "stored", 16_384, 256, "all"),
    ("jax", f"JAX, `scan` over the batch, {FREE}", "jax_", "stored", 16_384, 256, "all"),
    ("pynamicalsys", "pynamicalsys, (ds2)", "pynamicalsys_", "stored", 2048, 256, "all"),
    ("numpy", "NumPy, over the batch, (ds2)", "numpy_batch", "stored", 16_384, 64, "one"),
):
    more = {"limit": ("streaming", 16), "whose": whose(module), "threads": threads}
    make = saved_states(module, function, batch, steps)
    CASES.append(Case("saved states", key, label, "states", make, x=1, **more))

for key, label, module, function, batch, threads in (
    ("heyoka", "heyoka, Taylor integrator, 16 at once", "heyoka_", "motion", 4096, "all"),
    ("numbalsoda", "numbalsoda, LSODA, `prange`", "numbalsoda_", "motion", 1024, "all"),
    ("scipy-stacked", "SciPy, DOP853, all in one system", "scipy_ivp", "stacked", 4096, "one"),
    ("scipy", "SciPy, DOP853, one by one", "scipy_ivp", "one_by_one", 8, "one"),
):
    make = motions(module, function, batch)
    more = {"whose": "others", "threads": threads}
    CASES.append(Case("motion", key, label, "trajectories", make, **more))

label = "NumPy, over the batch"
CASES.append(Case("jumps", "numpy", label, "states", jump, whose="NumPy", threads="one"))

for key, label, module, function in (
    ("c-rank2", "C, rank two, 32 trajectories at once", "c", "rank2"),
    ("numpy-rank2", "NumPy, rank two", "numpy_batch", "rank2"),
    ("c-elimination", "C, elimination", "c", "eliminate"),
    ("numpy-solve", "NumPy, `linalg.solve`", "numpy_batch", "solve"),
):
    for components in (2, 4, 8, 16, 32, 64, 128):
        make = dimensions(module, function, components)
        more = {"x": components, "whose": whose(module), "threads": "one"}
        CASES.append(Case("n dimensions", key, label, "steps", make, **more))

for name in QUANTITIES:
    if hasattr(Formulas, name):
        more = {"whose": "NumPy", "threads": "one"}
        make = quantity(name)
        CASES.append(Case("quantities", f"{name}", f"`{name}` in NumPy", "states", make, **more))
