"""The benchmarks of this package: the timed calls and their rows of results.

All calls use the public API, with arguments that versions 0.2 and 0.3 both accept.
"""

import os
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
import work
from problem import BODY, EPS, EPS_FIELD, FIELDS, aligned, field_and_states, problem_nd

import suslov_fast
from suslov_fast import exact, first_integral, flow, iterate, step

STATES = 5_000_000
BYTES_SAVED = 2**26
CASES: list[work.Case] = []


def add(*arguments, **keywords):
    """Add a case to the list."""
    CASES.append(work.Case(*arguments, **keywords))


# ------------------------------------------------------------------ three dimensions


def last(method):
    return lambda omega0, steps, threads: (
        iterate(BODY, omega0, EPS, steps, save_every=None, method=method).final
    )


def saved(method):
    return lambda omega0, steps, threads, out, every=1: (
        iterate(BODY, omega0, EPS, steps, save_every=every, method=method, out=out).omega
    )


for method, label, limit in (
    ("auto", "the last state by the closed form, equivalent steps", None),
    ("canonical", "iterates, one division per step", ("divisions", 1)),
    ("ds2", "iterates the map as printed, two divisions", ("divisions", 2)),
):
    label = f'`method="{method}"`: {label}'
    add("last states", method, label, work.last_states(last(method)), limit=limit)

