"""Threads, forks, Ctrl-C and progress."""

import os
import random
import signal
import textwrap
import threading

import children
import numba
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast._engine import threads
from suslov_fast._kernels import maps_3d as loops
from suslov_fast._kernels.blocks import LANES


def in_child(code, **environment):
    return children.run(children.SETUP + textwrap.dedent(code), **environment)


needs_two_threads = pytest.mark.skipif(
    numba.config.NUMBA_NUM_THREADS < 2, reason="needs two threads"
)
needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")


class Recorded:
    """A kernel that notes its calls, and does what it is given."""

    def __init__(self, action=lambda part: None):
        self.calls, self.action = [], action

    def compiled(self, part, parts, *arguments):
        self.calls.append((part, parts))
        self.action(part)


@needs_two_threads
def test_an_error_in_a_part(body, rng, monkeypatch):
    """It reaches the caller, whose next call has the requested number of parts again."""

    def fail(part):
        if part == 1:
            raise MemoryError

    big = rng.uniform(-2, 2, (3 * LANES, 2))
    for count in (2, None):
        failing = Recorded(fail)
        monkeypatch.setattr(loops.canonical, "compiled", failing.compiled)
        with pytest.raises(MemoryError):
            sf.iterate(body, big, 0.2, 4000, threads=count, method="canonical")
        assert (1, count or numba.config.NUMBA_NUM_THREADS) in failing.calls


@needs_two_threads
def test_the_number_of_threads():
    """Numba's own are not started to ask for it."""
    in_child(
        """
        import numba
        from suslov_fast._engine import threads
        assert (run() == expected).all()
        assert threads.available() == numba.config.NUMBA_NUM_THREADS == 2
        try:
            numba.threading_layer()
        except ValueError:
            numba.set_num_threads(1)
        assert threads.available() == 1
        """,
        NUMBA_NUM_THREADS="2",
    )


def test_little_work_takes_one_thread(body, monkeypatch):
    """A small batch, and a single block of lanes for any number of steps."""
    calls, kernel = [], loops.canonical.compiled

    def counting(part, parts, *arguments):
        calls.append(parts)
        kernel(part, parts, *arguments)

    monkeypatch.setattr(loops.canonical, "compiled", counting)
    sf.iterate(body, np.ones((LANES + 1, 2)), 0.2, 10, method="canonical")
    sf.iterate(body, np.ones((LANES, 2)), 0.2, 20_000, method="canonical")
    assert set(calls) == {1}


@pytest.mark.compiled
def test_python_threads_at_once():
    in_child(
        """
        from concurrent.futures import ThreadPoolExecutor
        with ThreadPoolExecutor(8) as pool:
            results = list(pool.map(lambda _: run(), range(64)))
        assert all((result == expected).all() for result in results)
        """
    )


@pytest.mark.compiled
def test_threads_with_small_stacks():
    code = """
        def calls():
            for method in "auto", "canonical":
                sf.iterate(body, omega, 0.2, 20, method=method)
            found.append(sf.flow(body, omega[:9], np.linspace(0, 9, 40)))

        import threading
        found = []
        calls()
        threading.stack_size(128 * 1024)
        thread = threading.Thread(target=calls)
        thread.start()
        thread.join()
        assert np.array_equal(*found)
    """
    in_child(code)


FORKS = """
import os, sys, threading, warnings
warnings.simplefilter("ignore", DeprecationWarning)
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
        right, count = (run() == expected).all(), threading.active_count()
        os._exit(0 if right and count == 2 else 1)
    assert os.waitpid(child, 0)[1] == 0
stop.set()
thread.join()
"""


@needs_fork
@pytest.mark.compiled
@pytest.mark.parametrize("count", [20, 500])
@pytest.mark.sampled(1)
def test_forks(count):
    """A child forked while another thread computes has threads, and neither aborts nor hangs."""
    children.run(children.SETUP + FORKS, count, timeout=1800, NUMBA_NUM_THREADS="2")


class Alarm(Exception):
    pass


def raise_alarm(signum, frame):
    raise Alarm


