"""Machine code of the steps of fields, and steps by `solve`, which take its place."""

import functools
import pickle
import re
import threading
import weakref

import children
import numpy as np
import pytest
from systems import chain as volterra, lorenz

import suslov_fast as sf
from suslov_fast.core.llvm import compiler as machine_code
from suslov_fast.core.maps import kernel
from suslov_fast.core.numba import decorators
from suslov_fast.maps import batch, derivatives

pytestmark = pytest.mark.compiled


FIELD = sf.Field(lorenz, 3, rho=28)
PENDULUM = sf.Field(lambda x: (x[1], -np.sin(x[0]) - np.tanh(x[1])), 2)


def forget(monkeypatch):
    """Forget all plans and all machine code."""
    monkeypatch.setattr(machine_code, "known_codes", {})
    monkeypatch.setattr(machine_code, "_engines", {})
    monkeypatch.setattr(kernel, "_step_of", functools.cache(kernel._step_of.__wrapped__))


@pytest.fixture
def anew(monkeypatch):
    forget(monkeypatch)


CALLS = {
    "map": lambda: sf.iterate(FIELD, np.ones((9, 3)), 0.02, 5),
    "exponents": lambda: sf.lyapunov_exponents(FIELD, np.ones(3), 0.02, 9),
    "motion": lambda: sf.flow(PENDULUM, [1.0, 0.5], time=1.0, derivatives="x0"),
}


@pytest.mark.parametrize("call", CALLS)
def test_where_llvm_refuses_the_code(call, monkeypatch, anew):
    """An error says what to install, if Numba is newer than any that was tested.

    Texts declare all that they call: LLVM of the oldest Numba knows no function without.
    """
    texts = []

    def refuse(text, *others):
        texts.append(text)
        raise RuntimeError("no such text")

    monkeypatch.setattr(machine_code, "_compile", refuse)
    monkeypatch.setattr(decorators, "TESTED", (0, 1))
    with pytest.raises(RuntimeError, match=r"no such text.*pip install 'numba<0.2'"):
        CALLS[call]()
    known = re.findall(r"^(?:declare|define) [^@]*@([\w.]+)", texts[0], re.MULTILINE)
    assert {*re.findall(r"call [^@]*@([\w.]+)", texts[0])} <= {*known}


WITHOUT_JIT = """
import warnings
import numpy as np, suslov_fast as sf
from systems import LORENZ as field
warnings.simplefilter("ignore")
def bits():
    x0 = np.random.default_rng(1).normal(size=(9, 3)) * np.geomspace(1.0, 300.0, 9)[:, None]
    q = np.random.default_rng(2).normal(size=(12, 12, 12)) / 80
    dense = sf.Field.from_terms(q, -np.eye(12))
    run = sf.iterate(field, x0, 1.5, 9)  # with steps by `solve`
    found = [run.states, run.status, sf.kahan.jacobian(field, x0, 0.5)]
    found += [sf.flow(field, x0, time=0.1).final]
    found += [sf.lyapunov_exponents(field, x0, 0.02, 9), sf.flow(field, x0[0], time=0.1).final]
    found += [sf.lyapunov_exponents(field, x0, 1.5, 9)]
    found += [sf.iterate(dense, np.ones(12), 0.1, 1).final]
    return [np.where(np.isnan(each), 9.0, each + 0.0).tobytes().hex() for each in found]
"""


@pytest.mark.slow
def test_bits_without_jit():
    """What Numba compiles runs as Python, and LLVM compiles as ever."""
    code = f"{WITHOUT_JIT}\nprint(*bits())"
    one, other = (children.run(code, NUMBA_DISABLE_JIT=value).split() for value in "01")
    assert one == other


# Sizes that decide how a step is computed, and how much the results may differ.
MATRIX = {"MOST_OF_DENSE": -1, "MOST_OF_SPARSE": -1}
WAYS = {
    "pieces": ({"MOST_OPTIMISED": 0}, 0.0),
    "loops over the matrix": (MATRIX | {"PART_OF_DENSE": 0.0}, 1e-10),
    "SuperLU": (MATRIX | {"PART_OF_DENSE": np.inf}, 1e-10),
}


