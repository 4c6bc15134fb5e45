"""Arrays between pages that no program may touch, and a script that gives them to all loops.

Indices that are checked are those of Python and Numba; what is written by hand for vectors, or
past the caches, is not. Here one byte too many ends the process.

    python guard.py begin|end THREADS     (at which end arrays touch the forbidden page)
"""

import ctypes
import mmap
import sys

import numpy as np

import suslov_fast as sf
from suslov_fast._engine import threads

PAGE = mmap.PAGESIZE
_protect = ctypes.CDLL(None, use_errno=True).mprotect
_protect.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)


def guarded(nbytes, at_end):
    """So many bytes, the first behind a forbidden page or the last before one."""
    pages = -(-nbytes // PAGE) * PAGE
    memory = np.frombuffer(mmap.mmap(-1, pages + 2 * PAGE), np.uint8)
    for page in (0, pages + PAGE):
        if _protect(memory.ctypes.data + page, PAGE, 0):
            raise OSError(ctypes.get_errno(), "mprotect")
    begin = PAGE + (pages - nbytes if at_end else 0)
    return memory[begin : begin + nbytes]


def empty(shape, at_end):
    return guarded(8 * int(np.prod(shape)), at_end).view(np.float64).reshape(shape)


class Guards:
    """Guarded copies of the arguments of one call; arrays that share memory go on sharing it."""

    def __init__(self, at_end):
        self.at_end = at_end
        self.copies = []  # (address, original bytes, guarded bytes)

    def take(self, arguments):
        for array in sorted(_arrays(arguments), key=lambda array: -array.nbytes):
            low, high = _bounds(array)
            if high > low and self._find(low, high) is None:
                original = np.frombuffer(
                    (ctypes.c_uint8 * (high - low)).from_address(low), np.uint8
                )
                copy = guarded(high - low, self.at_end)
                copy[:] = original
                self.copies.append((low, original, copy))
        return self._swap(arguments)

    def give_back(self):
        for _, original, copy in self.copies:
            changed = original != copy  # what was not written may be read-only
            if changed.any():
                original[changed] = copy[changed]

    def _find(self, low, high):
        for begin, original, copy in self.copies:
            if begin <= low and high <= begin + len(original):
                return copy, low - begin
            assert high <= begin or begin + len(original) <= low, "arguments overlap in part"
        return None

    def _swap(self, argument):
        if isinstance(argument, tuple):
            parts = [self._swap(each) for each in argument]
            return type(argument)(*parts) if hasattr(argument, "_fields") else tuple(parts)
        if not isinstance(argument, np.ndarray) or not argument.size:
            return argument
        copy, offset = self._find(*_bounds(argument))
        twin = np.ndarray(
            argument.shape, argument.dtype, copy, offset + _lead(argument), argument.strides
        )
        twin.flags.writeable = argument.flags.writeable
        return twin


def _arrays(argument):
    if isinstance(argument, tuple):
        for each in argument:
            yield from _arrays(each)
    elif isinstance(argument, np.ndarray) and argument.size:
        yield argument


def _lead(array):
    """Bytes before the first element, where a stride is negative."""
    return -sum((n - 1) * s for n, s in zip(array.shape, array.strides, strict=True) if s < 0)


def _bounds(array):
    low = array.ctypes.data - _lead(array)
    reach = sum((n - 1) * abs(s) for n, s in zip(array.shape, array.strides, strict=True))
    return low, low + reach + array.itemsize


def guard_all_loops(at_end):
    """From now on each loop gets guarded arguments, and uses threads however small the work."""
    plain, threads.CROSSOVER = threads.run, 0

    def run(loop, work, count, *arguments):
        guards = Guards(at_end)
        plain(loop, max(work, 0), count, *guards.take(arguments))
        guards.give_back()

    threads.run = run


def problems():
    """Bodies, states and step sizes of all kinds: (name, body, omega, eps)."""
    chance = np.random.default_rng(1)
    one = sf.Suslov3D(4, 1, -0.5, -0.3)
    for size in (1, 2, 7, 8, 9, 127, 128, 129, 300):
        omega = chance.uniform(-2, 2, (size, 2))
        yield f"3D, {size}", one, omega, 0.2
        omega = chance.uniform(-30, 30, (size, 2))  # among them some that meet poles
        shape = chance.uniform(0.5, 2, size)
        yield f"3D, {size} bodies", sf.Suslov3D(4 * shape, shape, -0.5, -0.3), omega, 0.2 * shape
    for m in (2, 3, 4, 7, 8, 9):
        body = sf.SuslovND(np.linspace(1, 2, m), np.linspace(0.1, 0.3, m))
        for size in (1, 3, 8, 9, 130):
            yield f"n = {m + 1}, {size}", body, chance.uniform(-1, 1, (size, m)), 0.1
        several = sf.SuslovND(chance.uniform(1, 2, (9, m)), chance.uniform(-0.3, 0.3, (9, m)))
        yield f"n = {m + 1}, 9 bodies", several, chance.uniform(-9, 9, (9, m)), np.full(9, 0.5)


def calls(body, omega, eps):
    """Public functions that come down to loops: (name, function of no arguments)."""
    in_3d = isinstance(body, sf.Suslov3D)
    for method in ("canonical", "ds2") if in_3d else ("gauss", "rank2"):
        for steps in (0, 1, 15, 16, 17, 70):
            for every in (1, 3, None):
                yield (
                    f"{method}, {steps} steps, every {every}",
                    lambda method=method, steps=steps, every=every: iterate(
                        body, omega, eps, steps, method=method, save_every=every
                    ),
                )
    yield "auto", lambda: iterate(body, omega, eps, 100, save_every=None)
    states = sf.iterate(body, omega, eps, 20, on_singular="ignore").omega
    yield "attitude", lambda: sf.attitude(body, states, eps)
    yield "energy", lambda: sf.energy(body, states)
    yield "modified_energy", lambda: sf.modified_energy(body, states, eps)
    yield "reaction", lambda: sf.reaction(body, omega)
    yield "vector_field", lambda: sf.vector_field(body, omega)
    yield "jacobian", lambda: sf.jacobian(body, omega, eps)
    if in_3d:
        for n in (3, 10**6, *(np.arange(k) - 5 for k in (0, 1, 7, 15, 16, 17, 4097))):
            yield f"exact, {np.size(n)}", lambda n=n: sf.exact(body, omega, eps, n)
            yield f"flow, {np.size(n)}", lambda n=n: sf.flow(body, omega, 0.1 * np.asarray(n))
        yield "criticality", lambda: sf.criticality(body, states, eps)
        yield "first_integral", lambda: sf.first_integral(body, states, eps)
        yield "to_xy", lambda: sf.to_xy(body, states)


def iterate(*arguments, **options):
    run = sf.iterate(*arguments, on_singular="ignore", **options)
    return np.concatenate([run.omega.ravel(), run.final.ravel(), run.status.ravel()])


def large(at_end):
    """Saved states that are written past the caches, into a guarded array of the user's."""
    body, chance = sf.Suslov3D(4, 1, -0.5, -0.3), np.random.default_rng(2)
    for size in (1037, 1088):  # as many states, so that both of the outer axes are equally long
        omega = chance.uniform(-2, 2, (size, 2))
        for every in (1, 2):
            out = empty((size, size, 2), at_end)
            yield (
                f"out, {size}, every {every}",
                lambda out=out, omega=omega, every=every: iterate(
                    body, omega, 0.2, every * (len(omega) - 1), save_every=every, out=out
                ),
            )
    in_nd = sf.SuslovND([1.3, 2.1, 3.7], [0.4, -0.7, 0.5])
    omega = chance.uniform(-2, 2, (1037, 3))
    out = empty((700, 1037, 3), at_end)
    yield "out, n = 4", lambda: iterate(in_nd, omega, 0.1, 699, out=out)


def main(end, count):
    import warnings

    warnings.simplefilter("ignore")
    at_end = end == "end"
    jobs = [
        (f"{problem}: {name}", call)
        for problem, body, omega, eps in problems()
        for name, call in calls(body, omega, eps)
    ]
    jobs += list(large(at_end))
    threads.numba.set_num_threads(int(count))
    expected = [call() for _, call in jobs]
    guard_all_loops(at_end)
    for (name, call), result in zip(jobs, expected, strict=True):
        print(name, flush=True)  # the last line tells which call was the end
        np.testing.assert_array_equal(call(), result)


if __name__ == "__main__":
    main(*sys.argv[1:])
