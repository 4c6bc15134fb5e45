"""A strange attractor, and the exponents of a chain.

Left, an orbit of the Lorenz system in space, its states at 4000 times. Right, all Lyapunov
exponents of the motion of a chain of 20 variables (Lorenz 1996), per unit of time: nearby
orbits diverge in six directions, and the sum is -20, the divergence of the equations.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Field, flow, lyapunov_exponents


def lorenz(x):
    return 10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]


def lorenz_96(x):
    return [x[i - 1] * (x[(i + 1) % len(x)] - x[i - 2]) - x[i] + 8 for i in range(len(x))]


figure = plt.figure(figsize=(8, 3.8), layout="constrained")
space = figure.add_subplot(1, 2, 1, projection="3d")
field = Field(lorenz, "x y z")
flow(field, [1, 1, 20], time=np.linspace(10, 50, 4000)).plot("x", "y", "z", ax=space)
space.view_init(elev=18, azim=-60)
space.set_box_aspect(None, zoom=0.85)
space.set_yticks([-20, 0, 20])

chain = Field(lorenz_96, 20)
start = 8 + np.random.default_rng(1).normal(size=20)
exponents = lyapunov_exponents(chain, start, time=200, transient=20, rtol=1e-6)
print(exponents.round(2), exponents.sum().round(6))
bars = figure.add_subplot(1, 2, 2)
k = np.arange(1, 21)
bars.bar(k, exponents, color=np.where(exponents > 0, "crimson", "steelblue"))
bars.axhline(0, color="black", linewidth=0.8)
bars.set(xlabel="$k$", ylabel=r"exponent $\lambda_k$", xticks=[1, 5, 10, 15, 20])
