"""The work of a case: calls of one size, and their error against long doubles.

Each function here returns the `make` of a case for a call of this package or of a peer.
"""

import importlib
import warnings
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
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
    random_states,
    relative_error,
    starts,
)

import suslov_fast


class Work(NamedTuple):
    """A call, its units of work, and a function that returns its error."""

    call: Callable[[], object]
    work: int
    error: Callable[[], float] | None = None


class Case(NamedTuple):
    """One benchmark, before any memory is allocated.

    `make` takes a function `size(full, small)`, which chooses the size of a problem, and the number
    of threads. `limit` is a limit of the machine and the amount of it that a unit of work needs. A
    call may take `at_most` times as long as in the revision it is compared with.
    """

    table: str
    key: str
    label: str
    make: Callable[[Callable[[int, int], int], int], Work]
    x: float | None = None
    limit: tuple[str, float] | None = None
    whose: str = "this package"
    at_most: float = 1.2
    quick: bool = False  # measured by `compare.py --quick`
    threads: str = "all"  # or "one" or "both"
    once: bool = False  # slow: measured once, in the first pass only

    @property
    def name(self):
        return "-".join(str(each) for each in (self.table, self.key, self.x) if each is not None)


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
        checked = size(STEPS, 20)

        def error():
            computed = call(starts(CHECKED), checked, threads)
            return relative_error(computed, orbit(CHECKED, checked)[-1])

        return Work(lambda: call(omega0, n, threads), len(omega0) * n, error)

    return make


def saved_states(function, batch=65_536, saved=257, every=1, memory="reused"):
    """Saved states by a function of (omega0, steps, threads, out), and `every` if it exceeds 1."""

    def make(size, threads):
        call = load(function)
        omega0 = starts(size(batch, max(64, batch % 64)) if batch >= 64 else batch)
        rows, between = size(saved, 9), size(every, 10)
        shape, offset = (rows, *omega0.shape), 2 * (memory == "unaligned")
        out = None if memory == "new" else aligned(shape, offset)
        more, steps = {"every": between} if every > 1 else {}, (rows - 1) * between

        def error():
            few = size(STEPS, 20) // between * between
            room = aligned((few // between + 1, CHECKED, 2))
            computed = call(starts(CHECKED), few, threads, room, **more)
            return relative_error(computed, orbit(CHECKED, few)[::between])

        work = rows * len(omega0)
        run = lambda: call(omega0, steps, threads, out, **more)  # noqa: E731
        return Work(run, work, error if every <= STEPS else None)

    return make


def jumps(function, batch, numbers, checked=False):
    """States n by a function of (omega0, n); `numbers(size)` returns n."""

    def make(size, threads):
        call, omega0, n = load(function), starts(size(batch, 16)), numbers(size)

        def error():
            return relative_error(call(starts(CHECKED), STEPS), orbit(CHECKED, STEPS)[-1])

        work = len(omega0) * np.size(n)
        return Work(lambda: call(omega0, n), work, error if checked else None)

    return make


def motions(function, batch):
    """States at the time of `STEPS` steps by a function of (omega0, time, threads)."""

    def make(size, threads):
        call, omega0, time = load(function), starts(size(batch, 2)), EPS * size(STEPS, 20)
        few = starts(min(CHECKED, len(omega0)))

        def error():
            return relative_error(call(few, time, threads), motion(len(few), time))

        return Work(lambda: call(omega0, time, threads), len(omega0), error)

    return make


def dimensions(function, components, cubic, slow=False):
    """Some milliseconds of steps in n dimensions by a function of (body, omega0, eps, steps)."""

    def make(size, threads):
        call = load(function)
        body, omega0 = problem_nd(components, size(512, 16))
        steps = size(max(3, 4000 // components ** (2 if cubic else 1)), 3)
        if slow:
            steps, omega0 = min(steps, max(1, 64 // components)), omega0[: 4096 // components]

        def error():
            computed = call(body, problem_nd(components, CHECKED_ND)[1], EPS / 2, STEPS_ND)
            return relative_error(computed, orbit_nd(components))

        return Work(lambda: call(body, omega0, EPS / 2, steps), len(omega0) * steps, error)

    return make


def quantities(function, name):
    """A quantity of ten million states, into new memory, by a function of states."""

    def make(size, threads):
        states, known = random_states(size(10_000_000, 1000)), getattr(PRECISE, name, None)

        def error():
            few = random_states(CHECKED)
            wanted = np.atleast_2d(known(*few.T.astype(np.longdouble)))
            return relative_error(function(few).reshape(CHECKED, -1), wanted.T)

        return Work(lambda: function(states), len(states), error if known else None)

    return make


def orientations(what, n):
    """Orientations of 4096 bodies along 100 steps, or Lyapunov exponents of their orbits."""

    def make(size, threads):
        batch, steps = size(4096, 16), size(100, 5)
        body, omega0 = (BODY, starts(batch)) if n == 3 else problem_nd(n - 1, batch)
        eps, iterate = EPS / 2, suslov_fast.iterate
        states = iterate(body, omega0, eps, steps).omega if what == "along" else None
        call = {
            "last": lambda: iterate(body, omega0, eps, steps, save_every=None, attitude=True),
            "all": lambda: iterate(body, omega0, eps, steps, attitude=True),
            "along": lambda: suslov_fast.attitude(body, states, eps),
            "exponents": lambda: suslov_fast.lyapunov_exponents(body, omega0, eps, steps),
        }[what]
        return Work(call, batch * steps)

    return make
