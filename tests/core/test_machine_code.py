"""Machine code of the steps of fields, and steps by `solve`, which take its place."""

import functools
import pickle
import re
import weakref

import children
import numpy as np
import pytest
from llvmlite import binding
from systems import chain as volterra

import suslov_fast as sf
from suslov_fast.core.llvm import compiler as machine_code
from suslov_fast.core.maps import driver, few_orbits, kahan_step, kernel, pivoting
from suslov_fast.core.maps.stages import Stages
from suslov_fast.core.numba import decorators
from suslov_fast.maps import batch, derivatives

pytestmark = pytest.mark.compiled


def of_a(x, a):
    return 10 * (x[1] - x[0]), x[0] * (28 - x[2]) - a * x[1], x[0] * x[1] - 2.5 * x[2]


FIELD = sf.Field(of_a, 3, a=1)
PENDULUM = sf.Field(lambda x: (x[1], -np.sin(x[0]) - np.tanh(x[1])), 2)


def forget(monkeypatch):
    """Forget all plans and all machine code."""
    monkeypatch.setattr(machine_code, "known_codes", {})
    monkeypatch.setattr(machine_code, "_engines", {})
    for module, name in ((kernel, "_step_of"), (kahan_step, "_extended_step")):
        plan = functools.cache(getattr(module, name).__wrapped__)
        monkeypatch.setattr(module, name, plan)


@pytest.fixture
def anew(monkeypatch):
    forget(monkeypatch)


