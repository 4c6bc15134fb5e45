import gc
import os
import signal
import sys
from collections import defaultdict

import numpy as np
import pytest
from last_digits import other_last_digits

import suslov_fast as sf

# Modules that tests share, and that assert.
pytest.register_assert_rewrite("children", "papers", "promises")

# Processes started in the background ignore Ctrl-C, and so would their children.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Pause the garbage collector, which would take a third of the time; it skips what is there.

    Later it rarely looks at what has lived for long.
    """
    gc.disable()
    try:
        result = yield
        code = sys.modules.get("suslov_fast.core.llvm.compiler")
        assert not (code and code.known_codes), "a test file compiles while it is collected"
        return result
    finally:
        gc.freeze()
        gc.set_threshold(*gc.get_threshold()[:2], 100)
        gc.enable()


# Files that come first. Of two processes one compiles what most files call, while the other takes
# files that compile little; else both would compile the same kernels at the same time. Of slow
# tests those come first that take longest, so that both processes end at about one time.
FIRST = (
    "promises integrability planar implicit levels right_hand_sides functions motion_engine "
    "field untrusted_files errors kernels"
)
SLOWEST = "first_calls docs promises integrability numba hashes published_flows"


@pytest.hookimpl(tryfirst=True)  # before `-m` selects
def pytest_collection_modifyitems(config, items):
    """Mark slow tests: those in tests/slow, and all but some cases of tests marked `sampled`."""
    from numba import config as settings  # not in the process that waits for those of `-n`

    cases = defaultdict(list)
    for item in items:
        slow = item.get_closest_marker("slow_cases")
        is_slow = slow and item.callspec.id in slow.args
        if is_slow or "slow" in item.path.relative_to(config.rootpath).parent.parts:
            item.add_marker("slow")
        is_sampled = item.get_closest_marker("sampled") and not item.get_closest_marker("slow")
        if is_sampled:
            cases[item.path, item.originalname].append(item)
        if settings.DISABLE_JIT and item.get_closest_marker("compiled"):
            reason = "needs compiled kernels: NUMBA_DISABLE_JIT is set"
            item.add_marker(pytest.mark.skip(reason=reason))
        slow = item.get_closest_marker("slow_to_compile")
        if slow and not settings.DISABLE_JIT and item.name not in slow.kwargs.get("but", ()):
            item.add_marker("slow")
    for some in cases.values():
        count = some[0].get_closest_marker("sampled").args[0]
        kept = {i * len(some) // count for i in range(count)}
        for i, item in enumerate(some):
            if i not in kept:
                item.add_marker("slow")
    names = (SLOWEST if config.option.markexpr == "slow" else FIRST).split()
    places = {name: k for k, name in enumerate(names)}
    items.sort(key=lambda item: places.get(item.path.stem.partition("_")[2], len(names)))


def pytest_addoption(parser):
    parser.addoption("--seed", type=int, default=7, help="of the adversarial problems")
    text = "seed of changes in the last digits of LAPACK, as of another processor; 0: none"
    parser.addoption("--last-digits", type=int, default=0, help=text)


def pytest_configure(config):
    config.option.loadscopereorder = False  # xdist would sort files by the number of their tests
    os.environ.setdefault("SUSLOV_FAST_OPT", "0")  # most tests compile fields, and take few steps
    if config.option.last_digits:
        digits = other_last_digits(config.option.last_digits)
        digits.__enter__()
        config.add_cleanup(lambda: digits.__exit__(None, None, None))


@pytest.fixture
def seed(request):
    return request.config.getoption("--seed")


@pytest.fixture
def rng():
    return np.random.default_rng(20261120)


@pytest.fixture
def body():
    """Body of the paper's first figure."""
    return sf.Suslov3D(4, 1, -0.5, -0.3)


@pytest.fixture
def unit():
    """Body with exact numbers: x = Omega1, y = -Omega2, I1 I2 = 1."""
    return sf.Suslov3D(1, 1, 1, 0)


@pytest.fixture(params=["3D", "nD"])
def case(request, body):
    if request.param == "3D":
        return body, [1.0, 0.5]
    return sf.SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5]), [0.3, 0.9, -0.6]


@pytest.fixture(autouse=True)
def _figures():
    """Close all figures and restore the settings of Matplotlib after each test."""
    before = _settings()
    yield
    if "matplotlib.pyplot" in sys.modules:
        import matplotlib.pyplot as plt

        plt.close("all")
        if _settings() != before:  # to restore them takes longer than most tests
            plt.rcdefaults()


def _settings():
    matplotlib = sys.modules.get("matplotlib")
    # Not by the methods of its class, which choose a backend.
    return matplotlib and dict(dict.items(matplotlib.rcParams))