for method in ("canonical", "auto"):
    label = f'`iterate`, `method="{method}"`'
    for batch in (10**k for k in reversed(range(7))):  # the largest is that of `--quick`
        add("batch", method, label, work.last_states(last(method), batch, 50), x=batch)
    for batch in (1, 2, 5, 9, 100, 1001, 65_533, 65_536):
        make = work.saved_states(saved(method), batch, STATES // batch)
        add("few orbits", method, label, make, x=batch, limit=("streaming", 16))
    for every in (10**k for k in range(5)):
        make = work.saved_states(saved(method), 4096, 50, every)
        add("save_every", method, label, make, x=every)
    for memory in ("reused", "unaligned", "new") if method == "auto" else ("reused", "unaligned"):
        label = f'`method="{method}"`, {memory} memory'
        make = work.saved_states(saved(method), memory=memory)
        add("saved states", f"{method}-{memory}", label, make, limit=("streaming", 16))


def scattered(count):
    """Random numbers of steps."""
    return lambda size: np.random.default_rng(1).integers(-(10**6), 10**6, size(count, 16))


for key, label, batch, numbers in (
    ("far", "`exact`", 65_536, lambda size: 10**6),
    ("rows", "`exact`, 256 n in a row", 16_384, lambda size: np.arange(size(256, 16))),
    ("scattered-4096", "`exact`, 244 scattered n, 4,096 orbits", 4096, scattered(244)),
    ("scattered-1", "`exact`, 1,000,000 scattered n, 1 orbit", 1, scattered(1_000_000)),
):
    call = lambda omega0, n: exact(BODY, omega0, EPS, n)  # noqa: E731
    add("jumps", key, label, work.jumps(call, batch, numbers, checked=key == "far"))
make = work.motions(lambda omega0, time, threads: flow(BODY, omega0, time), 65_536)
add("motion", "flow", "`flow`, the closed form", make)

# Quantities: the number of values per state; those in WITHOUT_EPS have no argument eps.
WITHOUT_EPS = {"energy": 1, "to_xy": 2, "from_xy": 2, "vector_field": 2, "reaction": 1}
QUANTITIES = {
    "first_integral": 1,
    "modified_energy": 1,
    "criticality": 1,
    "invariant_density": 1,
    "step": 2,
    "jacobian": 4,
    **WITHOUT_EPS,
}
for name, values in QUANTITIES.items():
    call = partial(
        getattr(suslov_fast, name), BODY, **({} if name in WITHOUT_EPS else {"eps": EPS})
    )
    make, limit = work.quantities(call, name), ("copy", 16 + 8 * values)
    add("quantities", name, f"`{name}`", make, threads="both", limit=limit)

# ------------------------------------------------------------------ n dimensions, space, calls


def last_nd(method):
    return lambda body, omega0, eps, steps: (
        iterate(body, omega0, eps, steps, save_every=None, method=method).final
    )


def saved_states_nd(components, integrable):
    """All states in n dimensions, into reused memory."""

    def make(size, threads):
        body, omega0 = problem_nd(components, size(4096, 16), integrable)
        rows = size(BYTES_SAVED // omega0.nbytes, 4)
        out = aligned((rows, *omega0.shape))
        call = lambda: iterate(body, omega0, EPS / 2, rows - 1, out=out)  # noqa: E731
        return work.Work(call, rows * len(omega0))

    return make


# Numbers of components, and the part of the work that methods of the order of n**3 do.
CUBIC = {2: 1, 4: 1, 8: 2, 16: 4, 32: 8, 64: 16, 128: 16}
DIMENSIONS = tuple(CUBIC)
for components, of_cubic in CUBIC.items():
    for method, part in (("rank2", 1), ("gauss", of_cubic)):
        make = work.dimensions(last_nd(method), components, part)
        more = {"x": components, "threads": "one", "part": part}
        add("n dimensions", method, f'`method="{method}"`', make, **more)
for components in (3, 8, 32):
    for key, whose in (("any", "any"), ("integrable", "an integrable")):
        make, limit = saved_states_nd(components, key == "integrable"), 8 * components
        more = {"x": components, "limit": ("streaming", limit)}
        add("n dimensions, saved states", key, f"`iterate`, {whose} body", make, **more)


def last_of_field(components):
    """Last states of a field by this package."""
    field, _ = field_and_states(components, 1)
    return lambda x, steps, threads: iterate(field, x, EPS_FIELD, steps, save_every=None).final


STEPS_OF_FIELD = 576
for components in FIELDS:
    make = work.fields(last_of_field(components), components, STEPS_OF_FIELD // components)
    add("fields", "iterate", "`iterate`", make, x=components)

for what, label in (
    ("last", "`iterate`, last states and orientations"),
    ("all", "`iterate`, all states and orientations"),
    ("along", "`attitude` of all states"),
    ("exponents", "`lyapunov_exponents`"),
):
    for n in (3, 4):
        add("space", what, label, work.orientations(what, n), x=n)

BODY_ND, STATE_ND = suslov_fast.SuslovND([1.3, 2.1, 3.7], [0.4, -0.7, 0.5]), [1.0, 0.5, 0.2]
STATE = [1.0, 0.5]
for key, label, call in (
    ("iterate", "`iterate`, one orbit, 10 steps", lambda: iterate(BODY, STATE, EPS, 10)),
    ("iterate-nd", "`iterate`, n = 4", lambda: iterate(BODY_ND, STATE_ND, EPS, 10)),
    ("step", "`step`, one state", lambda: step(BODY, STATE, EPS)),
    ("step-nd", "`step`, n = 4", lambda: step(BODY_ND, STATE_ND, EPS)),
    ("exact", "`exact`, one state", lambda: exact(BODY, STATE, EPS, 10)),
    ("first_integral", "`first_integral`, one state", lambda: first_integral(BODY, STATE, EPS)),
):
    make = lambda size, threads, call=call: work.Work(call, 1)  # noqa: E731
    add("calls", key, label, make)

# ------------------------------------------------------------------ processes

TREE = Path(suslov_fast.__path__[0]).parent
IMPORT = "import numpy as np, suslov_fast as s; "
CODE_3D = "s.Suslov3D(4, 1, -0.5, -0.3)"
CODE_ND = "s.SuslovND(np.linspace(1, 2, 9), np.linspace(-0.3, 0.4, 9))"
IMPORTS = {
    "python": ("Python alone", "pass"),
    "import-numba": ("`import numba`", "import numba"),
    "import": ("`import suslov_fast`", "import suslov_fast"),
}
CALLS = {
    "iterate": (
        "`iterate` of 10,000 orbits",
        f"s.iterate({CODE_3D}, np.ones((10_000, 2)), .2, 200)",
    ),
    "iterate-nd": ("`iterate`, 9 components", f"s.iterate({CODE_ND}, np.ones((100, 9)), .1, 20)"),
    "exact": ("`exact` of one state", f"s.exact({CODE_3D}, [1.0, 0.5], 0.2, 25)"),
}


def process(code, fresh=False):
    """A process with this package, and with an empty cache of kernels if `fresh`."""

    def make(size, threads):
        chosen = code if size(1, 0) else "pass"  # as a test, a trivial process is enough

        def call():
            with tempfile.TemporaryDirectory() as folder:
                settings = {"PYTHONPATH": str(TREE), "PYTHONDONTWRITEBYTECODE": ""}
                settings |= {"NUMBA_CACHE_DIR": folder} if fresh else {}
                environment = os.environ | settings
                subprocess.run([sys.executable, "-c", chosen], env=environment, check=True)

        return work.Work(call, 1)

    return make


for key, (label, call) in CALLS.items():
    again, first = f"{label}, compiled before", f"{label}, nothing compiled"
    add("processes", f"{key}-again", again, process(IMPORT + call), threads="one", once=True)
    make = process(IMPORT + call, fresh=True)
    add("processes", f"{key}-first", first, make, threads="one", slow=True)
for key, (label, code) in IMPORTS.items():
    whose = "this package" if "suslov_fast" in code else "others"
    add("processes", key, label, process(code), whose=whose, threads="one", once=True)
