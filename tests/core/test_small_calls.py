"""Calls that run as Python or NumPy, because nothing is compiled: same bits, for a second."""

import signal
import sys

import numpy as np
import pytest
from numba import config

import suslov_fast as sf
from suslov_fast.core.maps import pivoting
from suslov_fast.core.numba import decorators

pytestmark = [
    pytest.mark.compiled,
    pytest.mark.skipif(config.BOUNDSCHECK == 1, reason="all calls are compiled, to check indices"),
]
RNG = np.random.default_rng(3)
X2, X4 = (RNG.uniform(-1, 1, (5, D)) for D in (2, 4))
BODY, ROTOR = sf.Suslov3D(4, 1, -0.5, -0.3), sf.Suslov3D(4, 1, -0.5, -0.3, 0.7)
# Orbits of both forms, fixed states, poles, and states out of range.
MANY = np.concatenate([
    RNG.uniform(-1, 1, (200, 2)), 20.0 * X2, 1e155 * X2, np.full((2, 2), np.nan),
    np.outer(X2[0], [-3.0, 5.0]), [[0.5, -1.5], [0.0, 0.0]],
])  # fmt: skip
AT_POLES = sf.Suslov3D(1, 1, 1, 0), sf.Suslov3D(1, 1, 1, 0, [[0.0], [0.5]])
FAMILY = sf.Suslov3D(np.linspace(3, 4, 5), 1, -0.5, -0.3)
SOLID = sf.SuslovND(J=[1.3, 2.1, 3.7, 4.2], I=[0.4, -0.7, 0.5, 0.2])
# Its long steps lose digits, and pass poles.
SQUARES = sf.Field(lambda x: (x[0] ** 2 - x[1], x[1] ** 2 + x[0]), 2)


def run(*arguments, **options):
    def arrays():
        found = sf.iterate(*arguments, on_singular="ignore", **options)
        turns = [] if found.attitude is None else [found.attitude]
        return [found.states, found.final, found.status, found.failed_at, *turns]

    return arrays


def call(function, *arguments):
    def arrays():
        found = function(*arguments)
        return [*found] if isinstance(found, tuple) else [found]

    return arrays


CALLS = {
    "orbits": run(BODY, X2, 0.2, 30, save_every=4),
    "numbers out of range": run(BODY, X2, 1e9, 10),
    "a family": run(FAMILY, X2, 0.2, 20),
    "a batch": run(BODY, MANY, 0.2, 1100, save_every=3),
    "a batch with poles": run(AT_POLES[0], MANY, 2.0, 40),
    "batches of two gyrostats": run(AT_POLES[1], MANY, 2.0, 600, save_every=100),
    "a batch in four dimensions": run(SOLID, RNG.uniform(-1, 1, (300, 4)), 0.1, 30),
    "last states": run(ROTOR, MANY, 0.3, 50, save_every=None),
    "poles in four dimensions": run(SOLID, X4, 2.5, 20),
    "elimination": run(SOLID, X4, 0.7, 10, method="gauss"),
    "two ranks": run(SOLID, X4, 0.2, 10),
    "orientations": run(BODY, X2, 0.2, 40, attitude=True),
    "poles of order 4": run(SQUARES, X2, 1.5, 20, method="order4"),
    "closed form": call(sf.Suslov3D.exact, BODY, X2[0], 0.2, np.arange(-5.0, 6)),
    "exponents beyond poles": call(sf.lyapunov_exponents, SQUARES, X2, 3.0, 20),
}


@pytest.fixture
def as_in_an_empty_process(monkeypatch):
    """Forget what is compiled, in this process and on disk; Python may take as long as it wants."""

    def begin():
        modules = [name for name in sys.modules if name.startswith("suslov_fast")]
        for each in [each for name in modules for each in vars(sys.modules[name]).values()]:
            if isinstance(each, decorators.Tiered):
                monkeypatch.setattr(each, "seconds", 0.0)
                for name in ("_address_of_code", "is_compiled"):
                    monkeypatch.delitem(vars(each), name, raising=False)
        monkeypatch.setattr(decorators, "is_kept", lambda *_: False)
        monkeypatch.setattr(decorators, "WARM_UP", 1000.0)

    return begin


@pytest.mark.filterwarnings("ignore")  # of missing states
@pytest.mark.parametrize("name", CALLS)
def test_interpreted_calls_have_the_bits_of_compiled_ones(
    name, as_in_an_empty_process, monkeypatch
):
    monkeypatch.setattr(decorators, "WARM_UP", -1.0)
    expected = CALLS[name]()
    as_in_an_empty_process()
    called, call_in_python = [], decorators.Tiered.interpret

    def note(self, *arguments):
        called.append(self)
        return call_in_python(self, *arguments)

    monkeypatch.setattr(decorators.Tiered, "interpret", note)
    found = CALLS[name]()
    assert called
    for one, other in zip(found, expected, strict=True):
        assert type(one) is type(other)
        assert np.array_equal(one, other, equal_nan=True)


@pytest.fixture
def of_pivoting(as_in_an_empty_process, monkeypatch):
    """Return a function that replaces what Python does where a step of a field needs pivots."""
    as_in_an_empty_process()
    monkeypatch.delitem(vars(pivoting.pivoting_step), "_callback", raising=False)
    yield lambda replaced: monkeypatch.setattr(decorators, "as_python", lambda _: replaced)
    vars(pivoting.pivoting_step).pop("_callback", None)


@pytest.mark.parametrize("error", [IndexError, KeyboardInterrupt])
def test_errors_and_ctrl_c_in_python_that_machine_code_calls(error, of_pivoting):
    """The call ends, and then is interrupted: no step is left half done."""
    called = []

    def stop(*arguments):
        called.append(True)
        if error is IndexError:
            raise IndexError("of a kernel")
        signal.raise_signal(signal.SIGINT)

    of_pivoting(stop)
    with pytest.raises(error):
        sf.iterate(SQUARES, X2, 1.5, 20, on_singular="ignore")
    assert called
    assert not decorators._raised


def test_machine_code_takes_over_after_some_calls():
    """With the same bits, also at poles and for NaN; a family, and many states, stay with NumPy."""
    field = sf.Field(lambda x, k: (np.sin(k * x[0]) / x[1], np.exp(x[0]) - x[1]), 2, k=2.5)
    states = np.array([[0.3, 0.7], [1e9, 0.0], [-800.0, 1e-300], [np.inf, 1.0]])
    states[3] = np.nan
    expected, slopes = field(states), field.jacobian(states)
    for _ in range(2):
        for x, value, slope in zip(states, expected, slopes, strict=True):
            assert field(x).tobytes() == value.tobytes()
            assert field.jacobian(x).tobytes() == slope.tobytes()
        for _ in range(600):
            field(states[0]), field.jacobian(states[0])
