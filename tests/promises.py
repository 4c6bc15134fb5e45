"""The table of public functions of states and steps, and problems for them, for each record.

Values have the axes of the batch first, then time, then components. A record is one of `maps.MAPS`.
"""

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import config
from samples import quantity, random_bodies

import suslov_fast as sf
from suslov_fast.bodies.body import Suslov
from suslov_fast.fields.field import INDICES
from suslov_fast.maps.map_records import MAPS

SHARED = (INDICES,)  # parts that all members of a family of fields share
LANES = 128
SIZE, STEPS = LANES + 13, 12


# Functions of (rng, shape) that make bodies, by the name of a record and a number. Interpreted,
# orders 6 and 8 repeat what order 4 does.
KINDS = {
    f"{name} {k}": make
    for name, map in MAPS.items()
    for k, make in enumerate(random_bodies(name))
    if not (config.DISABLE_JIT and len(map.stages.fractions) > 7)
}
RECORDS = {kind: MAPS[kind.rpartition(" ")[0]] for kind in KINDS}
# Those whose map is that of functions without the argument `method`.
WITH_EPS = [kind for kind, map in RECORDS.items() if map.body is not sf.Map]
BY_DEFAULT = [kind for kind, map in RECORDS.items() if "auto" in map.methods]
# Methods with steps of their own.
METHODS = {
    name
    for map in MAPS.values()
    for name, steps in map.methods.items()
    if steps != map.methods.get("auto")
}
# A body of each, with which the functions that it has are looked up.
SAMPLES = {kind: make(np.random.default_rng(0), ()) for kind, make in KINDS.items()}


class Row(NamedTuple):
    """`call(body, omega, eps, **options)` returns results; those in `timed` have time first."""

    call: Callable[..., Any]
    timed: tuple[int, ...] = ()
    eps: bool = True  # an argument
    threads: bool = False

    def given(self, body, eps):
        """The step size of a call, if it has one."""
        return (eps,) * (self.eps and not isinstance(body, sf.Map))

    def values(self, body, omega, eps, **options):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sf.IntegrationWarning)
            results = self.call(body, omega, *self.given(body, eps), **options)
        results = results if isinstance(results, tuple) else (results,)
        axes = len(self.batch(body, omega, eps))
        for k, each in enumerate(results):
            yield np.moveaxis(each, 0, axes) if k in self.timed else np.asarray(each)

    def batch(self, body, omega, eps):
        of_eps = np.shape(*self.given(body, eps)) if self.given(body, eps) else ()
        return np.broadcast_shapes(body.shape, np.shape(omega)[:-1], of_eps)


def runs(**options):
    """Row of saved and last states, with the orientation if the run has it."""

    def call(body, omega, *eps, **others):
        run = sf.iterate(body, omega, *eps, STEPS, on_singular="ignore", **options, **others)
        more = (run.attitude,) if run.attitude is not None else ()
        return run.states, run.final, run.status, run.failed_at, *more

    return Row(call, timed=(0, 4), threads=True)


def solutions(body, omega, eps, **options):
    return tuple(body.exact(omega, eps, n, **options) for n in (7, TIMES))


# At a surface, and at a time: of each trajectory the states, and how often they acted.
CHANGES = [
    sf.Event(lambda x: x[0] - 0.2, to=lambda x: (-x[0], *(0.9 * a for a in x[1:]))),
    sf.Event(times=[0.7], to=lambda x: tuple(a + 0.1 for a in x)),
]


def changed(body, omega, **options):
    motion = sf.flow(body, omega, time=[0.5, 1.0], events=CHANGES, rtol=1e-6, **options)
    return motion.states, motion.events.count


