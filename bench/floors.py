"""What a release should reach, as ratios that one run measures.

ROWS are lines of the page of tables: a label, two rows, and a bound of the ratio of their rates
(at least) or of their times (at most).
"""

_MOTIONS = (
    ("Hénon and Heiles", "orders-{}", (0.15, 0.25, 0.4), (None, 0.8, 0.7)),
    ("Lorenz", "more_motions-lorenz-{}", (0.28, 0.33, 0.5), (None, 0.8, 0.7)),
    ("Euler's top", "more_motions-euler-{}", (0.15, 0.22, 0.33), (None, 0.8, 0.7)),
    ("Kepler", "more_motions-kepler-{}", (0.45, 0.5, 0.5), (None, 0.8, 0.7)),
    ("FPUT", "more_motions-fput-{}", (0.35, 0.6, 0.9), (None, 1.1, 0.8)),
    ("a pendulum", "more_motions-pendulum-{}", (None, 0.6, 0.5), (None, None, None)),
    ("Rosenzweig and MacArthur", "more_motions-rosenzweig-{}", (None, 0.6, 0.5), (None,) * 3),
)


SAID = {"heyoka": "heyoka", "dop853": "DOP853 in lanes"}


def _motions():
    """Yield the rows of motions of 1,024 orbits, beside others."""
    for title, rows, *bounds in _MOTIONS:
        for key, of_key in zip(SAID, bounds, strict=True):
            for below, bound in zip((0.001, 1e-06, 1e-09), of_key, strict=True):
                if bound is not None:
                    error = f"{below:.0e}".replace("e-0", "e-")
                    label = f"{title} by `flow`, error below {error}, beside {SAID[key]}"
                    pair = (f"{rows.format(each)}-{below}" for each in ("flow", key))
                    yield label, *pair, "≤", bound


# fmt: off
ROWS = (
    ("last states by `iterate`, beside C, dimensionless variables",
     "last_states-iterate", "last_states-c-free", "≥", 0.85),
    ("all states by `iterate`, beside `numpy.ones` of as many",
     "saved_states-new", "saved_states-ones", "≥", 0.75),
    ("`exact`, n = 1000, beside C, formula (5)",
     "last_states-exact", "last_states-c-printed", "≥", 14),
    ("one orbit by `iterate`, beside Numba",
     "few_orbits-iterate-1", "few_orbits-numba-1", "≥", 0.5),
    ("`lyapunov_exponents` of a field, beside `iterate`, D = 3",
     "fields-exponents-3", "fields-iterate-3", "≤", 10),
    ("the same, D = 12", "fields-exponents-12", "fields-iterate-12", "≤", 10),
    # The operations alone: 12.7 times as many as those of a step.
    ("the same, D = 32", "fields-exponents-32", "fields-iterate-32", "≤", 16),
    ("the Lorenz system, beside C written for it, with FMA",
     "fields-iterate-3", "fields-c-3", "≥", 0.42),
    ("a chain of 12, beside C that eliminates it as dense",
     "fields-iterate-12", "fields-c-12", "≥", 5.5),
    ("a chain of 32, beside C that eliminates it as dense",
     "fields-iterate-32", "fields-c-32", "≥", 10),
    ("one orbit of Lorenz-96, D = 1024, beside SciPy's sparse solver",
     "one_orbit_of_many_variables-lorenz-96-1024",
     "one_orbit_of_many_variables-spsolve-1024", "≥", 20),
    ("64 orbits of Lorenz-96, D = 512, beside 64 of D = 128, a step",
     "many_variables-lorenz-96-512", "many_variables-lorenz-96-128", "≤", 6),
    ("64 orbits of Lorenz-96, D = 1024, beside 64 of D = 128, a step",
     "many_variables-lorenz-96-1024", "many_variables-lorenz-96-128", "≤", 13),
    ("order 8, error below 1e-6, beside order 2",
     "orders-order8-1e-06", "orders-order2-1e-06", "≤", 0.067),
    ("one orbit by `flow`, error below 1e-9, beside DOP853 of SciPy",
     "one_motion-flow-1e-09", "one_motion-dop853-1e-09", "≤", 0.05),
    ("the same, beside heyoka", "one_motion-flow-1e-09", "one_motion-heyoka-1e-09", "≤", 1),
    ("HIRES by `flow`, error below 1e-6, beside LSODA of SciPy",
     "stiff_motions-hires-flow-1e-06", "stiff_motions-hires-lsoda-1e-06", "≤", 0.02),
    ("Robertson's reaction, the same",
     "stiff_motions-robertson-flow-1e-06", "stiff_motions-robertson-lsoda-1e-06", "≤", 0.02),
    ("Van der Pol, the same",
     "stiff_motions-van-der-pol-flow-1e-06", "stiff_motions-van-der-pol-lsoda-1e-06", "≤", 0.05),
    ("64 orbits of Lorenz-96, D = 40, by `flow`, beside DOP853 in lanes",
     "lattices-lorenz-96-40-flow-1e-06", "lattices-lorenz-96-40-dop853-1e-06", "≤", 0.8),
    *_motions(),
    ("one orbit of the Lorenz system, beside a loop over `step_system`",
     "one_orbit_of_a_field-iterate-3", "one_orbit_of_a_field-own-system-3", "≥", 0.8),
    ("one orbit of a chain of 12, beside a loop over `step_system`",
     "one_orbit_of_a_field-iterate-12", "one_orbit_of_a_field-own-system-12", "≥", 0.8),
    ("steps with a rotor, beside those without", "rotors-iterate-0.7", "rotors-iterate-0", "≤", 3),
    ("small call of `iterate`, beside `numpy.linalg.solve`",
     "calls-iterate", "calls-solve", "≤", 5),
    ("small call of `exact`, beside `numpy.linalg.solve`", "calls-exact", "calls-solve", "≤", 4),
    ("small call of `step`, beside `numpy.linalg.solve`", "calls-step", "calls-solve", "≤", 5),
    ("`step` of a field, beside `numpy.linalg.solve`",
     "calls-step-field", "calls-solve", "≤", 5),
    ("`exact`, nothing compiled, beside `import numba`",
     "processes-exact-first", "processes-import-numba", "≤", 13),
    ("`iterate`, nothing compiled, beside `import numba`",
     "processes-iterate-first", "processes-import-numba", "≤", 13),
    ("a gyrostat, nothing compiled, beside `import numba`",
     "processes-gyrostat-first", "processes-import-numba", "≤", 13),
    ("n dimensions, nothing compiled, beside `import numba`",
     "processes-nd-first", "processes-import-numba", "≤", 14),
    ("a field, nothing compiled, beside `import numba`",
     "processes-field-first", "processes-import-numba", "≤", 10),
    ("README's Python blocks, nothing compiled, beside `import numba`",
     "processes-readme-first", "processes-import-numba", "≤", 45),
    ("`import suslov_fast`, beside `import numba`",
     "processes-import-suslov_fast", "processes-import-numba", "≤", 0.1),
)
# fmt: on
