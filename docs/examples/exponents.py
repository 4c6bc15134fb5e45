"""Lyapunov exponents.

An orbit tends to a line of steady states. Distances along the line are constant: one exponent tends
to 0. Each step multiplies distances across it by a multiplier of the steady state: the other
exponent tends to its logarithm. Both converge like one over the number of steps. Filled symbols are
above the limit, hollow ones below; the distance passes through 0 where they change.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Suslov3D, kahan, lyapunov_exponents

body, omega, eps = Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3), [1.0, 0.5], 0.2
_, end = body.limits(omega, eps)
expected = np.log(kahan.multipliers(body, end, eps)) / eps

steps = np.unique(np.geomspace(10, 100_000, 25).astype(int))
found = np.array([lyapunov_exponents(body, omega, eps, int(n)) for n in steps])

figure, axes = plt.subplots(figsize=(6.4, 4), layout="constrained")
for k, (marker, name) in enumerate((("o", "larger exponent"), ("s", "smaller exponent"))):
    distance, above = found[:, k] - expected[k], found[:, k] > expected[k]
    for chosen, fill, side in ((above, "full", "above"), (~above, "none", "below")):
        if chosen.any():
            look = {"marker": marker, "color": f"C{k}", "fillstyle": fill, "linestyle": "none"}
            limit = f"{expected[k]:.3f}".replace("-", "\N{MINUS SIGN}") if k else "0"
            label = f"{name}, {side} its limit {limit}"
            axes.loglog(steps[chosen], abs(distance[chosen]), label=label, **look)
axes.loglog(steps, 2 / steps, "--", color="crimson", label=r"$\propto 1/n$")
axes.set(xlabel="steps $n$", ylabel=r"distance from the limit, $\epsilon = 0.2$")
axes.legend(frameon=False, loc="upper right", fontsize="small")
