"""Sweep over bodies and step sizes.

A sweep is an ordinary batch. For each of 60 bodies and 48 step sizes, 2,000 random states with
components between -2 and 2 are drawn; the colour is the fraction of them with t >= 1, whose orbits
do not follow the continuous motion.
"""

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

from suslov_fast import Suslov3D

I13 = np.linspace(0.02, 0.9, 60)
eps = np.geomspace(2, 100, 48)
omega = np.random.default_rng(0).uniform(-2, 2, (2000, 2))

bodies = Suslov3D(I1=4, I2=2, I13=I13[:, None, None], I23=-0.3)
t = xr.DataArray(
    bodies.criticality(omega, eps[:, None]),
    dims=("I13", "eps", "state"),
    coords={"I13": I13, "eps": eps},
)
fraction = (t >= 1).mean("state")

figure, axes = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
fraction.plot(ax=axes, y="eps", yscale="log", cbar_kwargs={"label": r"fraction with $t \geq 1$"})
axes.set(xlabel=r"$I_{13}$", ylabel=r"step size $\epsilon$")
axes.set_yticks([2, 5, 10, 20, 50, 100], labels=[2, 5, 10, 20, 50, 100])
axes.minorticks_off()
axes.set_title(
    "states whose orbits do not follow the motion, $I_1 = 4$, $I_2 = 2$, $I_{23} = -0.3$",
    fontsize="medium",
)
