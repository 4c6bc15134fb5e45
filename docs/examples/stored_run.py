"""
A run from a Zarr store
=======================

:func:`~suslov_fast.ensemble` writes a run to a Zarr store and opens it as an xarray dataset, from
which it is drawn; eps = 0.2. A second call with more steps continues the run in the store. Colours
show the initial energy.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Suslov3D, energy, ensemble

body = Suslov3D(I1=4, I2=3, I13=-0.4, I23=-0.2)
omega0 = np.random.default_rng(3).uniform(-6, 6, (40, 2))

with tempfile.TemporaryDirectory() as folder:
    store = Path(folder) / "run.zarr"
    data = ensemble(body, omega0, 0.2, 60, store=store, save_every=1)
    first, second = data.omega.transpose("component", "n", ...).to_numpy()
    data = ensemble(body, omega0, 0.2, 120, store=store, save_every=1)
    last = data.omega.isel(n=-1).to_numpy()

figure, axes = plt.subplots(figsize=(6, 5.4), layout="constrained")
level = np.broadcast_to(energy(body, omega0), first.shape)
axes.plot(first, second, "-", color="0.8", linewidth=0.5, zorder=1)
states = axes.scatter(first, second, c=level, s=5, zorder=2)
axes.plot(*last.T, "k+", label="after 60 more steps")
figure.colorbar(states, label="energy")
axes.set(xlabel=r"$\Omega_1$", ylabel=r"$\Omega_2$", aspect="equal")
axes.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0))
