"""Work and precision of all methods.

Steps of order 2, 4, 6 and 8 and `flow` beside SciPy's DOP853 and LSODA, the method of Runge and
Kutta in Numba and, where it is installed, heyoka's Taylor integrator, all on one thread, for the
system of Hénon and Heiles until time 100: one orbit, and 1024 side by side. The figure shows the
largest error over processor time; the page "Which discretization?" has the printed tables.
"""

import time

import matplotlib.pyplot as plt
import numba
import numpy as np
from scipy.integrate import solve_ivp

from suslov_fast import Field, flow, iterate

try:
    import heyoka
except ImportError:
    heyoka = None

METHODS = {"order 2": "auto", "order 4": "order4", "order 6": "order6", "order 8": "order8"}
BATCH, UNTIL, LANES = 1024, 100.0, 16


def henon_heiles(x):
    q1, q2, p1, p2 = x
    return (p1**2 + p2**2 + q1**2 + q2**2) / 2 + q1**2 * q2 - q2**3 / 3


field = Field.from_hamiltonian(henon_heiles, "q1 q2 p1 p2")
starts = np.random.default_rng(0).uniform(-0.2, 0.2, (BATCH, 4))


def by_steps(method, count):
    def run(x):
        given = {"save_every": None, "threads": 1, "method": method}
        return iterate(field, x, UNTIL / count, count, **given).final

    return run


def by_flow(tolerance):
    return lambda x: flow(field, x, time=UNTIL, rtol=tolerance, threads=1).states[0]


@numba.njit
def runge_kutta_4(x, eps, steps):
    y, k, total = np.empty(4), np.empty(4), np.empty(4)
    for state in x:
        for _ in range(steps):
            total[:], y[:] = 0.0, state
            for part, weight in ((0.5, 1.0), (0.5, 2.0), (1.0, 2.0), (0.0, 1.0)):
                q1, q2, p1, p2 = y
                k[0], k[1], k[2], k[3] = p1, p2, -q1 - 2 * q1 * q2, -q2 - q1 * q1 + q2 * q2
                for i in range(4):
                    total[i] += weight * k[i]
                    y[i] = state[i] + part * eps * k[i]
            for i in range(4):
                state[i] += eps / 6 * total[i]


def by_numba(count):
    def run(x):
        x = x.copy()
        runge_kutta_4(x, UNTIL / count, count)
        return x

    return run


def by_scipy(tolerance, method="DOP853"):
    """All orbits as one system, with the steps of the most demanding one."""

    def right(t, y):
        q1, q2, p1, p2 = y.reshape(4, -1)
        return np.concatenate([p1, p2, -q1 - 2 * q1 * q2, -q2 - q1 * q1 + q2 * q2])

    def run(x):
        given = {"method": method, "rtol": tolerance, "atol": tolerance / 10}
        last = solve_ivp(right, (0, UNTIL), x.T.ravel(), t_eval=[UNTIL], **given)
        return last.y[:, 0].reshape(4, -1).T

    return run


def by_heyoka(tolerance):
    q1, q2, p1, p2 = heyoka.make_vars("q1", "q2", "p1", "p2")
    right = [(q1, p1), (q2, p2), (p1, -q1 - 2 * q1 * q2), (p2, -q2 - q1 * q1 + q2 * q2)]
    alone = heyoka.taylor_adaptive(right, np.zeros(4), tol=tolerance)
    several = heyoka.taylor_adaptive_batch(right, np.zeros((4, LANES)), tol=tolerance)

    def run(x):
        final, size = np.empty_like(x), LANES if len(x) > 1 else 1
        integrator = several if len(x) > 1 else alone
        for k in range(0, len(x), size):
            integrator.set_time(0.0) if size > 1 else setattr(integrator, "time", 0.0)
            integrator.state[:] = x[k : k + size].T if size > 1 else x[0]
            integrator.propagate_until(UNTIL)
            final[k : k + size] = integrator.state.T
        return final

    return run


def cost(run, x, repeats=3):
    """Processor time of a call, of short ones the least of several, and its result."""
    result, times = run(x), []
    while len(times) < repeats and not max(times, default=0.0) > 0.1:
        begin, count = time.process_time(), 0
        while time.process_time() - begin < 0.002:
            run(x)
            count += 1
        times.append((time.process_time() - begin) / count)
    return min(times), result


# %%
# The largest change of the energy of 16 orbits over a million steps: in the first thousand, ten
# thousand, and in all.

some = np.random.default_rng(0).uniform(-0.25, 0.25, (16, 4))
for name, method in METHODS.items():
    for eps in (1 / 2, 1 / 4, 1 / 8):
        run = iterate(field, some, eps, 1_000_000, save_every=100, method=method)
        change = abs(run.energy() - field.energy(some))
        print(f"{name} {eps:6g}", *(f"{change[:k].max():8.0e}" for k in (11, 101, 10_001)))

# %%
# Time and error. The reference is order 8 with 6400 steps, whose error is rounding.

reference = by_steps("order8", 6400)(starts)
SOLVERS = {
    "order 2": [by_steps("auto", 100 * 4**k) for k in range(1, 7)],
    "order 4": [by_steps("order4", 100 * 2**k) for k in range(9)],
    "order 6": [by_steps("order6", 100 * 2**k) for k in range(7)],
    "order 8": [by_steps("order8", 50 * 2**k) for k in range(6)],
    "flow": [by_flow(10.0**-k) for k in (2, 4, 6, 8, 10, 12, 13)],
    "DOP853 (SciPy)": [by_scipy(10.0**-k) for k in range(3, 14, 2)],
    "LSODA (SciPy)": [by_scipy(10.0**-k, "LSODA") for k in range(3, 14, 2)],
    "order 4, Runge and Kutta": [by_numba(200 * 4**k) for k in range(7)],
}
if heyoka:
    SOLVERS["heyoka"] = [by_heyoka(10.0**-k) for k in (2, 4, 6, 8, 10, 12, 14, 16)]
figure, panels = plt.subplots(1, 2, figsize=(9.6, 4.4), layout="constrained", sharey=True)
for panel, batch in zip(panels, (1, BATCH), strict=True):
    x = starts[:batch]
    print(f"{batch} orbits: microseconds an orbit at the errors 1e-3, 1e-6, 1e-9, 1e-12")
    for k, (name, runs) in enumerate(SOLVERS.items()):
        if "LSODA" in name and batch > 1:  # whose matrices are dense
            continue
        if batch > 1:  # fewer of the slow ones
            runs = runs[::2] if "DOP853" in name else runs
            runs = runs[:5] if "Kutta" in name else runs
        times, results = zip(*[cost(run, x) for run in runs], strict=True)
        times = [1e6 * each / batch for each in times]
        errors = [abs(each - reference[:batch]).max() for each in results]
        style = {"marker": "osD^XvP<>"[k], "color": f"C{k}", "fillstyle": "none"}
        panel.loglog(times, errors, label=name, **style)
        order = np.argsort(errors)
        found = np.exp(
            np.interp(
                np.log([1e-3, 1e-6, 1e-9, 1e-12]),
                np.log(np.array(errors)[order]),
                np.log(np.array(times)[order]),
                left=np.nan,
                right=np.nan,
            )
        )
        print(f"{name:25s}", *(f"{each:9.3g}" for each in found))
    panel.set(xlabel="processor time of an orbit (microseconds)")
    panel.set_title("one orbit" if batch == 1 else f"{batch:,} orbits, each")
panels[0].set(ylabel="largest error at time 100", ylim=(1e-14, 1))
figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=5)
