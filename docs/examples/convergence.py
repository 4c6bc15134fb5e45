"""Order of convergence.

The error of the map at a fixed time is of order 2 in the step size, and so is that of the
orientation reconstructed from its states. The exact motion is flow; the
orientation is compared with that of a run with much smaller steps, in the Frobenius norm.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Suslov3D, flow, iterate

body, omega0, time = Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3), [1.0, 0.5], 4.0
end = flow(body, omega0, time=time).states[0]


def run(steps):
    return iterate(body, omega0, time / steps, steps, save_every=None, attitude=True)


finest = run(2**15)
steps = 2 ** np.arange(3, 13)
eps = time / steps
runs = [run(int(n)) for n in steps]
of_omega = [np.linalg.norm(each.final - end) for each in runs]
of_R = [np.linalg.norm(each.attitude[-1] - finest.attitude[-1]) for each in runs]

figure, axes = plt.subplots(figsize=(5.2, 3.9), layout="constrained")
axes.loglog(eps, of_R, "s-", color="steelblue", label=r"orientation $R$")
axes.loglog(eps, of_omega, "o-", color="black", label=r"angular velocity $\Omega$")
guide = 0.3 * of_omega[0] * (eps / eps[0]) ** 2
axes.loglog(eps, guide, "--", color="crimson", label=r"$\propto \epsilon^2$")
axes.set(xlabel=r"step size $\epsilon$", ylabel=f"error at time {time:g}")
axes.legend(frameon=False, loc="upper left")
axes.grid(alpha=0.3)
