"""Measure rings and lattices from 3 to 4,096 variables, and write a table for the docs.

`python bench/lattices.py` writes `results/lattices.md`. The equations are Fisher's, with one field,
and those of predators and prey that diffuse, with two fields. Columns are processor times: of the
first step of Kahan's map and the first motion, which compile; of a step and of a stiff motion, for
one orbit and for one of eight, after WARM calls; and of SciPy's BDF, with a compiled right-hand
side and the pattern of its derivative. `-k` chooses rows, prints them, and writes nothing.
"""

import argparse
import datetime
import time
from types import SimpleNamespace

import cpuinfo
import numba
import numpy as np
import results
from scipy.integrate import solve_ivp
from scipy.sparse import coo_array
from tables import caption, figure

from suslov_fast import Field, flow, iterate

# Cells, by kind and number of fields.
SIZES = {
    ("ring", 1): [(1, n) for n in (3, 16, 64, 256, 1024, 4096)],
    ("ring", 2): [(1, n) for n in (3, 8, 32, 128, 512, 2048)],
    ("lattice", 1): [(n, n) for n in (2, 4, 8, 12, 16, 22, 32, 64)],
    ("lattice", 2): [(n, n) for n in (2, 4, 8, 11, 16, 22, 32, 45)],
}
RTOL, TIME, EPS = 1e-6, 10.0, 1 / 64
WARM = 8, 6  # calls of one orbit, and of eight, after which LLVM has optimised loops of motions
COLUMNS = (
    "", "D", "make, s", "map: first step, s", "step, µs", "in 8", "motion: first, s", "ms", "in 8",
    "steps", "BDF: ms", "steps",
)  # fmt: skip


def neighbours(n, m):
    """Return the numbers of the cells next to each cell of a torus; a ring has two."""
    cells = np.arange(n * m).reshape(n, m)
    axes = (1,) if n == 1 else (0, 1)
    return np.array([np.roll(cells, shift, axis).ravel() for axis in axes for shift in (-1, 1)])


def rates(x, near, fields):
    """Return f of cells, for arrays, symbols of this package and compiled code."""
    if fields == 1:
        return x * (1.0 - x) + 20.0 * (sum(x[each] for each in near) - len(near) * x)
    u, v = x[0::2], x[1::2]
    spread_u = sum(u[each] for each in near) - len(near) * u
    spread_v = sum(v[each] for each in near) - len(near) * v
    f = np.stack([u * (1.0 - v) + 30.0 * spread_u, v * (u - 1.0) + 60.0 * spread_v], axis=1)
    return f.ravel()


@numba.njit
def compiled_rates(_, x, near, fields):
    f, cells = np.empty_like(x), near.shape[1]
    for i in range(cells):
        for a in range(fields):
            spread = 0.0
            for each in near:
                spread += x[fields * each[i] + a] - x[fields * i + a]
            own = x[fields * i + a]
            if fields == 1:
                f[i] = own * (1.0 - own) + 20.0 * spread
            elif a == 0:
                f[2 * i] = own * (1.0 - x[2 * i + 1]) + 30.0 * spread
            else:
                f[2 * i + 1] = own * (x[2 * i] - 1.0) + 60.0 * spread
    return f


def pattern_of(near, fields):
    i = np.tile(np.arange(near.shape[1]), len(near))
    rows = [fields * i + a for a in range(fields)]
    columns = [fields * near.ravel() + a for a in range(fields)]
    cells = np.arange(near.shape[1])
    for a in range(fields):
        for b in range(fields):
            rows.append(fields * cells + a)
            columns.append(fields * cells + b)
    rows, columns = np.concatenate(rows), np.concatenate(columns)
    return coo_array((np.ones(len(rows)), (rows, columns))).tocsr()


def cost(call, repeats=3):
    """Return the least processor time of a call of several, in seconds, and its result."""
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        found = call()
        times.append(time.process_time() - begin)
        if times[-1] > 2.0:
            break
    return min(times), found


def measure(shape, fields):
    """Return a row of the table."""
    near = neighbours(*shape)
    D = fields * near.shape[1]
    x0 = np.random.default_rng(D).uniform(0.5, 1.5, D)
    batch = x0 * np.linspace(0.9, 1.0, 8)[:, np.newaxis]

    def f(x):
        return rates(x, near, fields)

    make, field = cost(lambda: Field(f, D), 1)
    run = {"save_every": None, "threads": 1}
    first_step, _ = cost(lambda: iterate(field, x0, EPS, 1), 1)
    count = max(10, 40_000 // D)
    steps = [cost(lambda x=x: iterate(field, x, EPS, count, **run))[0] for x in (x0, batch)]
    motion = {"time": TIME, "rtol": RTOL, "threads": 1}
    first, found = cost(lambda: flow(field, x0, **motion), 1)
    motions = []
    for x, calls in zip((x0, batch), WARM, strict=True):
        for _ in range(calls):
            flow(field, x, **motion)
        motions.append(cost(lambda x=x: flow(field, x, **motion))[0])
    options = {"method": "BDF", "rtol": RTOL, "atol": 1e-9, "args": (near, fields)}
    options |= {"jac_sparsity": pattern_of(near, fields)}
    compiled_rates(0.0, x0, near, fields)
    bdf, other = cost(lambda: solve_ivp(compiled_rates, (0.0, TIME), x0, **options), 2)
    return [
        D, make, first_step, steps[0] / count * 1e6, steps[1] / count / 8 * 1e6,
        first, motions[0] * 1e3, motions[1] / 8 * 1e3, int(found.steps),
        bdf * 1e3, other.t.size,
    ]  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-k", dest="select", default="", help="rows whose names begin with this")
    options = parser.parse_args()
    for shape in ((1, 1000), (20, 20)):  # compile what all fields share
        measure(shape, 1)
    info = results.machine(cpuinfo.get_cpu_info().get("brand_raw", ""))
    info = SimpleNamespace(machine=info, date=datetime.date.today().isoformat())
    text = [f"Times are those of the processor, measured on {caption(info)}.", ""]
    text += [f"| {' | '.join(COLUMNS)} |", "|---" + "|---:" * (len(COLUMNS) - 1) + "|"]
    for (kind, fields), shapes in SIZES.items():
        name = f"{kind}, {'one field' if fields == 1 else 'two fields'}"
        if not name.startswith(options.select):
            continue
        for shape in shapes:
            cells = [figure(value, 2 if value < 100 else 4) for value in measure(shape, fields)]
            text.append(f"| {' | '.join([name, *cells])} |")
            print(text[-1], flush=True)
    if not options.select:
        path = results.BENCH / "results" / "lattices.md"
        path.write_text("\n".join(text) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
