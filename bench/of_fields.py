"""Kahan's map of quadratic fields, small, dense and large, and maps of higher order."""

from functools import cache, partial

import problem
import work
from problem import EPS_FIELD, dense_field, sparse_field
from work import NUMPY, OTHERS, OURS, C

import suslov_fast as sf

OWN = "your own `prange` loop over `compiled."
BY_NUMPY, TAYLOR = "fields.in_numpy", "integrators.lorenz"
WRITTEN = "C: explicit formulas for D = 3 and 4, dense elimination otherwise"
ALL = 3, 4, 12, 32


def exponents(field, x, steps):
    return sf.lyapunov_exponents(field, x, EPS_FIELD, steps)


def last_field(field, x, steps):
    return sf.iterate(field, x, EPS_FIELD, steps, save_every=None).final


@cache
def map_of(f):
    return sf.Map(f, 2)


def last_of_map(f, x, steps):
    return sf.iterate(map_of(f), x, steps=steps, save_every=None).final


def many_variables(function, f, D, batch, steps, reference, size):
    """Steps of a lattice, or of a dense field if f is None."""
    D = size(D, 16)
    field = partial(dense_field, D) if f is None else partial(problem.lattice, f, D)
    return work.fields(function, field, batch, steps, reference, size)


SPSOLVE, RUNGE_KUTTA = "many.by_sparse", "many.by_runge_kutta"
# At the largest error of the table: steps of each order, tolerances of integrators. They are the
# least, and largest, with which the error is below it.
AT_ERRORS = {
    "order2": (OURS, "`iterate`", work.by_order, "auto", {1e-3: 450, 1e-6: 14_200}),
    "order4": (OURS, "", work.by_order, "order4", {1e-3: 22, 1e-6: 123, 1e-9: 687}),
    "order6": (OURS, "", work.by_order, "order6", {1e-3: 13, 1e-6: 34, 1e-9: 104, 1e-12: 328}),
    "order8": (OURS, "", work.by_order, "order8", {1e-3: 10, 1e-6: 20, 1e-9: 44, 1e-12: 101}),
    "flow": (
        OURS,
        "`flow`",
        work.by_flow,
        None,
        {1e-3: 3.2e-3, 1e-6: 1e-5, 1e-9: 3.2e-8, 1e-12: 5e-11},
    ),
    "dop853": (
        C,
        "C, DOP853, 8 at once",
        "dop853.in_lanes",
        "henon-heiles",
        {1e-3: 1.3e-3, 1e-6: 1e-6, 1e-9: 2e-9, 1e-12: 2.5e-12},
    ),
    "heyoka": (
        OTHERS,
        "heyoka, Taylor integrator, 16 at once",
        "motions.by_heyoka",
        "henon-heiles",
        {1e-3: 1.6e-2, 1e-6: 4.2e-5, 1e-9: 1e-7, 1e-12: 3.2e-11},
    ),
    "scipy": (
        OTHERS,
        "SciPy, DOP853, all in one system",
        "integrators.henon_heiles_by_scipy",
        None,
        {1e-3: 5e-4, 1e-6: 3.9e-7, 1e-9: 5.2e-10},
    ),
}


def add_cases(add):
    """Add steps of fields by this package and by peers."""
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
        dense = (6, 12) if reference == BY_NUMPY and dimensions == ALL else ()
        for table, field, numbers, most in (
            ("fields", sparse_field, dimensions, 2304),
            ("dense fields", dense_field, dense, 576),
        ):
            for n in numbers:
                steps, batch = max(most // n // part, 1), 49_152 // n
                arguments = work.fields, function, partial(field, n), batch, steps, reference
                add(table, key, whose, label, *arguments, x=n, **more)
    for name in problem.OWN_MAPS:
        for key, whose, label, function in (
            ("iterate", OURS, "`iterate` of a `Map`", last_of_map),
            ("numba", OTHERS, "Numba, `prange` over orbits", "numba_loops.own_map"),
        ):
            add("own maps", key, whose, label, work.own_maps, function, name, 10_000, 1000, x=name)
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
                # A call costs as much as some steps: with 3 in place of 24, a step of D = 1024
                # takes 1.5 times as long.
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
    for key, (whose, label, function, method, needed) in AT_ERRORS.items():
        for below, number in needed.items():
            argument = (number,) if method is None else (method, number)
            label = label or f'`iterate(..., method="{key}")`'
            arguments = work.at_equal_error, function, argument, below
            add("orders", key, whose, label, *arguments, x=below, one_thread=True)
