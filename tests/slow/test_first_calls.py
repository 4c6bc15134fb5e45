"""Each kind of call as the first one of a process.

What other calls do before hides what a kind of call lacks, so each has a process of its own, every
other one on one thread. It compiles fields as users do, and finds the bits of this process, which
compiles them at level 0. Calls of bodies find compiled what calls before them have compiled, and
the first one finds nothing; the others have the usual cache. `.ci/run` begins with the command.
"""

import contextlib
import io
from itertools import cycle

import children
import pytest

pytestmark = [pytest.mark.compiled]

BEGIN = """
import hashlib, tempfile
import numba, numpy as np, suslov_fast as sf
from systems import lorenz, lorenz_96
rng = np.random.default_rng(1)

def x(*shape):
    return rng.uniform(-0.3, 0.3, shape)

def run(system, shape, eps, steps, **options):
    it = sf.iterate(system, x(*np.atleast_1d(shape)), eps, steps, **options)
    return it.states, it.final, it.status, it.failed_at, *([it.attitude] * ("attitude" in options))

def tell(*results):
    for each in results:
        if isinstance(each, (tuple, list)):
            tell(*each)
        elif type(each).__name__ == "Report":
            print(each)
        else:
            array = np.ascontiguousarray(getattr(each, "states", each))
            assert array.size, array.shape
            print(array.shape, hashlib.sha256(array.tobytes()).hexdigest())

def heat(x):
    u = np.array(x).reshape(16, 16)
    near = sum(np.roll(u, s, axis) for s in (1, -1) for axis in (0, 1))
    return (near - 4 * u + u - u * u).ravel()

def of(f, D, **parameters):
    return sf.Field(f, D, **parameters)

body = sf.Suslov3D(4, 1, -0.5, -0.3)
bodies = sf.Suslov3D(np.linspace(3, 4, 300), 1, -0.5, -0.3)
gyrostat = sf.Suslov3D(4, 1, -0.5, -0.3, 0.7)
solid = sf.SuslovND(J=[1.3, 2.1, 3.7, 4.2], I=[0.4, -0.7, 0.5, 0.2])
field, family = of(lorenz, 3, rho=28.0), of(lorenz, 3, rho=np.linspace(20, 30, 1500))
henon = sf.Field.from_hamiltonian(
    lambda x: sum(v * v for v in x) / 2 + x[0]**2 * x[1] - x[1]**3 / 3, 4)
own = sf.Map(lambda x: (1 - 1.4 * x[0] ** 2 + x[1], 0.3 * x[0]), 2)
switched = of(lambda x: (x[1], 5 * (1 - x[0]**2) * x[1] - x[0] - np.where(x[1] > 0, .1, .2)), 2)
bounce = sf.Event("x1 - 1/10", to=("x1", "-x2"))
kick = sf.Event(lambda x: x[0] - .1, to=lambda x: (x[0], x[1], -x[2], x[3]), direction=1)
"""
LOOP = """
from suslov_fast.compiled import step, step_system, system, work
@numba.njit(parallel=True)
def of_bodies(system, omega):
    out = np.empty_like(omega)
    for i in numba.prange(len(omega)):
        omega1, omega2 = omega[i, 0], omega[i, 1]
        for _ in range(50):
            omega1, omega2 = step(system, omega1, omega2)
        out[i, 0], out[i, 1] = omega1, omega2
    return out

@numba.njit
def of_a_field(system, x):
    memory = work(system)
    for _ in range(50):
        step_system(system, x, x, memory)
    return x
"""
# Groups that compile much of the same, a process a line: small ones, which Numba compiles nothing
# for; of one orbit or few, as Python or NumPy may carry it out, and of enough for threads, which is
# too much for them.
CALLS = {
    "small": """
run(body, 2, .2, 10)
body.exact([1.0, .5], .2, np.arange(10))
body.first_integral([1.0, .5], .2)
run(body, 2, .2, 10, attitude=True)
sf.lyapunov_exponents(body, [1.0, .5], .2, 100)
run(solid, 4, .2, 10)
run(gyrostat, (10_000, 2), .2, 100)
sf.lyapunov_exponents(field, x(3), .001, 100), sf.lyapunov_exponents(field, x(3), time=2.0)
run(field, (2000, 3), .001, 100, save_every=None)
sf.flow(field, x(3), time=[.1], derivatives=("x0", "rho"))
sf.crossings(field, [1.0, 2.0, 20.0], surface="x1", time=2.0)
sf.periodic_orbit(field, [-13.76, -19.58, 27.0]).state
sf.flow(of(lambda x: (x[1], -np.sin(x[0])), 2), [1.0, .5], time=[1.0])""",
    "bodies": """
run(body, 2, .2, 10), run(body, (4096, 2), .2, 4000, save_every=None), \
run(body, (9000, 2), .2, 200), run(bodies, (300, 2), .2, 20), \
run(bodies, (20, 300, 2), .2, 300, save_every=50), run(gyrostat, 2, .2, 10), \
run(gyrostat, (4096, 2), .2, 4000, save_every=1000)
sf.step(body, [1.0, .5], .2)
run(body, 2, .2, 10, attitude=True), run(body, (1000, 2), .2, 100, attitude=True)
body.first_integral(x(40, 2), .2), sf.kahan.invariant_density(body, x(40, 2), .2)
body.to_xy(x(40, 2)), body.energy(x(40, 2)), body.criticality(x(30000, 2), .2)
body.exact([1.0, .5], .2, np.arange(10)), body.exact(x(20000, 2), .2, np.arange(10))
body.limits([1.0, .5], .2), sf.flow(body, [1.0, .5], time=[1.0, 2.0])
body.scattering_angle()
sf.lyapunov_exponents(gyrostat, x(3, 2), .2, 50), \
sf.lyapunov_exponents(gyrostat, x(2000, 2), .2, 300)
of_bodies(system(body, .2), x(100, 2))""",
    "n dimensions": """
run(solid, 4, .2, 10), run(solid, (1024, 4), .2, 5000, save_every=500)
run(solid, 4, .2, 10, method="gauss"), run(solid, (512, 4), .2, 200, method="gauss")
sf.kahan.jacobian(field, x(2, 3), .01), sf.kahan.jacobian(body, x(2, 2), .2)
sf.kahan.matrix(body, x(2, 2), .2)""",
    "fields": """
run(field, (2048, 3), 3.0, 300, save_every=None, on_singular="ignore")
run(field, 3, .01, 10), run(field, (2048, 3), .01, 300, save_every=50)
sf.step(field, [1.0, 2.0, 20.0], .01)
run(family, (1500, 3), .01, 300, save_every=None)
sf.lyapunov_exponents(field, x(3), .01, 50), sf.lyapunov_exponents(field, x(1000, 3), .01, 300)
of_a_field(system(field, .01), np.ones(3))
run(own, 2, 40, None), run(own, (9000, 2), 40, None)""",
    "methods and sections": """
run(henon, 4, .1, 10, method="order4"), run(henon, (1000, 4), .1, 200, method="order4")
run(henon, (1000, 4), .1, 100, method="order8", save_every=None)
sf.flow(henon, x(4), time=[1.0, 2.0]), sf.flow(henon, x(1000, 4), time=[3.0, 9.0])
sf.flow(henon, x(4), time=5.0, events=kick), sf.flow(henon, x(1000, 4), time=5.0, events=kick)
sf.flow(switched, x(2), time=9, events=bounce), sf.flow(switched, x(5, 2), time=9, events=bounce)
sf.crossings(henon, x(4), surface="x1", time=9.0), \
sf.crossings(henon, x(1000, 4), surface="x1", time=9.0)
sf.periodic_orbit(of(lambda x: (x[0] - x[0]*x[1], x[0]*x[1] - x[1]), 2), [1.0, 2.0], 6.6).state
sf.equilibria(field, x(3))
sf.integrability.report(of(lambda x: (x[1]*x[2], x[2]*x[0], x[0]*x[1]), 3), degree=2)""",
    "many variables": """
run(sf.Field.from_terms(rng.normal(size=(36, 36, 36)), rng.normal(size=(36, 36))), 36, .02, 3)
run(sf.Field.from_terms(rng.normal(size=(36, 36, 36)), rng.normal(size=(36, 36))), (64, 36), .02, 3)
run(of(lorenz_96, 128), 128, .02, 5), run(of(lorenz_96, 128), (64, 128), .02, 20, save_every=None)
run(of(heat, 256), (32, 256), .02, 5, save_every=None)""",
}
# Runs the code that it is given, and writes to a file what Numba compiles.
RECORDED = """
import sys
from pathlib import Path
from numba.core import event
with event.install_recorder("numba:compile") as compiled:
    exec(sys.argv[1], {})
names = [e.data["dispatcher"].py_func.__qualname__ for _, e in compiled.buffer if e.is_start]
Path(sys.argv[2]).write_text(" ".join(names))
"""


@pytest.mark.filterwarnings("ignore")  # as in the other process
@pytest.mark.parametrize("group", CALLS)
def test_first_calls(group, tmp_path):
    """Those of bodies, families and gyrostats compile the same few functions, each once."""
    calls = CALLS[group].strip().splitlines()
    for k, (call, threads) in enumerate(zip(calls, cycle("21"), strict=False)):
        code, names = f"{BEGIN}{LOOP * call.startswith('of_')}\ntell({call})", tmp_path / "names"
        settings = {"SUSLOV_FAST_OPT": "2"}  # as users compile
        if group in ("small", "bodies"):
            settings |= {"NUMBA_CACHE_DIR": str(tmp_path)}
        first = children.run(RECORDED, code, names, NUMBA_NUM_THREADS=threads, **settings)
        usual = io.StringIO()
        with contextlib.redirect_stdout(usual):
            exec(code, {})
        assert first == usual.getvalue() != "", call
        assert group != "small" or names.read_text() == "", call
        if group == "bodies" and k == 0:
            compiled = names.read_text().split()
            assert len(compiled) == len({*compiled}) <= 33
