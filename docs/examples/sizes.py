"""Time of a step over the number of variables.

Processor time of a step of Lorenz's model of the atmosphere, one orbit and one of 64; of Fisher's
equation on square grids; of dense fields; and of the Lyapunov exponents of Lorenz's model, per
step. The line at the bottom is arithmetic alone: elimination divides once for each variable.
"""

import time

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Field, iterate, lyapunov_exponents

EPS, BATCH = 1 / 64, 64


def lorenz_96(D):
    def f(x):
        return [x[i - 1] * (x[(i + 1) % D] - x[i - 2]) - x[i] + 8 for i in range(D)]

    return Field(f, D)


def fisher(D):
    n = round(D**0.5)

    def f(u):
        def at(i, j):
            return u[n * (i % n) + j % n]

        return [
            at(i + 1, j) + at(i - 1, j) + at(i, j + 1) + at(i, j - 1) - 4 * at(i, j)
            + at(i, j) * (1 - at(i, j))
            for i in range(n) for j in range(n)
        ]  # fmt: skip

    return Field(f, D)


def dense(D):
    rng = np.random.default_rng(D)
    return Field.from_terms(rng.normal(size=(D, D, D)) / D**2, -np.eye(D))


def cost(call, least=0.02, repeats=3):
    """Processor time of a call, of short ones the least of several."""
    call()
    times = []
    while len(times) < repeats and not max(times, default=0.0) > 0.1:
        begin, count = time.process_time(), 0
        while not count or time.process_time() - begin < least:
            call()
            count += 1
        times.append((time.process_time() - begin) / count)
    return min(times)


def steps(field, batch):
    count = max(200_000 // field.dimension // batch, 10)
    x = np.random.default_rng(0).uniform(0.5, 1, (batch, field.dimension))
    run = {"save_every": None, "threads": 1}
    return cost(lambda: iterate(field, x, EPS, count, **run)) / (batch * count)


def exponents(field, count):
    x = iterate(field, 8 + np.arange(field.dimension) % 2, EPS, 1000, save_every=None).final
    return cost(lambda: lyapunov_exponents(field, x, EPS, count, threads=1), 0.0, 2) / count


POWERS = 2 ** np.arange(3, 12)
NAMES = "Lorenz-96, exponents", "dense, one of 64", "grid, one orbit", "Lorenz-96, one orbit"
NAMES += ("Lorenz-96, one of 64",)
CURVES = {
    NAMES[0]: (POWERS[:7], lambda D: exponents(lorenz_96(D), 128)),
    NAMES[1]: ([8, 16, 32, 48, 64, 96], lambda D: steps(dense(D), BATCH)),
    NAMES[2]: ([16, 64, 256, 576, 1024, 2025], lambda D: steps(fisher(D), 1)),
    NAMES[3]: (POWERS, lambda D: steps(lorenz_96(D), 1)),
    NAMES[4]: (POWERS, lambda D: steps(lorenz_96(D), BATCH)),
}
figure, axes = plt.subplots(figsize=(5.2, 4.4), layout="constrained")
for (name, (sizes, measure)), marker in zip(CURVES.items(), "P^Dos", strict=True):
    times = [1e6 * measure(int(D)) for D in sizes]
    axes.loglog(sizes, times, marker + "-", fillstyle="none", label=name)
    print(name, *(f"{D}: {each:.3g}" for D, each in zip(sizes, times, strict=True)))
numbers = np.linspace(1, 2, 4096)
quotients = np.empty_like(numbers)
division = 1e6 * cost(lambda: np.divide(1.0, numbers, out=quotients)) / len(numbers)
axes.loglog(POWERS, division * POWERS, "k--", label="a division for each variable")
axes.set(xlabel="number of variables $D$", ylabel="processor time of a step (microseconds)")
axes.set_ylim(3e-3, 1e6)
axes.set_xticks([10, 100, 1000], ["10", "100", "1,000"])
axes.legend(frameon=False, fontsize=8, loc="upper left")
axes.grid(alpha=0.3)