@needs_two_threads
@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs alarms")
def test_signals_at_random_moments():
    """Calls work wherever the handler of a signal raised, or made a call itself."""
    chance, kernel = random.Random(1), Recorded()
    nested = iter(range(1_000))

    def handler(signum, frame):
        if next(nested, None) is not None:
            threads.run(Recorded(), threads.CROSSOVER, 2)
        raise Alarm

    before = signal.signal(signal.SIGALRM, handler)
    threads.run(kernel, threads.CROSSOVER, 2)  # starts threads, once
    try:
        for _ in range(2_000):
            try:
                signal.setitimer(signal.ITIMER_REAL, chance.uniform(1e-6, 3e-4), 1.0)
                while True:
                    threads.run(Recorded(), threads.CROSSOVER, 2)
            except Alarm:
                signal.setitimer(signal.ITIMER_REAL, 0)
            kernel.calls.clear()
            threads.run(kernel, threads.CROSSOVER, 2)
            assert sorted(kernel.calls) == [(0, 2), (1, 2)]
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@needs_two_threads
def test_a_call_within_a_call():
    """As in the handler of a signal: all parts are computed, though the helpers are busy."""
    inner = Recorded()
    outer = Recorded(lambda part: threads.run(inner, threads.CROSSOVER, 2))
    threads.run(outer, threads.CROSSOVER, 2)
    assert sorted(outer.calls) == [(0, 2), (1, 2)]
    assert sorted(inner.calls) == [(0, 2), (0, 2), (1, 2), (1, 2)]


@pytest.mark.compiled
@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
def test_ctrl_c():
    """Ctrl-C ends a long run at the next return to Python, after at most about a second."""
    output = in_child(
        """
        import os, signal, threading
        turn = sf.QuadraticField.from_function(lambda x: (x[1], -x[0] * x[1] - x[0]), 2)
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
                           method="auto" if kind is turn else "canonical", progress=progress)
            except KeyboardInterrupt:
                print(len(seen) - before[0], max(np.diff(seen)) * size)
        """
    )
    lines = output.splitlines()
    assert len(lines) == 3
    for line in lines:
        returns, steps = map(int, line.split())
        assert returns <= 2
        assert steps < 2**33  # about a second on the fastest machines


def test_progress(body, capsys, small_parts):
    seen, omega = [], np.ones((70, 2))
    for kind, method in ((body, "ds2"), (sf.QuadraticField.of(body), "auto")):
        seen.clear()
        run = sf.iterate(kind, omega, 0.2, 700, method=method, progress=lambda *n: seen.append(n))
        assert len(seen) > 4
        assert seen == sorted(seen)
        assert seen[-1] == (700, 700)
        assert run == sf.iterate(kind, omega, 0.2, 700, method=method, threads=1)
    seen.clear()
    sf.iterate(body, omega, 0.2, 500, method="ds2").extend(300, progress=lambda *n: seen.append(n))
    assert len(seen) > 4
    assert max(seen) == seen[-1] == (300, 300)
    sf.iterate(body, omega, 0.2, 700, progress=lambda *n: seen.append(n))  # the closed form
    assert seen[-1] == (700, 700)
    sf.iterate(body, [1, 0.5], 0.2, 10, progress=True)
    assert "10.0/10.0" in capsys.readouterr().err


@needs_two_threads
@pytest.mark.parametrize("error", [RuntimeError, MemoryError])
def test_threads_that_cannot_be_started(error, monkeypatch):
    """Calls then take one thread."""
    started, start, kernel = [], threading.Thread.start, Recorded()

    def limited(thread):
        if len(started) == 2:
            raise error("can't start new thread")
        start(thread)
        started.append(thread)

    monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", 4)
    monkeypatch.setattr(threading.Thread, "start", limited)
    threads._tasks_of_helpers.cache_clear()
    try:
        threads.run(kernel, threads.CROSSOVER, 4)
    finally:
        threads._tasks_of_helpers.cache_clear()
    assert kernel.calls == [(0, 1)]
    assert len(started) == 2


def test_at_the_end_of_the_interpreter():
    """A function that `atexit` calls can still compute."""
    output = in_child(
        """
        import atexit
        assert (run() == expected).all()
        atexit.register(lambda: print("right" if (run() == expected).all() else "wrong"))
        """
    )
    assert output.strip() == "right"


def test_stretches_of_a_run_with_one_thread(body, monkeypatch, small_parts):
    """Their length, and so the time between calls of `progress`, is that of one thread."""
    options, calls = {"method": "canonical", "threads": 1}, []
    for available in (1, 64):
        monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", available)
        calls.append([])
        omega0, report = np.ones((8 * LANES, 2)), lambda *n: calls[-1].append(n)
        sf.iterate(body, omega0, 0.1, 20, **options, progress=report)
    assert calls[0] == calls[1]
