"""The benchmarks of this package: the timed calls and their rows of results.

All calls use the public API, with arguments that versions 0.2 and 0.3 both accept.
"""

from functools import partial

import numpy as np
from problem import BODY, EPS, aligned, problem_nd
from work import (
    Case,
    Work,
    dimensions,
    jumps,
    last_states,
    motions,
    orientations,
    quantities,
    saved_states,
)

import suslov_fast
from suslov_fast import exact, first_integral, flow, iterate, step

STATES = 5_000_000
BYTES_SAVED = 2**26
CASES: list[Case] = []


def add(*arguments, **keywords):
    """Add a case to the list."""
    CASES.append(Case(*arguments, **keywords))


# ------------------------------------------------------------------ three dimensions

# Allowed times for batches of 64 and more, as multiples of those of 0.2.
AT_MOST = {"auto": 1.2, "canonical": 1.1, "ds2": 1.2}


def last(method):
    return lambda omega0, steps, threads: (
        iterate(BODY, omega0, EPS, steps, save_every=None, method=method).final
    )


def saved(method):
    return lambda omega0, steps, threads, out, every=1: (
        iterate(BODY, omega0, EPS, steps, save_every=every, method=method, out=out).omega
    )


for method, label, limit in (
    ("auto", '`method="auto"`: the last state by the closed form', None),
    ("canonical", '`method="canonical"`: iterates, one division per step', ("divisions", 1)),
    ("ds2", '`method="ds2"`: iterates the map as printed', ("divisions", 1)),
):
    more = {"limit": limit, "at_most": AT_MOST[method], "quick": method != "ds2"}
    add("last states", method, label, last_states(last(method)), **more)

for method in ("auto", "canonical"):
    label, at_most = f'`iterate`, `method="{method}"`', AT_MOST[method]
    for batch in (10**k for k in range(7)):
        # Below 64 orbits, the overhead of a call dominates.
        more = {"x": batch, "at_most": at_most if batch >= 64 else 1.3}
        add("batch", method, label, last_states(last(method), batch, 50), **more)
    for batch in (1, 2, 5, 9, 100, 1001, 65_533, 65_536):
        make = saved_states(saved(method), batch, STATES // batch)
        more = {"x": batch, "limit": ("streaming", 16), "at_most": at_most if batch >= 64 else 2.5}
        more["quick"] = (batch, method) in ((1, "auto"), (65_533, "auto"), (65_533, "canonical"))
        add("few orbits", method, label, make, **more)
    for every in (10**k for k in range(5)):
        make = saved_states(saved(method), 4096, 50, every)
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
    make = saved_states(saved(method), every=every, memory=memory)
    add("saved states", f"{method}-{memory}", label, make, **more)


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
    make = jumps(call, batch, numbers, checked=key == "far")
    add("jumps", key, label, make, at_most=1.6, quick=key == "scattered-4096")
make = motions(lambda omega0, time, threads: flow(BODY, omega0, time), 65_536)
add("motion", "flow", "`flow`, the closed form", make, at_most=1.6)

# Quantities: True if eps is an argument, and the number of values per state.
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
for name, (needs_eps, values) in QUANTITIES.items():
    call = partial(getattr(suslov_fast, name), BODY, **({"eps": EPS} if needs_eps else {}))
    more = {"limit": ("copy", 16 + 8 * values), "quick": name == "first_integral"}
    add("quantities", name, f"`{name}`", quantities(call, name), threads="both", **more)

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
        return Work(call, rows * len(omega0))

    return make


DIMENSIONS = (2, 4, 8, 16, 32, 64, 128)
for components in DIMENSIONS:
    for method, at_most in (("rank2", 1.0), ("gauss", 1.3)):
        more = {"x": components, "at_most": at_most, "quick": components == 8, "threads": "one"}
        make = dimensions(last_nd(method), components, cubic=method == "gauss")
        add("n dimensions", method, f'`method="{method}"`', make, **more)
for components in (3, 8, 32):
    for key, whose, at_most in (("any", "any", 1.2), ("integrable", "an integrable", 2.5)):
        more = {"x": components, "limit": ("streaming", 8 * components), "at_most": at_most}
        more["quick"] = components == 8 and key == "integrable"
        make = saved_states_nd(components, key == "integrable")
        add("n dimensions, saved states", key, f"`iterate`, {whose} body", make, **more)

for what, label in (
    ("last", "`iterate`, last states and orientations"),
    ("all", "`iterate`, all states and orientations"),
    ("along", "`attitude` of all states"),
    ("exponents", "`lyapunov_exponents`"),
):
    for n in (3, 4):
        more = {"x": n, "at_most": 1.5, "quick": n == 3 and what in ("all", "exponents")}
        add("space", what, label, orientations(what, n), **more)

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
