"""Threads, forks, Ctrl-C and progress."""

import os
import sys
import textwrap
import time
from itertools import count

import children
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast.core.numba import threads as core_threads
from suslov_fast.maps import batch

AT_ONCE = """
import sys
from concurrent.futures import ThreadPoolExecutor
with ThreadPoolExecutor(8) as pool:
    results = list(pool.map(lambda _: run(), range(int(sys.argv[1]))))
assert all((result == expected).all() for result in results)
"""
FORKS = """
import os, sys, threading, warnings
warnings.simplefilter("ignore", DeprecationWarning)
child = os.fork()
if child == 0:  # before its parent has threads, which children would be without
    os._exit(sf._threads_are_gone)
assert os.waitpid(child, 0)[1] == 0
assert (run() == expected).all()
stop = threading.Event()
def compute():
    while not stop.is_set():
        run()
thread = threading.Thread(target=compute)
thread.start()
for _ in range(int(sys.argv[1])):
    child = os.fork()
    if child == 0:
        os._exit(0 if (run() == expected).all() else 1)
    assert os.waitpid(child, 0)[1] == 0
stop.set()
thread.join()
"""


# What is called: `run`, of which all results equal `expected`.
IMPORTS = """
import atexit, itertools, multiprocessing, os, sys, threading, warnings
import numba, numpy as np, suslov_fast as sf
warnings.simplefilter("ignore", DeprecationWarning)
"""
FIELDS = f"""{IMPORTS}
x = np.random.default_rng(1).uniform(-1, 1, (9000, 3))
def run(n=1, **options):
    field = sf.Field.from_terms(np.eye(3)[:, :, None] * np.ones(3) / 100, -n * np.eye(3))
    return sf.iterate(field, x, 0.01, 500, save_every=None, **options).final
expected = run(1, threads=1)
"""
COMPILES = f"""{IMPORTS}
numbers, expected = itertools.count(1), np.ones(1)
def run():
    c = float(next(numbers))
    return sf.flow(sf.Field(lambda x: (-c * (x[0] - 1),), 1), [1.0], time=1.0).final
run()
"""
AT_EXIT = """
def compute():
    assert (run(1, threads=2) == expected).all()
    print("done")
atexit.register(compute)
thread = threading.Thread(target=lambda: (threading.main_thread().join(), compute()))
thread.start()
"""
# The parent starts threads of its own, and calls nothing of the package.
PRANGE = f"""{IMPORTS}
@numba.njit(parallel=True)
def threads(x):
    t = 0.0
    for i in numba.prange(x.size):
        t += x[i]
    return t
assert threads(np.ones(100)) == 100
"""
POOL = """
def work(k):
    body = sf.Suslov3D(4, 1, -0.5, -0.3)
    starts = np.random.default_rng(3).uniform(-2, 2, (40000, 2))
    return sf.iterate(body, starts, 0.2, 60, save_every=None).final.sum()
with multiprocessing.get_context("fork").Pool(2) as pool:
    assert {*pool.map(work, range(4))} == {work(0)}
print("done")
"""
# What is called, from where, by which threads of Numba, and what is printed.
PROCESSES = {
    "bodies at once, tbb": (children.SETUP, AT_ONCE, "tbb", ""),
    "bodies at once, workqueue": (children.SETUP, AT_ONCE, "workqueue", ""),
    "bodies in forks, tbb": (children.SETUP, FORKS, "tbb", ""),
    "bodies in forks, omp": (children.SETUP, FORKS, "omp", ""),
    "fields in forks, omp": (FIELDS, FORKS, "omp", ""),  # of which Numba takes no part
    # The lock of the compiler, which the thread had, was held without end in the child.
    "forks while a thread compiles": (COMPILES, FORKS, None, ""),
    # Threads of Python cannot be started any more.
    "fields at exit": (FIELDS, AT_EXIT, None, "done done"),
    "fields at exit, after a call": (f"{FIELDS}run(1, threads=2)", AT_EXIT, None, "done done"),
    "a parent with threads of others": (PRANGE, POOL, "omp", "done"),
}