@pytest.mark.filterwarnings("ignore::suslov_fast.IntegrationWarning")
@pytest.mark.slow_cases("loops over the matrix", "SuperLU")
@pytest.mark.parametrize("way", WAYS)
def test_other_ways_to_compute_a_step(rng, monkeypatch, anew, way):
    """Of steps that are good, near a pole, beyond one, and of NaN; of one orbit as of a batch."""
    x0 = rng.normal(size=(9, 5)) * np.geomspace(1e-3, 30.0, 9)[:, None]
    x0[4] = np.nan
    terms = [rng.normal(size=(5,) * n) for n in (3, 2, 1)]

    def found():
        dense, chain = sf.Field.from_terms(*terms), sf.Field(lorenz, 3, rho=28)  # fields keep calls
        for field, x, eps, steps, method in (
            (sf.Field(volterra, 5), abs(x0), 0.2, 60, "order4"),
            (dense, x0[:7], 0.1, 3, "auto"),
            (chain, x0[:, :3], np.linspace(0.01, 0.03, 9), 30, "auto"),
        ):
            given = {"on_singular": "ignore", "method": method, "save_every": 3}
            run = sf.iterate(field, x, eps, steps, **given)
            for k in (0, 4, 6):
                own = np.broadcast_to(eps, len(x))[k]
                alone = sf.iterate(field, x[k], own, steps, **given)
                np.testing.assert_array_equal(alone.states, run.states[:, k])
            # Of chaos the first states alone, where rounding differs.
            yield run.states if field is chain or way == "pieces" else run.states[:2, :7]
            yield run.status
        yield sf.kahan.jacobian(chain, x0[:, :3], 0.02)
        yield sf.lyapunov_exponents(chain, x0[:3, :3], 0.02, 50)

    usual, (sizes, error) = [*found()], WAYS[way]
    assert {*np.concatenate(usual[1:6:2])} >= {0, sf.Status.PASSED_POLE, sf.Status.NONFINITE}
    for name, size in sizes.items():
        monkeypatch.setattr(f"suslov_fast.core.maps.kahan_step.{name}", size)
    forget(monkeypatch)
    for one, other in zip(found(), usual, strict=True):
        np.testing.assert_allclose(one, other, rtol=error, atol=error / 100)


def test_old_codes_are_freed(monkeypatch, anew):
    monkeypatch.setattr(machine_code, "MOST_TEXT", 2 * machine_code.LEAST_TEXT)
    engines = set()
    for D in range(1, 6):
        squares = sf.Field(lambda x: x**2, D)
        sf.step(squares, np.ones((99, D)), 0.001)
        engines.add(weakref.ref(machine_code._engines[2, False]))
    assert sum(engine() is not None for engine in engines) == 1 < len(engines)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::suslov_fast.IntegrationWarning")
def test_codes_in_use_are_not_freed(rng, monkeypatch, anew):
    """A run, exponents and the system of a user keep theirs while `progress` compiles others."""
    field, x0 = sf.Field(lorenz, 3, rho=28), rng.normal(size=(9, 3))
    system, x = sf.compiled.system(field, 0.02), x0[0].copy()

    def compile_others(done, steps):
        for D in (1, 2, 4) if done <= last else ():
            sf.step(sf.Field.from_terms(np.ones((D, D, D)), np.eye(D)), np.ones((2, D)), 0.001)

    run, exponents = sf.iterate(field, x0, 0.02, 200), sf.lyapunov_exponents(field, x0[:2], 0.02, 9)
    monkeypatch.setattr(machine_code, "MOST_TEXT", 3 * machine_code.LEAST_TEXT)
    monkeypatch.setattr(batch, "WORK_OF_CHUNK", 1)
    monkeypatch.setattr(derivatives, "WORK_OF_CALL", 1)
    last = 9
    assert (sf.iterate(field, x0, 0.02, 200, progress=compile_others).states == run.states).all()
    last = 1
    found = sf.lyapunov_exponents(field, x0[:2], 0.02, 9, progress=compile_others)
    assert (found == exponents).all()
    assert sum(not lasts for *_, lasts in machine_code.known_codes) <= 3
    memory = sf.compiled.work(system)
    for _ in range(20):
        assert sf.compiled.step_system(system, x, x, memory) == 0
    assert (x == run.states[20, 0]).all()


PICKLED = """
import pickle, sys
import numpy as np
from suslov_fast.compiled import step_system, work
system = pickle.loads(bytes.fromhex(sys.argv[1]))
x = np.array([1.0, 2.0, 20.0])
for _ in range(50):
    assert step_system(system, x, x, work(system)) == 0
assert system.address != 0
print(x.tobytes().hex())
"""


@pytest.mark.slow
def test_a_system_in_another_process_has_its_own_address():
    field = sf.Field(lorenz, 3, rho=28)
    system = sf.compiled.system(field, 0.01)
    text = children.run(PICKLED, pickle.dumps(system).hex())
    run = sf.iterate(field, [1.0, 2.0, 20.0], 0.01, 50)
    assert (np.frombuffer(bytes.fromhex(text)) == run.final).all()


def test_stacks_of_threads():
    """A thread may have 512 KB: first calls are made elsewhere."""
    terms = [0.1 * np.random.default_rng(1).normal(size=(8,) * n) for n in (3, 2)]
    field, x, found = sf.Field.from_terms(*terms), np.ones((20, 8)), []

    def calls():
        found.append(sf.iterate(field, x, 0.01, 3).final)
        found.append(sf.lyapunov_exponents(field, x, 0.01, 3))

    calls()
    before = threading.stack_size(2**19)
    thread = threading.Thread(target=calls)
    thread.start()
    threading.stack_size(before)
    thread.join()
    np.testing.assert_array_equal(found[:2], found[2:])
