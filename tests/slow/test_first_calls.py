"""Each kind of call as the first one of a process.

What other calls do before hides what a kind of call lacks, so each has a process of its own, every
other one on one thread, and finds the bits of this process. A process finds compiled what those
before it in its group have compiled, and the first of a group finds nothing. `.ci/run` begins with
that of the command.
"""

import contextlib
import io
from itertools import cycle

import children
import pytest

pytestmark = [pytest.mark.compiled]

BODY = "body = sf.Suslov3D(4, 1, -0.5, -0.3)"
GYROSTAT = "body = sf.SuslovGyrostat(4, 1, -0.5, -0.3, 0.7)"
SOLID = "body = sf.SuslovND([1.3, 2.1, 3.7, 4.2], [0.4, -0.7, 0.5, 0.2])"
LORENZ = """
def lorenz(x, rho):
    return 10 * (x[1] - x[0]), x[0] * (rho - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]
field = sf.QuadraticField.from_function(lorenz, 3, rho=28.0)
"""
HENON = """
H = lambda x: sum(v * v for v in x) / 2 + x[0]**2 * x[1] - x[1]**3 / 3
field = sf.QuadraticField.from_hamiltonian(H, 4)
"""
CHAIN = """
def chain(x):
    D = len(x)
    return [(x[(k + 1) % D] - x[k - 2]) * x[k - 1] - x[k] + 8 for k in range(D)]
"""
# Groups that compile much of the same, names, and what they call: one orbit or few, as Python or
# NumPy may carry it out, and enough for threads, which is too much for them.
CALLS = {
    "bodies": {
        "body": f"{BODY}\nrun(body, 2, .2, 10)\nrun(body, (4096, 2), .2, 4000, save_every=None)\n"
        "run(body, (9000, 2), .2, 200)\n"
        "bodies = sf.Suslov3D(np.linspace(3, 4, 300), 1, -0.5, -0.3)\n"
        "run(bodies, (300, 2), .2, 20)\nrun(bodies, (20, 300, 2), .2, 300, save_every=50)\n"
        f"{GYROSTAT}\nrun(body, 2, .2, 10)\nrun(body, (4096, 2), .2, 4000, save_every=1000)",
        "step": f"{BODY}\nfound.append(sf.step(body, [1.0, .5], .2))",
        "orientations": f"{BODY}\nrun(body, 2, .2, 10, attitude=True)\n"
        "run(body, (1000, 2), .2, 100, attitude=True)",
        "quantities": f"""
{BODY}
x = states((40, 2))
found += [f(body, x, .2) for f in (sf.first_integral, sf.invariant_density)]
found += [*sf.to_xy(body, x), sf.energy(body, x), sf.criticality(body, x, .2)]
found.append(sf.first_integral(body, states((30000, 2)), .2))""",
        "closed form": f"""
{BODY}
found.append(sf.exact(body, [1.0, .5], .2, np.arange(10)))
found.append(sf.exact(body, states((20000, 2)), .2, np.arange(10)))
found.extend(sf.limits(body, [1.0, .5], .2))
found.append(sf.flow(body, [1.0, .5], time=[1.0, 2.0]))""",
        "scattering": f"{BODY}\nfound.append(sf.scattering_angle(body))",
        "exponents of a body": f"""
{GYROSTAT}
found.append(sf.lyapunov_exponents(body, states((3, 2)), .2, 50))
found.append(sf.lyapunov_exponents(body, states((2000, 2)), .2, 300))""",
        "ensemble": f"""
{BODY}
with tempfile.TemporaryDirectory() as folder:
    data = sf.ensemble(body, states((3000, 2)), .2, 400, store=folder + "/store", save_every=100)
    found.append(data["omega"].values)""",
        "loop of a user over bodies": f"""
{BODY}
from suslov_fast.compiled import step, system
@numba.njit(parallel=True)
def last(system, omega):
    out = np.empty_like(omega)
    for i in numba.prange(len(omega)):
        omega1, omega2 = omega[i, 0], omega[i, 1]
        for _ in range(50):
            omega1, omega2 = step(system, omega1, omega2)
        out[i, 0], out[i, 1] = omega1, omega2
    return out
found.append(last(system(body, .2), states((100, 2))))""",
    },
    "n dimensions": {
        "four dimensions": f"{SOLID}\nrun(body, 4, .2, 10)\n"
        "run(body, (1024, 4), .2, 5000, save_every=500)",
        "other methods": f"{SOLID}\nfor method in 'auto', 'gauss':\n"
        "    run(body, 4, .2, 10, method=method)\n    run(body, (512, 4), .2, 200, method=method)",
        "jacobian": f"{LORENZ}\nfound.append(sf.jacobian(field, states((2, 3)), .01))\n"
        f"{BODY}\nfound.append(sf.jacobian(body, states((2, 2)), .2))\n"
        "found.append(sf.matrix(body, states((2, 2)), .2))",
    },
    "fields": {
        "poles": f"{LORENZ}\n"
        "run(field, (2048, 3), 3.0, 300, save_every=None, on_singular='ignore')",
        "field": f"{LORENZ}\nrun(field, 3, .01, 10)\n"
        "run(field, (2048, 3), .01, 300, save_every=50)",
        "step of a field": f"{LORENZ}\nfound.append(sf.step(field, [1.0, 2.0, 20.0], .01))",
        "family": f"""{LORENZ}
family = sf.QuadraticField.from_function(lorenz, 3, rho=np.linspace(20, 30, 1500))
run(family, (1500, 3), .01, 300, save_every=None)""",
        "exponents": f"""
{LORENZ}
found.append(sf.lyapunov_exponents(field, states(3), .01, 50))
found.append(sf.lyapunov_exponents(field, states((1000, 3)), .01, 300))""",
        "loop of a user over a field": f"""
{LORENZ}
from suslov_fast.compiled import step_system, system, work
@numba.njit
def last(system, x):
    memory = work(system)
    for _ in range(50):
        step_system(system, x, x, memory)
    return x
found.append(last(system(field, .01), np.ones(3)))""",
    },
    "methods and sections": {
        "order 4": f"{HENON}\nrun(field, 4, .1, 10, method='order4')\n"
        "run(field, (1000, 4), .1, 200, method='order4', save_every=50)",
        "order 8": f"{HENON}\nrun(field, (1000, 4), .1, 100, method='order8', save_every=None)",
        "motion": f"{HENON}\nfound.append(sf.flow(field, states(4), time=[1.0, 2.0]))\n"
        "found.append(sf.flow(field, states((1000, 4)), time=[3.0, 9.0]))",
        "changes and sections of motions": f"""
{HENON}
kick = sf.Change(lambda x: x[0] - .1, to=lambda x: (x[0], x[1], -x[2], x[3]), direction=1)
for count in (), (1000,):
    motion = sf.flow(field, .2 * states((*count, 4)), time=5.0, changes=kick)
    section = sf.crossings(field, .2 * states((*count, 4)), surface="x1", time=9.0, direction=0)
    found += [motion.x, motion.changes.count, section.states, section.time]""",
        "crossings": f"""
{HENON}
for count in 1, 1000:
    section = sf.crossings(field, states((count, 4)), .1, 300, lambda x: x[..., 0])
    found += [section.states, section.fraction]""",
        "periodic orbit": """
field = sf.QuadraticField.from_function(lambda x: (x[0] - x[0]*x[1], x[0]*x[1] - x[1]), 2)
orbit = sf.periodic_orbit(field, [1.0, 2.0], period=6.6, steps=120)
found += [orbit.state, orbit.multipliers]""",
        "fixed points": f"{LORENZ}\nfound.append(sf.fixed_points(field))",
        "report": """
from suslov_fast.integrability import report
top = sf.QuadraticField.from_function(lambda x: (x[1]*x[2], x[2]*x[0], x[0]*x[1]), 3)
text.append(str(report(top, degree=2)))""",
    },
    "many variables": {
        "one dense orbit": """
q, l = rng.normal(size=(36, 36, 36)), rng.normal(size=(36, 36))
run(sf.QuadraticField(q, l), 36, .02, 3)""",
        "dense": """
q, l = rng.normal(size=(36, 36, 36)), rng.normal(size=(36, 36))
run(sf.QuadraticField(q, l), (64, 36), .02, 3)""",
        "long list": f"{CHAIN}\nfield = sf.QuadraticField.from_function(chain, 128)\n"
        "run(field, 128, .02, 5)\nrun(field, (64, 128), .02, 20, save_every=None)",
        "grid": """
def heat(x):
    u = np.array(x).reshape(16, 16)
    near = sum(np.roll(u, s, axis) for s in (1, -1) for axis in (0, 1))
    return (near - 4 * u + u - u * u).ravel()
run(sf.QuadraticField.from_function(heat, 256), (32, 256), .02, 5, save_every=None)""",
    },
}  # fmt: skip
BEGIN = """
import contextlib, hashlib, tempfile, warnings
import numba, numpy as np, suslov_fast as sf
rng = np.random.default_rng(1)
found, text = [], []

def states(shape):
    return rng.uniform(-0.3, 0.3, shape)

def run(system, shape, eps, steps, **options):
    it = sf.iterate(system, states(shape), eps, steps, **options)
    found.extend([it.states, it.final, it.status, it.failed_at])
    if it.attitude is not None:
        found.append(it.attitude)
"""
END = """
for array in map(np.asarray, found):
    assert array.size, array.shape
    print(array.shape, hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest())
print(*text, sep="\\n")
"""


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
    for (name, call), threads in zip(CALLS[group].items(), cycle("21"), strict=False):
        code, names = "\n".join([BEGIN, call, END]), tmp_path / "names"
        settings = {"NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_NUM_THREADS": threads}
        first = children.run(RECORDED, code, names, **settings)
        usual = io.StringIO()
        with contextlib.redirect_stdout(usual):
            exec(code, {})
        assert first == usual.getvalue() != "", name
        if name == "body":
            compiled = names.read_text().split()
            assert len(compiled) == len({*compiled}) <= 30
