"""The benchmarks of this package: what each one times, and the row of results that it makes.

Everything goes through the public API, with arguments that versions 0.2 and 0.3 both take.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from formulas import Formulas
from problem import (
    BODY,
    CHECKED,
    CHECKED_ND,
    EPS,
    PRECISE,
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

import suslov_fast
from suslov_fast import attitude, exact, first_integral, flow, iterate, lyapunov_exponents, step

OURS = "this package"
STATES = 5_000_000
BYTES_SAVED = 2**26


class Work(NamedTuple):
    """A call, how many units of work it does, and its error as a function without arguments."""

    call: Callable[[], object]
    work: int
    error: Callable[[], float] | None = None


class Case(NamedTuple):
    """One benchmark, before any memory is taken.

    `make` takes a function `size(full, small)`, which chooses the size of a problem, and the number
    of threads. `limit` is one of the machine, and how much of it a unit of work needs. A call may
    take `at_most` times as long as that of the revision it is compared with.
    """

    table: str
    key: str
    label: str
    make: Callable[[Callable[[int, int], int], int], Work]
    x: float | None = None
    limit: tuple[str, float] | None = None
    whose: str = OURS
    at_most: float = 1.2
    quick: bool = False  # whether `compare.py --quick` measures it
    threads: str = "all"  # or "one" or "both"

    @property
    def name(self):
        return "-".join(str(each) for each in (self.table, self.key, self.x) if each is not None)


CASES: list[Case] = []


def add(*arguments, **keywords):
    """Put a case on the list."""
    CASES.append(Case(*arguments, **keywords))


# Times as long as 0.2, for batches of 64 and more.
AT_MOST = {"auto": 1.2, "canonical": 1.1, "ds2": 1.2}


def last_states(method, batch=65_536, steps=STEPS):
    """Last states alone."""

    def make(size, threads):
        omega0, n = starts(size(batch, 64)), size(steps, 20)
        options = {"save_every": None, "method": method}

        def error():
            computed = iterate(BODY, starts(CHECKED), EPS, n, **options).final
            return relative_error(computed, orbit(CHECKED, n)[-1])

        return Work(lambda: iterate(BODY, omega0, EPS, n, **options), len(omega0) * n, error)

    return make


def saved_states(method, batch=65_536, saved=257, every=1, memory="reused"):
    """Saved states into new memory, or into memory that is used again."""

    def make(size, threads):
        omega0 = starts(size(batch, max(64, batch % 64)) if batch >= 64 else batch)
        rows, between = size(saved, 9), size(every, 10)
        options = {"save_every": between, "method": method}
        shape, offset = (rows, *omega0.shape), 2 * (memory == "unaligned")
        out = {} if memory == "new" else {"out": aligned(shape, offset)}
        steps, few = (rows - 1) * between, STEPS // between * between

        def call():
            iterate(BODY, omega0, EPS, steps, **options, **out)

        def error():
            computed = iterate(BODY, starts(CHECKED), EPS, few, **options).omega
            return relative_error(computed, orbit(CHECKED, few)[::between])

        return Work(call, rows * len(omega0), error if every <= STEPS else None)

    return make


for method, label, limit in (
    ("auto", '`method="auto"`: the last state by the closed form', None),
    ("canonical", '`method="canonical"`: iterates, one division per step', ("divisions", 1)),
    ("ds2", '`method="ds2"`: iterates the map as printed', ("divisions", 1)),
):
    more = {"limit": limit, "at_most": AT_MOST[method], "quick": method != "ds2"}
    add("last states", method, label, last_states(method), **more)

for method in ("auto", "canonical"):
    label, at_most = f'`iterate`, `method="{method}"`', AT_MOST[method]
    for batch in (10**k for k in range(7)):
        # Below 64 orbits the time is that of a small call.
        more = {"x": batch, "at_most": at_most if batch >= 64 else 1.3}
        add("batch", method, label, last_states(method, batch, 50), **more)
    for batch in (1, 2, 5, 9, 100, 1001, 65_533, 65_536):
        make = saved_states(method, batch, STATES // batch)
        more = {"x": batch, "limit": ("streaming", 16), "at_most": at_most if batch >= 64 else 2.5}
        more["quick"] = (batch, method) in ((1, "auto"), (65_533, "auto"), (65_533, "canonical"))
        add("few orbits", method, label, make, **more)
    for every in (10**k for k in range(5)):
        make = saved_states(method, 4096, 50, every)
        add("save_every", method, label, make, x=every, at_most=at_most)

for method, every, memory in (
    ("auto", 1, "reused"),
    ("auto", 10, "reused"),
    ("auto", 1000, "reused"),
    ("auto", 1, "new"),
    ("auto", 1, "unaligned"),
    ("canonical", 1, "reused"),
    ("canonical", 1, "unaligned"),
):
    label = f'`method="{method}"`, every {f"{every:,}th " * (every > 1)}state, {memory} memory'
    more = {"x": every, "limit": ("streaming", 16), "at_most": AT_MOST[method]}
    more["quick"] = every == 1 and memory == "reused"
    make = saved_states(method, every=every, memory=memory)
    add("saved states", f"{method}-{memory}", label, make, **more)


def closed_form(function, batch, times, checked=False):
    """States at some n by `exact`, or at a time by `flow`; `times` makes them of a size."""

    def make(size, threads):
        omega0, n = starts(size(batch, 16)), times(size)
        one_step = (EPS,) if function is exact else ()

        def error():
            last = STEPS if function is exact else STEPS * EPS
            computed = function(BODY, starts(CHECKED), *one_step, last)
            wanted = orbit(CHECKED, STEPS)[-1] if function is exact else motion(CHECKED, last)
            return relative_error(computed, wanted)

        work = len(omega0) * np.size(n)
        return Work(lambda: function(BODY, omega0, *one_step, n), work, error if checked else None)

    return make


def scattered(count):
    """Random n."""
    return lambda size: np.random.default_rng(1).integers(-(10**6), 10**6, size(count, 16))


for key, label, batch, times in (
    ("far", "`exact`", 65_536, lambda size: 10**6),
    ("rows", "`exact`, 256 n in a row", 16_384, lambda size: np.arange(size(256, 16))),
    ("scattered-4096", "`exact`, 244 scattered n, 4,096 orbits", 4096, scattered(244)),
    ("scattered-1", "`exact`, 1,000,000 scattered n, 1 orbit", 1, scattered(1_000_000)),
):
    make = closed_form(exact, batch, times, checked=key == "far")
    add("jumps", key, label, make, at_most=1.6, quick=key == "scattered-4096")
make = closed_form(flow, 65_536, lambda size: STEPS * EPS, checked=True)
add("motion", "flow", "`flow`, the closed form", make, at_most=1.6)


def last_states_nd(components, method):
    """Steps in n dimensions that take some milliseconds."""

    def make(size, threads):
        body, omega0 = problem_nd(components, size(512, 16))
        steps = size(max(3, 4000 // components ** (2 if method == "gauss" else 1)), 3)
        options = {"save_every": None, "method": method}

        def error():
            few = problem_nd(components, CHECKED_ND)[1]
            computed = iterate(body, few, EPS / 2, STEPS_ND, **options).final
            return relative_error(computed, orbit_nd(components))

        def call():
            return iterate(body, omega0, EPS / 2, steps, **options)

        return Work(call, len(omega0) * steps, error)

    return make


def saved_states_nd(components, integrable):
    """All states in n dimensions, into memory that is used again."""

    def make(size, threads):
        body, omega0 = problem_nd(components, size(4096, 16), integrable)
        saved = size(BYTES_SAVED // omega0.nbytes, 4)
        out = aligned((saved, *omega0.shape))
        call = lambda: iterate(body, omega0, EPS / 2, saved - 1, out=out)  # noqa: E731
        return Work(call, saved * len(omega0))

    return make


for components in (2, 4, 8, 16, 32, 64, 128):
    for method, at_most in (("rank2", 1.0), ("gauss", 1.3)):
        more = {"x": components, "at_most": at_most, "quick": components == 8, "threads": "one"}
        make = last_states_nd(components, method)
        add("n dimensions", method, f'`method="{method}"`', make, **more)
for components in (3, 8, 32):
    for key, at_most in (("any", 1.2), ("integrable", 2.5)):
        more = {"x": components, "limit": ("streaming", 8 * components), "at_most": at_most}
        more["quick"] = components == 8 and key == "integrable"
        make = saved_states_nd(components, key == "integrable")
        label = f"`iterate`, {'any' if key == 'any' else 'an integrable'} body"
        add("n dimensions, saved states", key, label, make, **more)

# Quantities that need eps, and those that do not, with the size of a value.
QUANTITIES = {
    "first_integral": (True, 1),
    "modified_energy": (True, 1),
    "criticality": (True, 1),
    "invariant_density": (True, 1),
    "step": (True, 2),
    "jacobian": (True, 4),
    "energy": (False, 1),
    "to_xy": (False, 2),
    "from_xy": (False, 2),
    "vector_field": (False, 2),
    "reaction": (False, 1),
}


def random_states(count):
    """States away from where a quantity is infinite."""
    return np.random.default_rng(2).uniform(0.5, 2, (count, 2))


def quantity(name):
    """A quantity of ten million states, into new memory."""
    function = getattr(suslov_fast, name)
    eps = (EPS,) if QUANTITIES[name][0] else ()

    def make(size, threads):
        states = random_states(size(10_000_000, 1000))

        def error():
            few = random_states(CHECKED)
            computed = function(BODY, few, *eps).reshape(CHECKED, -1)
            wanted = np.stack(
                np.atleast_2d(getattr(PRECISE, name)(*few.T.astype(np.longdouble))), axis=-1
            )
            return relative_error(computed, wanted)

        known = hasattr(Formulas, name)
        return Work(lambda: function(BODY, states, *eps), len(states), error if known else None)

    return make


for name, (_, values) in QUANTITIES.items():
    more = {"limit": ("copy", 16 + 8 * values), "quick": name == "first_integral"}
    add("quantities", name, f"`{name}`", quantity(name), threads="both", **more)


def orientations(n, what):
    """Orientations of 4096 bodies along 100 steps, or exponents of their orbits."""

    def make(size, threads):
        batch, steps = size(4096, 16), size(100, 5)
        body, omega0 = (BODY, starts(batch)) if n == 3 else problem_nd(n - 1, batch)
        if what == "exponents":
            call = lambda: lyapunov_exponents(body, omega0, EPS / 2, steps)  # noqa: E731
        elif what == "along":
            states = iterate(body, omega0, EPS / 2, steps).omega
            call = lambda: attitude(body, states, EPS / 2)  # noqa: E731
        else:
            options = {"save_every": 1 if what == "all" else None, "attitude": True}
            call = lambda: iterate(body, omega0, EPS / 2, steps, **options)  # noqa: E731
        return Work(call, batch * steps)

    return make


for what, label in {
    "last": "`iterate`, last states and orientations",
    "all": "`iterate`, all states and orientations",
    "along": "`attitude` of all states",
    "exponents": "`lyapunov_exponents`",
}.items():
    for n in (3, 4):
        more = {"x": n, "at_most": 1.5, "quick": n == 3 and what in ("all", "exponents")}
        add("space", what, label, orientations(n, what), **more)

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
    make = lambda size, threads, call=call: Work(call, 1)  # noqa: E731
    add("calls", key, label, make, at_most=1.3, quick=key == "iterate")
