"""Threads, forks, Ctrl-C and progress."""

import os
import random
import signal
import textwrap
import threading
from contextlib import suppress
from types import SimpleNamespace

import children
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast._engine import threads
from suslov_fast._kernels.blocks import LANES


def in_child(code, **environment):
    return children.run(children.SETUP + textwrap.dedent(code), **environment)


needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")


@pytest.mark.parametrize("failing", [0, 2])
def test_an_error_in_a_parallel_call(failing):
    """It is that of the call, whichever thread it was in."""

    def fail(part, parts):
        if part == failing:
            raise MemoryError(parts)

    with pytest.raises(MemoryError, match="3"):
        threads.run(SimpleNamespace(compiled=fail), threads.CROSSOVER, 3)


def test_little_work_stays_serial(body, monkeypatch):
    """A small batch is serial, and a single block of lanes for any number of steps."""
    monkeypatch.setattr(threads, "_parallel", None)
    sf.iterate(body, np.ones((LANES + 1, 2)), 0.2, 10, method="canonical")
    sf.iterate(body, np.ones((LANES, 2)), 0.2, 20_000, method="canonical")


@pytest.mark.compiled
def test_python_threads_at_once():
    in_child(
        """
        from concurrent.futures import ThreadPoolExecutor
        with ThreadPoolExecutor(8) as pool:
            results = list(pool.map(lambda _: run(), range(64)))
        assert all((result == expected).all() for result in results)
        """,
        NUMBA_NUM_THREADS="2",
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
        os._exit(0 if (run() == expected).all() else 1)
    assert os.waitpid(child, 0)[1] == 0
stop.set()
thread.join()
"""


@needs_fork
@pytest.mark.compiled
def test_forks():
    """A child forked while another thread computes has threads of its own."""
    children.run(children.SETUP + FORKS, 20, NUMBA_NUM_THREADS="2")


class Alarm(Exception):
    pass


def raise_alarm(signum, frame):
    raise Alarm


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs alarms")
def test_signals_at_random_moments():
    """Calls work wherever the handler of a signal raises, and in the handler."""
    chance, taken = random.Random(1), []
    kernel = SimpleNamespace(compiled=lambda part, parts: taken.append(part))

    def raise_alarm(signum, frame):
        threads.run(kernel, threads.CROSSOVER, 2)
        raise Alarm

    before = signal.signal(signal.SIGALRM, raise_alarm)
    try:
        for _ in range(500):
            with suppress(Alarm):
                signal.setitimer(signal.ITIMER_REAL, chance.uniform(1e-6, 1e-4), 1.0)
                while True:
                    threads.run(kernel, threads.CROSSOVER, 2)
            signal.setitimer(signal.ITIMER_REAL, 0)
            taken.clear()
            threads.run(kernel, threads.CROSSOVER, 3)
            assert {0, 1, 2} <= set(taken)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


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


@pytest.mark.parametrize("error", [RuntimeError, MemoryError])
def test_threads_that_cannot_be_started(error, monkeypatch):
    """The threads that there are do all parts."""
    taken, helpers = [], []

    def fail(thread):
        raise error("can't start new thread")

    kernel = SimpleNamespace(compiled=lambda part, parts: taken.append(part))
    monkeypatch.setattr(threads, "_helpers", helpers)
    monkeypatch.setattr(threading.Thread, "start", fail)
    threads.run(kernel, threads.CROSSOVER, 5)
    assert sorted(taken) == list(range(5))
    assert helpers == []
