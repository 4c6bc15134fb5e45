"""A benchmark, and its work: calls of one size, and their error.

Each function below makes the work of one kind, for a function of this package or of a peer. Its
last argument `size(full, small)` returns `full` if the work is timed, and `small` in a test. The
reference of errors is computed in long doubles; in n dimensions and for fields by NumPy.
"""

import functools
import importlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import problem
from formulas import EPS
from problem import CHECKED, STEPS, aligned, starts

import suslov_fast

try:
    from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
except ImportError:  # Windows
    getrusage = None

# Tables of motions at equal error, on one thread, in processor time. They have a file of their
# own, because they are measured more often than the other tables.
MOTIONS = (
    *("orders", "one motion", "more motions", "inside"),
    *("lattices", "stiff motions", "changes"),
)
# What `conftest` sets for peers that use NumPy in its own process.
ONE_THREAD = "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"
OURS, C, NUMPY, OTHERS, MACHINE = "this package", "C", "NumPy", "others", "the machine"


def cpu_seconds():
    """Seconds of processor time of this process and of those that it waited for."""
    if getrusage is None:
        return time.perf_counter()
    used = [getrusage(RUSAGE_SELF), getrusage(RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


class Work(NamedTuple):
    """A call, its units of work, and a function that returns computed and reference values."""

    call: Callable[[], object]
    units: int = 1
    unit: str = "call"  # what one of them is
    check: Callable[[], tuple] | None = None


@dataclass(frozen=True)
class Case:
    """One benchmark, before any memory is allocated: `make(size)` returns its work.

    `limit` is the name of a limit of the machine, and how much of it a unit of work needs.
    """

    table: str
    key: str
    whose: str
    label: str
    make: Callable[[Callable[[int, int], int]], Work]
    x: float | str | None = None
    limit: tuple[str, float] | None = None
    one_thread: bool = False

    @property
    def name(self):
        """Name without blanks and commas, the same on every machine."""
        x = "" if self.x is None else f"-{self.x}"
        return f"{self.table}-{self.key}{x}".replace(" ", "_").replace(",", "")

    @property
    def is_slow(self):
        """True if the work compiles everything: it is measured once, without a call before."""
        return self.key.endswith("-first")

    @property
    def clock(self):
        """The clock of the case: processor time, with child processes if any, or wall time."""
        if self.table in MOTIONS:
            return time.process_time
        is_cpu = self.table == "processes" or self.key.endswith("-cpu")
        return cpu_seconds if is_cpu else time.perf_counter


def load(function):
    """Return a function, or import a peer's "module.name"; ImportError without its library."""
    if callable(function):
        return function
    module, name = function.split(".")
    return getattr(importlib.import_module(f"peers.{module}"), name)


def last_states(function, batch, steps, size):
    """Last states by a function of (omega0, steps)."""
    call, omega0, n = load(function), starts(size(batch, 64)), size(steps, 20)
    far = size(STEPS, 20)
    check = lambda: (call(starts(CHECKED), far), problem.orbit(far)[-1])  # noqa: E731
    return Work(lambda: call(omega0, n), len(omega0) * n, "step", check)


def saved_states(function, batch, rows, every, memory, size):
    """Saved states by a function of (omega0, steps, every, out), with new memory or used one."""
    call = load(function)
    omega0 = starts(size(batch, max(64, batch % 64)) if batch >= 64 else batch)
    rows, every, few = size(rows, 9), size(every, 10), size(STEPS, 20)
    room = aligned((few // every + 1, CHECKED, 2))
    out = None if memory == "new" else aligned((rows, *omega0.shape))
    check = lambda: (call(starts(CHECKED), few, every, room), problem.orbit(few)[::every])  # noqa: E731
    states = rows * len(omega0)
    return Work(lambda: call(omega0, (rows - 1) * every, every, out), states, "state", check)


def jumps(function, batch, numbers, size):
    """States n by a function of (omega0, n); numbers(size) returns n."""
    call, omega0, n = load(function), starts(size(batch, 16)), numbers(size)
    check = lambda: (call(starts(CHECKED), STEPS), problem.orbit(STEPS)[-1])  # noqa: E731
    return Work(lambda: call(omega0, n), len(omega0) * np.size(n), "state", check)


def motions(function, batch, size):
    """States at the time of STEPS steps by a function of (omega0, time)."""
    call, omega0, time = load(function), starts(size(batch, 2)), EPS * size(STEPS, 20)
    few = omega0[:CHECKED]

    def check():
        wanted = problem.PRECISE.flow(*few.T.astype(np.longdouble), np.longdouble(time))
        return call(few, time), np.stack(wanted, axis=-1)

    return Work(lambda: call(omega0, time), len(omega0), "trajectory", check)


def dimensions(function, components, part, size):
    """Some milliseconds of steps in n dimensions by a function of (body, omega0, eps, steps)."""
    call, body, by_numpy = load(function), problem.body_nd(components), load("numpy_batch.solve")
    omega0, few = (problem.starts_nd(batch, components) for batch in (size(512, 16), 8))
    steps = size(max(1, 4096 // components // part), 3)
    check = lambda: tuple(each(body, few, EPS / 2, 5) for each in (call, by_numpy))  # noqa: E731
    work = len(omega0) * steps
    return Work(lambda: call(body, omega0, EPS / 2, steps), work, "step", check)


def fields(function, field, batch, steps, reference, size):
    """Steps of Kahan's map of a quadratic field by a function of (field, x, steps).

    `reference` is another such function, or None if `function` does not return states.
    """
    call, field = load(function), field()
    x = problem.starts_field(size(batch, 32) if batch > 8 else batch, field.dimension)
    few, steps = problem.starts_field(8, field.dimension), size(steps, 2)
    checked = reference is not None
    check = lambda: tuple(each(field, few, 5) for each in (call, load(reference)))  # noqa: E731
    return Work(lambda: call(field, x, steps), len(x) * steps, "step", check if checked else None)


def own_maps(function, name, batch, steps, size):
    """Steps of a map of one's own by a function of (f, x, steps)."""
    call, f = load(function), problem.OWN_MAPS[name]
    x = problem.starts(size(batch, 32), 2, 0.0, 0.1)

    def by_numpy(x, steps):
        for _ in range(steps):
            x = np.stack(f(x.T), axis=-1)
        return x

    check = lambda: (call(f, x[:8], 5), by_numpy(x[:8], 5))  # noqa: E731
    steps = size(steps, 2)
    return Work(lambda: call(f, x, steps), len(x) * steps, "step", check)


def saved_states_of_field(D, batch, rows, size):
    """All states of a field."""
    field, eps = problem.sparse_field(D), problem.EPS_FIELD
    x, rows = problem.starts_field(size(batch, 32), D), size(rows, 5)
    call = lambda: suslov_fast.iterate(field, x, eps, rows - 1).states  # noqa: E731
    return Work(call, rows * len(x), "state")


TIME_OF_MOTIONS = 20.0


@functools.cache
def motions_of_henon_heiles():
    """Starts and their states at this time: by order 8, whose error is rounding."""
    x = problem.starts_field(1024, 4)
    return x, by_order("order8", 1000)(x)


def by_order(method, count):
    """A function that takes so many steps of a method, on one thread."""
    options = {"save_every": None, "method": method, "threads": 1}
    run = problem.sparse_field(4), TIME_OF_MOTIONS / count, count
    return lambda x: suslov_fast.iterate(run[0], x, *run[1:], **options).final


def by_flow(tolerance):
    """A function of starts, by `flow` with a tolerance, on one thread."""
    run = problem.sparse_field(4), TIME_OF_MOTIONS
    return lambda x: suslov_fast.flow(run[0], x, time=run[1], rtol=tolerance, threads=1).states[0]


def at_equal_error(function, argument, below, size):
    """Return work: motions of Hénon and Heiles with an error below a bound.

    `function(*argument)` makes a function of starts. The check compares the ratio of error and
    bound, if it exceeds 1, with 1.
    """
    call = load(function)(*argument)
    x, wanted = motions_of_henon_heiles()
    some = x[: size(len(x), 32)]

    def check():
        error = abs(call(some) - wanted[: len(some)]).max()
        return np.array([max(error / below, 1.0)]), np.ones(1)

    return Work(lambda: call(some), len(some), "trajectory", check)


def processes(codes, fresh, size):
    """Return work: processes with this package one by one, with empty caches if `fresh`.

    Threads of linear algebra are not limited in these processes, as users do not limit them.
    """
    tree = Path(suslov_fast.__path__[0]).parent
    settings = {"PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": ""}
    given = {name: value for name, value in os.environ.items() if name not in ONE_THREAD}

    def call():
        with tempfile.TemporaryDirectory() as folder:
            more = {"NUMBA_CACHE_DIR": folder} if fresh else {}
            options = {"env": given | settings | more, "cwd": folder, "check": True}
            for code in codes if size(1, 0) else ["pass"]:  # a test needs no more
                subprocess.run([sys.executable, "-c", code], stdout=subprocess.DEVNULL, **options)

    return Work(call, unit="process")