@pytest.mark.compiled
@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.parametrize("name", PROCESSES)
def test_threads_forks_and_ends(name):
    """None aborts or hangs, and all find the same bits."""
    setup, code, layer, output = PROCESSES[name]
    environment = children.layer(layer) if layer else {}
    printed = children.run(setup + code, 12, timeout=540, **environment)
    if layer != "tbb":  # which prints at forks
        assert printed.split() == output.split()


class Work:
    """Counts the parts that threads are taking, and those that are done."""

    def __init__(self):
        self.inside, self.done, self.abandoned = [], [], []

    def __call__(self, part):
        if not self.abandoned:
            self.inside.append(part)
            time.sleep(1e-4)
            self.done.append(part)
            self.inside.remove(part)


def check_parts():
    work = Work()
    core_threads.in_parts(5, work, work.abandoned, 3)
    assert sorted(work.done) == [0, 1, 2, 3, 4]


def test_ctrl_c_at_each_place_of_a_call_in_parts():
    """No thread works on, and no lock is taken.

    Python handles signals where functions begin, and after calls.
    """
    check_parts()
    interrupted, place = True, 0
    while interrupted:
        work, events, place, interrupted = Work(), count(), place + 1, False

        def interrupt(frame, event, argument, place=place, events=events):
            is_place = event in ("call", "c_return")
            is_place &= frame.f_code.co_filename == core_threads.__file__
            if is_place and next(events) == place:
                raise KeyboardInterrupt

        try:
            sys.setprofile(interrupt)
            core_threads.in_parts(3, work, work.abandoned, 3)
        except KeyboardInterrupt:
            interrupted = True
        finally:
            sys.setprofile(None)
        assert not work.inside
        check_parts()
    assert place > 5


def test_motions_take_the_threads_asked_for(monkeypatch):
    started, start = [], core_threads.start_new_thread
    monkeypatch.setattr(
        core_threads, "start_new_thread", lambda *own: started.append(own) or start(*own)
    )
    field = sf.Field(lambda x: (x[1], -np.sin(x[0])), "x v")
    x0 = np.linspace((0.1, 0.0), (1.0, 0.5), 4096)
    sf.flow(field, x0, time=0.01, rtol=1e-3, threads=children.TWO_THREADS)
    assert len(started) == (children.TWO_THREADS is not None)


@pytest.mark.slow
def test_ctrl_c():
    """Ctrl-C ends a long run at the next return to Python; a chunk has a bounded number of steps.

    A step of the map of a body takes about a nanosecond, one of a field ten.
    """
    code = """
        import os, signal, threading
        turn = sf.Field(lambda x: (x[1], -x[0] * x[1] - x[0]), 2)
        for kind, size, save_every in ((body, 1, None), (body, 2000, 2 * 10**9), (turn, 70, None)):
            seen, before = [0], []

            def interrupt():
                before.append(len(seen))
                os.kill(os.getpid(), signal.SIGINT)

            def progress(done, total):
                seen.append(done)
                if len(seen) == 6:
                    threading.Thread(target=interrupt).start()

            try:
                sf.iterate(kind, np.ones((size, 2)), 0.2, 10**13, save_every=save_every,
                           progress=progress)
            except KeyboardInterrupt:
                print(len(seen) - before[0], max(np.diff(seen)) * max(size, 10))
    """
    lines = children.run(children.SETUP + textwrap.dedent(code)).splitlines()
    assert len(lines) == 3
    for line in lines:
        returns, steps = map(int, line.split())
        assert returns <= 2
        assert steps < 2**29


@pytest.mark.compiled
def test_the_bar_of_progress(body, capsys, monkeypatch):
    for name in ("WORK_OF_CHUNK", "WORK_OF_CHUNK_WITH_TURNS"):
        monkeypatch.setattr(batch, name, 2**8)
    omega = np.ones((70, 2))
    sf.iterate(body, [1, 0.5], 0.2, 10, progress=True)
    assert "10.0/10.0" in capsys.readouterr().err
    call = batch.call_kernel
    calls = iter([call, call])
    monkeypatch.setattr(
        batch, "call_kernel", lambda *given, **options: next(calls)(*given, **options)
    )
    with pytest.raises(StopIteration) as held:  # as Ctrl-C, whose traceback a notebook holds
        sf.iterate(body, omega, 0.2, 700, progress=True)
    assert capsys.readouterr().err.endswith("\n"), "the bar is closed"
    assert held
