"""The work of a case: calls of one size, and their error against long doubles.

Each function here returns the `make` of a case for a call of this package or of a peer.
"""

import importlib
import warnings
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import problem
from problem import BODY, CHECKED, EPS, STEPS, aligned, problem_nd, starts

import suslov_fast


class Work(NamedTuple):
    """A call, its units of work, and a function that returns computed and reference values."""

    call: Callable[[], object]
    work: int
    check: Callable[[], tuple] | None = None


class Case(NamedTuple):
    """One benchmark, before any memory is allocated.

    `make` takes a function `size(full, small)`, which chooses the size of a problem, and the number
    of threads. `limit` is a limit of the machine and the amount of it that a unit of work needs.
    A slow peer does one `part`-th of the work of its group.
    """

    table: str
    key: str
    label: str
    make: Callable[[Callable[[int, int], int], int], Work]
    x: float | None = None
    limit: tuple[str, float] | None = None
    whose: str = "this package"
    threads: str = "all"  # or "one" or "both"
    once: bool = False  # measured once in each pass
    slow: bool = False  # measured once, without a call before, and by the report only
    part: int = 1

    @property
    def name(self):
        """Name without blanks, the same on every machine."""
        numpy = "numpy" if self.whose == "NumPy" and "numpy" not in self.key else None
        part = f"1_in_{self.part}" if self.part > 1 else None
        return joined(self.table, self.key, numpy, self.x, part)

    @property
    def group(self):
        """Name of the cases that answer the same question."""
        of_key = self.table in ("jumps", "quantities")
        return joined(self.table, self.key if of_key else self.x)


def joined(*words):
    """Join words, of which some may be None, to a name without blanks."""
    found = (str(each) for each in words if each is not None)
    return "-".join(each.replace(",", "").replace(" ", "_") for each in found)


def load(function):
    """Return a function, or import a peer's "module.name"; ImportError without its library."""
    if callable(function):
        return function
    module, name = function.split(".")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings of imported libraries
        return getattr(importlib.import_module(f"peers.{module}"), name)


def last_states(function, batch=65_536, steps=STEPS):
    """Last states by a function of (omega0, steps, threads)."""

    def make(size, threads):
        call, omega0, n = load(function), starts(size(batch, 64)), size(steps, 20)
        few, last = starts(CHECKED), size(STEPS, 20)
        return Work(
            lambda: call(omega0, n, threads),
            len(omega0) * n,
            lambda: (call(few, last, threads), problem.orbit(CHECKED, last)[-1]),
        )

    return make


def saved_states(function, batch=65_536, saved=257, every=1, memory="reused"):
    """Saved states by a function of (omega0, steps, threads, out), and `every` if it exceeds 1."""

    def make(size, threads):
        call = load(function)
        omega0 = starts(size(batch, max(64, batch % 64)) if batch >= 64 else batch)
        rows, between = size(saved, 9), size(every, 10)
        out = None
        if memory != "new":
            out = aligned((rows, *omega0.shape), offset=2 * (memory == "unaligned"))
        more, steps = {"every": between} if every > 1 else {}, (rows - 1) * between

        def check():
            few = size(STEPS, 20) // between * between
            room = aligned((few // between + 1, CHECKED, 2))
            computed = call(starts(CHECKED), few, threads, room, **more)
            return computed, problem.orbit(CHECKED, few)[::between]

        run = lambda: call(omega0, steps, threads, out, **more)  # noqa: E731
        return Work(run, rows * len(omega0), check if every <= STEPS else None)

    return make


def jumps(function, batch, numbers, checked=False):
    """States n by a function of (omega0, n); `numbers(size)` returns n."""

    def make(size, threads):
        call, omega0, n = load(function), starts(size(batch, 16)), numbers(size)
        check = lambda: (call(starts(CHECKED), STEPS), problem.orbit(CHECKED, STEPS)[-1])  # noqa: E731
        work = len(omega0) * np.size(n)
        return Work(lambda: call(omega0, n), work, check if checked else None)

    return make


def motions(function, batch):
    """States at the time of `STEPS` steps by a function of (omega0, time, threads)."""

    def make(size, threads):
        call, omega0, time = load(function), starts(size(batch, 2)), EPS * size(STEPS, 20)
        few = omega0[:CHECKED]
        return Work(
            lambda: call(omega0, time, threads),
            len(omega0),
            lambda: (call(few, time, threads), problem.motion(len(few), time)),
        )

    return make


def dimensions(function, components, part=1, batch=512):
    """Some milliseconds of steps in n dimensions by a function of (body, omega0, eps, steps)."""

    def make(size, threads):
        call = load(function)
        body, omega0 = problem_nd(components, size(batch, 16))
        steps = size(4096 // components // part, 3)
        few = problem_nd(components, problem.CHECKED_ND)[1]
        return Work(
            lambda: call(body, omega0, EPS / 2, steps),
            len(omega0) * steps,
            lambda: (call(body, few, EPS / 2, problem.STEPS_ND), problem.orbit_nd(components)),
        )

    return make


def fields(function, components, steps):
    """Last states of Kahan's map of a quadratic field by a function of (x, steps, threads)."""

    def make(size, threads):
        call, peer = load(function), load("fields.in_numpy")
        _, x = problem.field_and_states(components, size(49_152 // components, 32))
        few, count = x[: problem.CHECKED_ND], size(steps, 2)
        return Work(
            lambda: call(x, count, threads),
            len(x) * count,
            lambda: (call(few, problem.STEPS_ND, threads), peer(few, problem.STEPS_ND, threads)),
        )

    return make


def quantities(function, name):
    """A quantity of ten million states, into new memory, by a function of states."""

    def make(size, threads):
        states = problem.random_states(size(10_000_000, 1000))
        known = getattr(problem.PRECISE, name, None)

        def check():
            few = problem.random_states(CHECKED)
            wanted = np.atleast_2d(known(*few.T.astype(np.longdouble)))
            return function(few).reshape(CHECKED, -1), wanted.T

        return Work(lambda: function(states), len(states), check if known else None)

    return make


def orientations(what, n):
    """Orientations of 4096 bodies along 100 steps, or Lyapunov exponents of their orbits."""

    def make(size, threads):
        batch, steps = size(4096, 16), size(100, 5)
        body, omega0 = (BODY, starts(batch)) if n == 3 else problem_nd(n - 1, batch)
        problem_and_steps, iterate = (body, omega0, EPS / 2, steps), suslov_fast.iterate
        states = iterate(*problem_and_steps).omega if what == "along" else None
        call = {
            "last": lambda: iterate(*problem_and_steps, save_every=None, attitude=True),
            "all": lambda: iterate(*problem_and_steps, attitude=True),
            "along": lambda: suslov_fast.attitude(body, states, EPS / 2),
            "exponents": lambda: suslov_fast.lyapunov_exponents(*problem_and_steps),
        }[what]
        return Work(call, batch * steps)

    return make
