"""Many signals and forks at random moments, during computations."""

import children
import pytest

pytestmark = pytest.mark.compiled

SIGNALS = """
import random, signal, sys
import numba
from suslov_fast._engine import threads

class Alarm(Exception):
    pass

def raise_alarm(signum, frame):
    raise Alarm

chance = random.Random(int(sys.argv[1]))
assert (run() == expected).all()
saved = sf.iterate(body, omega, 0.2, 40)
numba.set_num_threads(1)
signal.signal(signal.SIGALRM, raise_alarm)
met = 0
while met < 3000:
    begin = omega.copy()
    try:
        # Repeat after a second, in case Python dropped the first exception.
        signal.setitimer(signal.ITIMER_REAL, chance.uniform(1e-5, 5e-3), 1.0)
        while True:
            assert (run(threads=2) == expected).all()
            again = sf.iterate(body, omega, 0.2, 40, threads=2)
            assert (again.omega == saved.omega).all()
    except Alarm:
        signal.setitimer(signal.ITIMER_REAL, 0)
        met += 1
    assert (omega == begin).all()
    assert not threads._owned()
    assert numba.get_num_threads() == 1
assert (run(threads=2) == expected).all()
"""


@pytest.mark.parametrize("layer", children.LAYERS)
def test_signals(layer):
    children.run(children.SETUP + SIGNALS, 1, timeout=1800, **children.layer(layer))


@pytest.mark.parametrize("layer", children.LAYERS)
def test_forks(layer):
    children.run(children.FORKS, 500, timeout=1800, **children.layer(layer))