TIMES = np.array([3, -1e9, -3, 0, 7, 700, 1e9])
# Functions of a state, and whether they take a step size.
OF_ALL = {"__call__": False, "jacobian": True, "matrix": True}
OF_BODIES = {"energy": False, "reaction": True, "momentum": False, "modified_energy": True}
OF_SOLVED = dict.fromkeys(("criticality", "first_integral", "invariant_density", "limits"), True)
IN_3D = {"rotation_number": True}
WITHOUT_ROTOR = {"to_xy": False, "closed_form": True, "step_full": True}
# Functions of a state, and others; a row that needs another function or a method has its name after
# a colon.
ROWS = {
    **{
        name: Row(quantity(name), eps=takes_eps)
        for table in (OF_ALL, OF_BODIES, OF_SOLVED, IN_3D, WITHOUT_ROTOR)
        for name, takes_eps in table.items()
    },
    "step": Row(sf.step, threads=True),
    "iterate": runs(save_every=3),
    "iterate: last states": runs(save_every=None),
    "iterate: attitude": runs(attitude=True, save_every=2),
    **{f"iterate: {method}": runs(method=method) for method in sorted(METHODS - {"auto"})},
    "exact": Row(solutions, timed=(1,), threads=True),
    "flow": Row(
        lambda b, w, **o: sf.flow(b, w, time=abs(TIMES) / 8, **o).states,
        timed=(0,),
        eps=False,
        threads=True,
    ),
    "flow: changes": Row(changed, timed=(0,), eps=False, threads=True),
    "lyapunov_exponents": Row(
        lambda b, w, *e, **o: sf.lyapunov_exponents(b, w, *e, STEPS, **o), threads=True
    ),
}


def has(kind, name):
    """True if a record has the function of a row."""
    body, map, (function, _, of) = SAMPLES[kind], RECORDS[kind], name.partition(": ")
    if config.DISABLE_JIT and function == "lyapunov_exponents":  # half an hour
        return False
    if of in METHODS:
        return of in map.methods
    if kind not in BY_DEFAULT:
        return False
    if map.body is sf.Map and function not in ("__call__", "step", "iterate", "lyapunov_exponents"):
        return False
    if function == "step_full" and body.dimension == 2:
        return getattr(body, "I3", None) is not None
    if of == "attitude":
        return map.attitude is not None
    if function in WITHOUT_ROTOR:
        return map.body is sf.Suslov3D and body.k == 0.0
    if function in IN_3D:
        return map.body is sf.Suslov3D
    if function in (*OF_SOLVED, "exact", "flow"):
        return map.body is not sf.Field and bool(body._is_solved)
    return function not in OF_BODIES or isinstance(body, Suslov)


def sample(rng, kind, body=(SIZE,), omega=(SIZE,), eps=(SIZE,), name="iterate"):
    """Bodies, states and step sizes of these shapes: t below and above 1, eps of both signs."""
    D, size = SAMPLES[kind].dimension + (name == "step_full"), 10 ** rng.uniform(-1, 1, (*omega, 1))
    states = rng.normal(size=(*omega, D)) * size
    return KINDS[kind](rng, body), states, rng.uniform(-0.5, 0.5, eps)


def part(body, index, batch):
    """The members of a batch with an index."""
    parts = dict(body._parts)
    for name, value in parts.items():
        if np.asarray(value).dtype.kind in "iufO" and name not in SHARED:
            own = np.shape(value)[np.ndim(value) - body._axes.get(name, 0) :]
            parts[name] = np.broadcast_to(value, (*batch, *own))[index]
    return body._with_parts(parts)


def same(first, second):
    for one, other in zip(first, second, strict=True):
        assert one.shape == other.shape
        np.testing.assert_array_equal(one, other)


# Runs with poles, NaN, overflow and steps of all sizes: every branch of every kernel of steps.
def hard(rng, kind):
    body, omega, eps = sample(rng, kind, (SIZE,), (SIZE,), (SIZE,))
    omega[3, 0], eps[4], omega[7::9] = np.nan, 0.0, omega[7::9] * 1e4
    if kind == "Suslov3D 0":  # poles of the unit body, after none, one and two steps
        values = {name: np.array(each) for name, each in body.parameters.items()}
        for each, value in zip(values.values(), (1, 1, 1, 0), strict=True):
            each[11:14] = value
        body, eps[11:14], omega[11:14] = sf.Suslov3D(**values), 1.0, [1.0, -3.0]
        for k in (12, 13, 13):
            omega[k] = sf.step(sf.Suslov3D(1, 1, 1, 0), omega[k], -1.0)
    return body, omega, eps


OPTIONS = [
    *((kind, {"method": method}) for kind in KINDS for method in RECORDS[kind].methods),
    *((kind, {"attitude": True}) for kind in KINDS if has(kind, "iterate: attitude")),
]