CALLS = {
    "map": lambda: sf.iterate(FIELD, np.ones((9, 3)), 0.02, 5),
    "one step": lambda: sf.step(FIELD, np.ones(3), 0.02),
    "derivatives": lambda: sf.kahan.jacobian(FIELD, np.ones(3), 0.02),
    "exponents": lambda: sf.lyapunov_exponents(FIELD, np.ones(3), 0.02, 9),
    "motion": lambda: sf.flow(FIELD, np.ones((9, 3)), time=0.1),
    "derivatives of a motion": lambda: sf.flow(PENDULUM, [1.0, 0.5], time=1.0, derivatives="x0"),
    "system": lambda: sf.compiled.system(FIELD, 0.02),
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
    with pytest.raises(RuntimeError, match=r"no such text.*report"):
        CALLS[call]()
    monkeypatch.setattr(decorators, "TESTED", (0, 1))
    with pytest.raises(RuntimeError, match=r"no such text.*pip install 'numba<0.2'"):
        CALLS[call]()
    assert len(texts) == 2
    for text in texts:
        known = re.findall(r"^(?:declare|define) [^@]*@([\w.]+)", text, re.MULTILINE)
        assert {*re.findall(r"call [^@]*@([\w.]+)", text)} <= {*known}


WITHOUT_JIT = """
import warnings
import numpy as np, suslov_fast as sf
warnings.simplefilter("ignore")
def bits():
    x0 = np.random.default_rng(1).normal(size=(9, 3)) * np.geomspace(1.0, 300.0, 9)[:, None]
    field = sf.Field(
        lambda x: (10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 2.5 * x[2]), 3
    )
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


def test_bits_without_jit():
    """What Numba compiles runs as Python, and LLVM compiles as ever."""
    code = f"{WITHOUT_JIT}\nprint(*bits())"
    one, other = (children.run(code, NUMBA_DISABLE_JIT=value).split() for value in "01")
    assert one == other


# Sizes that decide how a step is computed, and how much the results may differ.
SIZES = "suslov_fast.core.maps.kahan_step"
MATRIX = {"MOST_OF_DENSE": -1, "MOST_OF_SPARSE": -1}
WAYS = {
    "pieces": ({"LONGEST_OPTIMISED": 0}, 0.0),
    "loops over the matrix": (MATRIX | {"SPARSE_PART": 0.0}, 1e-10),
    "SuperLU": (MATRIX | {"SPARSE_PART": np.inf}, 1e-10),
}


@pytest.mark.filterwarnings("ignore::suslov_fast.IntegrationWarning")
@pytest.mark.parametrize(
    "way", [way if way == "pieces" else pytest.param(way, marks=pytest.mark.slow) for way in WAYS]
)
def test_other_ways_to_compute_a_step(rng, monkeypatch, anew, way):
    """Of steps that are good, near a pole, beyond one, and of NaN; of one orbit as of a batch."""
    q, l, c = (rng.normal(size=(5,) * n) for n in (3, 2, 1))
    x0 = rng.normal(size=(21, 5)) * np.geomspace(1e-3, 30.0, 21)[:, None]
    x0[4] = np.nan
    eps = np.linspace(0.01, 0.03, 21)  # each orbit has its own

    def found():
        dense, chain = sf.Field.from_terms(q, l, c), sf.Field(of_a, 3, a=1)  # fields keep calls
        lattice = sf.Field(volterra, 5)
        H = lambda x: x[0] ** 3 / 3 + x[0] * x[1] ** 2  # noqa: E731
        ignore, met = {"on_singular": "ignore"}, []
        for field, x, step, steps in (
            (lattice, abs(x0), 0.2, 60),
            (dense, x0[:7], 0.1, 20),
            (chain, x0[:9, :3], eps[:9], 30),
        ):
            for method in ("auto", "order4"):
                given = ignore | {"method": method}
                run = sf.iterate(field, x, step, steps, save_every=7, **given)
                one = sf.step(field, x, step, method=method)
                for k in (0, 4, 6):
                    own = np.broadcast_to(step, len(x))[k]
                    np.testing.assert_array_equal(sf.step(field, x[k], own, method=method), one[k])
                    system, out = sf.compiled.system(field, own, method=method), np.empty_like(x[k])
                    sf.compiled.step_system(system, x[k], out, sf.compiled.work(system))
                    np.testing.assert_allclose(out, one[k], rtol=WAYS[way][1])
                    alone = sf.iterate(field, x[k], own, steps, save_every=7, **given)
                    np.testing.assert_array_equal(alone.states, run.states[:, k])
                    assert (alone.status, alone.failed_at) == (run.status[k], run.failed_at[k])
                last = sf.iterate(field, x, step, steps, save_every=None, **given)
                np.testing.assert_array_equal(last.final, run.final)
                is_near = field is chain or way == "pieces"  # the others amplify rounding errors
                met += [run.states if is_near else run.n, run.status, run.failed_at]
        assert {*met[1]} == {sf.Status.OK, sf.Status.PASSED_POLE, sf.Status.NONFINITE}
        return [
            *met,
            sf.kahan.jacobian(chain, x0[:9, :3], 0.02),
            sf.kahan.invariant_density(sf.Field.from_hamiltonian(H, 2), x0[:, :2], 0.02),
            sf.lyapunov_exponents(chain, x0[:3, :3], 0.02, 50),
            sf.lyapunov_exponents(chain, x0[0, :3], 0.02, 50),
        ]

    usual, (sizes, error) = found(), WAYS[way]
    for name, size in sizes.items():
        monkeypatch.setattr(f"{SIZES}.{name}", size)
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
    field, x0 = sf.Field(of_a, 3, a=1), rng.normal(size=(9, 3))
    system, x = sf.compiled.system(field, 0.02), x0[0].copy()

    def compile_others(done, steps):
        for D in (1, 2, 4) if done <= last else ():
            sf.step(sf.Field.from_terms(np.ones((D, D, D)), np.eye(D)), np.ones((2, D)), 0.001)

    run, exponents = sf.iterate(field, x0, 0.02, 200), sf.lyapunov_exponents(field, x0[:2], 0.02, 9)
    monkeypatch.setattr(machine_code, "MOST_TEXT", 3 * machine_code.LEAST_TEXT)
    monkeypatch.setattr(batch, "CHUNK_WORK", 1)
    monkeypatch.setattr(derivatives, "CHUNK_WORK", 1)
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


def places_in(*things):
    """Return the memory of arrays (begin, end), and addresses of code, to which things refer."""
    seen, left, places = set(), [*things], []
    while left:
        thing = left.pop()
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        if isinstance(thing, np.ndarray):
            places.append((thing.ctypes.data, thing.ctypes.data + thing.nbytes))
        elif isinstance(thing, int):
            places.append((thing, thing + 1))
        elif isinstance(thing, tuple):
            left += thing
        elif type(thing).__module__.startswith("suslov_fast"):
            left += vars(thing).values()
    return places


def test_what_machine_code_is_given_stays_alive():
    """Each address among its arguments is one of arrays that these calls return or have."""
    indices, values = sf.Field(lambda x: of_a(x, 1.0), 3).terms
    step, stages = kernel.scheme_of(indices, 3, Stages((0.5, 0.5)))
    given, x = (np.atleast_2d(values), np.array([0.1])), np.ones((20, 3))
    notes, saved = [np.zeros(20, kind) for kind in (np.int8, np.int64, float)], np.ones((5, 20, 3))
    lines = kernel._Lines((kernel.Scheme(step, stages), *given), x, notes, 8)
    bits = values.tobytes()
    one = few_orbits._prepared(step, stages, given[1].tobytes(), bits, 3, False)
    code = pivoting.pivoting_step.address
    for arguments, kept, *owners in (
        (*lines._driver_arguments(0, 10, saved, 4, 1, code), lines, saved, code),
        (np.array(one[1]), one[-1]),
    ):
        places, arrays = places_in(kept, *owners), [a for a in kept if isinstance(a, np.ndarray)]
        plans = [each.view(np.int64)[:, 0] for each in arrays if each.ndim == 2]
        numbers = [arguments, *plans, *(each for each in arrays if each.dtype == np.int64)]
        numbers = [n for each in numbers for n in each if n is not None and np.ndim(n) == 0]
        addresses = [number for number in numbers if number > 2**32]
        assert addresses
        for address in addresses:
            assert any(begin <= address <= end for begin, end in places)


@pytest.mark.slow
def test_a_system_in_another_process_has_its_own_address():
    field = sf.Field(of_a, 3, a=1)
    system = sf.compiled.system(field, 0.01)
    text = children.run(PICKLED, pickle.dumps(system).hex())
    run = sf.iterate(field, [1.0, 2.0, 20.0], 0.01, 50)
    assert (np.frombuffer(bytes.fromhex(text)) == run.final).all()


@pytest.mark.slow
@pytest.mark.parametrize("with_columns", [False, True])
def test_frames(with_columns):
    """No code takes 256 KB of a stack: a thread may have 512 KB. Dense fields, any x86-64."""
    D, W = 4 if with_columns else 8, 8
    indices = [(i, j, k) for i in range(D) for j in range(D + 1) for k in range(j, D + 1)]
    step = kernel.scheme_of(np.transpose(indices), D).step
    options = False, True, False
    if with_columns:
        step = step.with_columns()
    binding.initialize_all_targets()
    binding.initialize_all_asmprinters()
    target = binding.Target.from_triple("x86_64-unknown-linux-gnu")
    assert not step.is_long  # then no code of its own
    machine = target.create_target_machine(cpu="x86-64", features="", opt=2)
    code = machine.emit_assembly(
        binding.parse_assembly(driver.text_of_steps(step, "f", W, *options))
    )
    # The last function calls the others, one after the other.
    *pieces, last = map(int, re.findall(r"sub[lq]?\s+\$(\d+), %rsp", code))
    assert 0 < last + max(pieces, default=0) < 2**18
