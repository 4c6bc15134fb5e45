"""Threads, forks, Ctrl-C and progress."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time

import numba
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast._core.cpu import blocks
from suslov_fast._core.cpu import map_3d as loops
from suslov_fast._engine import threads

SETUP = """
import numpy as np, suslov_fast as sf
body = sf.Suslov3D(4, 1, -0.5, -0.3)
omega = np.random.default_rng(1).uniform(-2, 2, (4096, 2))
def run(**options):
    return sf.iterate(body, omega, 0.2, 400, save_every=None, **options).final
expected = run(threads=1)
"""


def run_python(code, **environment):
    return subprocess.run(
        [sys.executable, "-c", SETUP + textwrap.dedent(code)],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=120,
    )


@pytest.fixture
def big(rng):
    return rng.uniform(-2, 2, (3 * blocks.LANES, 2))


needs_two_threads = pytest.mark.skipif(
    numba.config.NUMBA_NUM_THREADS < 2, reason="needs two threads"
)


@needs_two_threads
@pytest.mark.compiled
@pytest.mark.parametrize("before", [1, 2])
def test_threads_are_restored(body, big, before):
    numba.set_num_threads(before)
    try:
        for threads in (1, 2, None):
            sf.iterate(body, big, 0.2, 4000, threads=threads)
            assert numba.get_num_threads() == before
    finally:
        numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)


@needs_two_threads
@pytest.mark.compiled
def test_threads_are_restored_on_error(body, big, monkeypatch):
    seen = []

    class Broken:
        def parallel(self, *arguments):
            seen.append(numba.get_num_threads())
            raise MemoryError

    monkeypatch.setattr(loops, "iterate", Broken())
    numba.set_num_threads(2)
    with pytest.raises(MemoryError):
        sf.iterate(body, big, 0.2, 4000, threads=2)
    assert seen == [2]
    assert numba.get_num_threads() == 2
    assert not threads._one_at_a_time.locked()


@pytest.mark.parametrize("work", ["small batch", "one block"])
def test_little_work_stays_serial(body, monkeypatch, work):
    class SerialOnly:
        serial = staticmethod(loops.iterate.serial)

    monkeypatch.setattr(loops, "iterate", SerialOnly())
    if work == "one block":
        sf.iterate(body, np.ones((blocks.LANES, 2)), 0.2, 20_000)
    else:
        sf.iterate(body, np.ones((blocks.LANES + 1, 2)), 0.2, 10)


@pytest.mark.compiled
@pytest.mark.parametrize("layer", ["omp", "workqueue"])
def test_python_threads_at_once(layer):
    done = run_python(
        """
        from concurrent.futures import ThreadPoolExecutor
        with ThreadPoolExecutor(8) as pool:
            results = list(pool.map(lambda _: run(), range(64)))
        assert all((result == expected).all() for result in results)
        """,
        NUMBA_THREADING_LAYER=layer,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.compiled
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.parametrize("layer", ["omp", "workqueue"])
def test_forks(layer):
    """A child of a process whose threads ran must neither abort nor hang."""
    done = run_python(
        """
        import multiprocessing, warnings
        warnings.simplefilter("ignore", DeprecationWarning)
        assert (run() == expected).all()
        with multiprocessing.get_context("fork").Pool(2) as pool:
            results = pool.starmap_async(run, [()] * 4).get(timeout=60)
        assert all((result == expected).all() for result in results)
        """,
        NUMBA_THREADING_LAYER=layer,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.compiled
@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
@pytest.mark.parametrize("batch", ["(1, 2)", "(2000, 2)"])
@pytest.mark.parametrize("save_every", ["None", "2 * 10**9"])
def test_ctrl_c(batch, save_every):
    """A run of days ends within a second."""
    code = f"""
        options = {{"save_every": {save_every}, "method": "canonical"}}
        sf.iterate(body, np.ones({batch}), 0.2, 1000, **options)
        print("go", flush=True)
        sf.iterate(body, np.ones({batch}), 0.2, 10**13, **options)
    """
    process = subprocess.Popen(
        [sys.executable, "-c", SETUP + textwrap.dedent(code)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout.readline() == "go\n"
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        sent = time.monotonic()
        _, errors = process.communicate(timeout=30)
        assert time.monotonic() - sent < 1.0
        assert "KeyboardInterrupt" in errors
    finally:
        process.kill()
        process.communicate()


def test_progress_callable(body):
    seen = []
    sf.iterate(body, [1, 0.5], 0.2, 10, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (10, 10)


def test_progress_bar(body, capsys):
    sf.iterate(body, [1, 0.5], 0.2, 10, progress=True)
    assert "10.0/10.0" in capsys.readouterr().err


def test_results_from_a_thread(body, big):
    expected = sf.iterate(body, big, 0.2, 4000, save_every=None).final
    results = []
    thread = threading.Thread(
        target=lambda: results.append(sf.iterate(body, big, 0.2, 4000, save_every=None).final)
    )
    thread.start()
    thread.join()
    assert (results[0] == expected).all()
