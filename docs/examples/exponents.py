"""
Lyapunov exponents
==================

An orbit ends on a line of steady states. Along the line nothing grows or shrinks, so one exponent
tends to 0; across it distances shrink by a multiplier of the derivative there, so the other tends
to its logarithm. Both get there like one over the number of steps.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Suslov3D, limits, lyapunov_exponents, multipliers

body, omega, eps = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [1.0, 0.5], 0.2
_, end = limits(body, omega, eps)
expected = np.log(multipliers(body, end[0] / body.I23, eps))

steps = np.unique(np.geomspace(10, 100_000, 25).astype(int))
found = np.array([lyapunov_exponents(body, omega, eps, int(n)) for n in steps])

figure, axes = plt.subplots(figsize=(6.4, 4), layout="constrained")
for k, marker in enumerate("os"):
    axes.loglog(steps, abs(found[:, k] - expected[k]), marker, label=rf"$\lambda_{k + 1}$")
axes.loglog(steps, 2 / steps, "--", color="crimson", label=r"$\propto 1/n$")
axes.set(xlabel="steps n", ylabel="distance from the limit")
axes.legend(frameon=False)
