"""Other implementations, one module per library, and loops of users over `suslov_fast.compiled`.

Those without their library are skipped.

Errors of peers that iterate the map are relative to its orbit, those of integrators relative to
the continuous motion at the same time.
"""

import numpy as np
from cases import CUBIC, DIMENSIONS, QUANTITIES, STEPS_OF_FIELD
from formulas import Formulas
from problem import FIELDS
from work import Case, dimensions, fields, jumps, last_states, motions, quantities, saved_states

FREE, PRANGE = "C, parameter-free", "Numba, naive: `prange` over trajectories"
BATCH, FOUR = "NumPy, over the batch", "one division per four steps"
OWN = "your own `prange` loop over `compiled."
CASES = []


def add(table, function, key, label, make, on_one_thread=False, **more):
    """Add a case to the list."""
    library = function.removeprefix("fields.in_")
    of_numpy = library.startswith("numpy") and "python" not in function
    whose = "C" if library.partition(".")[0] == "c" else "NumPy" if of_numpy else "others"
    whose = "this package" if library.startswith("own_loops") else whose
    threads = "one" if on_one_thread or library.startswith(("numpy", "scipy")) else "all"
    CASES.append(Case(table, key, label, make, whose=whose, threads=threads, **more))


# Divisions per step, and the part of the work that slow peers do.
for function, key, label, part, divisions in (
    ("c.projective", "c-projective", f"{FREE}, {FOUR}", 1, 0.25),
    ("c.parameter_free", "c-free", FREE, 1, 1),
    ("c.as_printed", "c-printed", "C, as printed, two divisions", 1, 2),
    ("c.as_printed_once", "c-printed-once", "C, as printed, one division", 1, 1),
    ("numba_loops.in_blocks", "numba-blocks", "Numba, parameter-free, in blocks", 1, 1),
    ("own_loops.in_lanes", "own-lanes", f"{OWN}advance`, 64 orbits at once", 1, 1),
    ("own_loops.one_by_one", "own-advance", f"{OWN}advance`", 16, None),
    ("own_loops.step_by_step", "own-step", f"{OWN}step`", 16, None),
    ("numba_loops.final", "numba", PRANGE, 16, None),
    ("numpy_batch.final", "numpy", BATCH, 64, None),
    ("numpy_batch.final_python", "python", "Python", 1024, None),
):
    limit = divisions and ("divisions", divisions)
    make = last_states(function, 65_536 // part)
    add("last states", function, key, label, make, limit=limit, part=part)
for function, key, label, part in (
    ("c.stored_streaming", "c-streaming", f"{FREE}, streaming stores", 1),
    ("c.stored", "c-plain", f"{FREE}, plain stores", 1),
    ("numba_loops.stored", "numba", PRANGE, 4),
    ("numpy_batch.stored", "numpy", BATCH, 16),
):
    make = saved_states(function, 65_536 // part)
    add("saved states", function, key, label, make, limit=("streaming", 16), part=part)
for function, key, label, part in (
    ("numpy_batch.flow", "numpy", "NumPy, Suslov's solution by `tanh` and `cosh`", 1),
    ("heyoka_.motion", "heyoka", "heyoka, Taylor integrator, 16 at once", 16),
    ("scipy_ivp.motion", "scipy", "SciPy, DOP853, all in one system", 16),
):
    add("motion", function, key, label, motions(function, 65_536 // part), part=part)
make = jumps("numpy_batch.jump", 65_536, lambda size: 10**6, checked=True)
add("jumps", "numpy_batch.jump", "far", BATCH, make)
for function, key, label in (
    ("c.rank2", "c-rank2", "C, rank two, 32 trajectories at once"),
    ("c.eliminate_lanes", "c-lanes", "C, elimination, 32 systems at once"),
    ("c.eliminate", "c-elimination", "C, elimination, one system at a time"),
    ("numpy_batch.solve", "numpy-solve", "NumPy, `linalg.solve`"),
):
    for n in DIMENSIONS:
        part, few = 1 if key == "c-rank2" else CUBIC[n], 4 if key == "numpy-solve" else 1
        make, more = dimensions(function, n, part, 512 // few), {"x": n, "part": few * part}
        add("n dimensions", function, key, label, make, on_one_thread=True, **more)


for function, key, label, part in (
    ("fields.in_c", "c-field", "C: Lorenz written out, the chain by elimination", 1),
    ("own_loops.of_field", "own-system", f"{OWN}step_system`", 1),
    ("fields.in_numpy", "numpy-solve", "NumPy, `linalg.solve`", 16),
):
    for components in FIELDS:
        make = fields(function, components, STEPS_OF_FIELD // components // part)
        add("fields", function, key, label, make, x=components, part=part)


def in_numpy(name):
    """NumPy function of states (..., 2)."""

    def call(states):
        found = getattr(Formulas(), name)(*states.T)
        return np.stack(found, axis=-1) if isinstance(found, tuple) else found

    return call


for name in QUANTITIES:
    if hasattr(Formulas, name):
        add("quantities", "numpy", name, f"`{name}` in NumPy", quantities(in_numpy(name), name))
