"""Other implementations, one module per library; those without their library are skipped.

Errors of peers that iterate the map are relative to its orbit, those of integrators relative to
the continuous motion at the same time.
"""

import numpy as np
from cases import DIMENSIONS, QUANTITIES
from formulas import Formulas
from problem import FIELDS
from work import Case, dimensions, fields, jumps, last_states, motions, quantities, saved_states

FREE, PRANGE = "C, parameter-free", "Numba, naive: `prange` over trajectories"
BATCH, FOUR = "NumPy, over the batch", "one division per four steps"
CASES = []


def add(table, function, key, label, make, on_one_thread=False, **more):
    """Add a case to the list."""
    library = function.removeprefix("fields.in_")
    of_numpy = library.startswith("numpy") and "python" not in function
    whose = "C" if library.partition(".")[0] == "c" else "NumPy" if of_numpy else "others"
    threads = "one" if on_one_thread or library.startswith(("numpy", "scipy")) else "all"
    CASES.append(Case(table, key, label, make, whose=whose, threads=threads, **more))


# Trajectories, steps, divisions per step: slow peers do a part of the work.
for function, key, label, batch, steps, divisions in (
    ("c.projective", "c-projective", f"{FREE}, {FOUR}", 65_536, 1000, 0.25),
    ("c.parameter_free", "c-free", FREE, 65_536, 1000, 1),
    ("c.as_printed", "c-printed", "C, as printed", 65_536, 1000, 2),
    ("blocked_numba.final", "numba-blocks", "Numba, parameter-free, in blocks", 65_536, 1000, 1),
    ("naive_numba.final", "numba", PRANGE, 16_384, 250, None),
    ("numpy_batch.final", "numpy", BATCH, 4096, 250, None),
    ("numpy_batch.final_python", "python", "Python", 64, 1000, None),
):
    limit = divisions and ("divisions", divisions)
    add("last states", function, key, label, last_states(function, batch, steps), limit=limit)
for function, key, label, batch, saved in (
    ("c.stored_streaming", "c-streaming", f"{FREE}, streaming stores", 65_536, 257),
    ("c.stored", "c-plain", f"{FREE}, plain stores", 65_536, 257),
    ("naive_numba.stored", "numba", PRANGE, 16_384, 257),
    ("numpy_batch.stored", "numpy", BATCH, 16_384, 65),
):
    make = saved_states(function, batch, saved)
    add("saved states", function, key, label, make, limit=("streaming", 16))
for function, key, label in (
    ("heyoka_.motion", "heyoka", "heyoka, Taylor integrator, 16 at once"),
    ("scipy_ivp.motion", "scipy", "SciPy, DOP853, all in one system"),
):
    add("motion", function, key, label, motions(function, 4096))
make = jumps("numpy_batch.jump", 65_536, lambda size: 10**6, checked=True)
add("jumps", "numpy_batch.jump", "numpy", BATCH, make)
for function, key, label, cubic in (
    ("c.rank2", "c-rank2", "C, rank two, 32 trajectories at once", False),
    ("c.eliminate", "c-elimination", "C, elimination", True),
    ("numpy_batch.solve", "numpy-solve", "NumPy, `linalg.solve`", True),
):
    for n in DIMENSIONS:
        make = dimensions(function, n, cubic, slow=function.startswith("numpy"))
        add("n dimensions", function, key, label, make, on_one_thread=True, x=n)


for function, key, label, share in (
    ("fields.in_c", "c-field", "C: Lorenz written out, the chain by elimination", 1),
    ("fields.in_numba", "numba-solve", f"{PRANGE}, `linalg.solve`", 4),
    ("fields.in_numpy", "numpy-solve", "NumPy, `linalg.solve`", 20),
):
    for components in FIELDS:
        make = fields(function, components, 600 // components // share)
        add("fields", function, key, label, make, x=components)


def in_numpy(name):
    """NumPy function of states (..., 2)."""

    def call(states):
        found = getattr(Formulas(), name)(*states.T)
        return np.stack(found, axis=-1) if isinstance(found, tuple) else found

    return call


for name in QUANTITIES:
    if hasattr(Formulas, name):
        add("quantities", "numpy", name, f"`{name}` in NumPy", quantities(in_numpy(name), name))
