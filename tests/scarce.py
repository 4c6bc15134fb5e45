"""Check that runs under decreasing limits of the address space succeed or raise MemoryError.

python scarce.py NUMBER_OF_PROBLEM THREADS
"""

import resource
import sys
from pathlib import Path

import numpy as np

import suslov_fast as sf

chance = np.random.default_rng(1)
BODY = sf.Suslov3D(4, 1, -0.5, -0.3)
MIB = 2**20
RESULTS = ("omega", "final", "status", "failed_at")


def three(size, steps, **options):
    omega = chance.uniform(-2, 2, (size, 2))
    return lambda threads: sf.iterate(BODY, omega, 0.2, steps, threads=threads, **options)


def many(m, size, steps, **options):
    body = sf.SuslovND(np.ones(m), np.ones(m) / m)
    omega = np.full((size, m), 19.98)
    return lambda threads: sf.iterate(body, omega, 0.1, steps, threads=threads, **options)


PROBLEMS = {
    "3D, all states": three(100_000, 60),
    "3D, last states": three(1_000_000, 40, save_every=None, method="canonical"),
    "3D, closed form": three(1_000_000, 40, save_every=None),
    "3D, as printed": three(100_000, 60, method="ds2"),
    "n = 9, all states": many(8, 20_000, 60),
    "n = 201, elimination": many(200, 17, 2, method="gauss"),
    "n = 201": many(200, 300, 2),
}


def check(run, name, threads):
    """Run under a limit of the address space, which a bisection moves to the last allocation."""
    expected = run(threads)
    needed = sum(getattr(expected, what).nbytes for what in RESULTS)

    def succeeds(room):
        """Return True if the run gives the right states, and False if it raises MemoryError."""
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        limit(used + room)
        try:
            result = run(threads)
        except MemoryError:
            return False
        finally:
            limit(resource.RLIM_INFINITY)
        for what in RESULTS:
            np.testing.assert_array_equal(getattr(result, what), getattr(expected, what))
        return True

    low, high = 0, 8 * needed + 64 * MIB
    outcomes = [succeeds(int(room)) for room in np.linspace(MIB, high, 12)]
    while high - low > 4096:
        middle = (low + high) // 2
        outcomes.append(succeeds(middle))
        low, high = (low, middle) if outcomes[-1] else (middle, high)
    outcomes += [succeeds(max(high - k * 16384, 4096)) for k in range(20)]
    assert min(outcomes.count(True), outcomes.count(False)) > 1, (name, outcomes)


def limit(nbytes):
    resource.setrlimit(resource.RLIMIT_AS, (nbytes, resource.RLIM_INFINITY))


if __name__ == "__main__":
    number, threads = map(int, sys.argv[1:])
    name, run = list(PROBLEMS.items())[number]
    check(run, name, threads)
