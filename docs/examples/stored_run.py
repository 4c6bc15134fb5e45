"""
A run from a Zarr store
=======================

A run is written to a Zarr store, opened as an xarray dataset, and drawn from there. The store also
holds the data from which :meth:`~suslov_fast.Trajectories.extend` continues. Colours show the
initial energy.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

from suslov_fast import Suslov3D, Trajectories, energy, iterate

body = Suslov3D(I1=4, I2=3, I13=-0.4, I23=-0.2)
omega0 = np.random.default_rng(3).uniform(-6, 6, (40, 2))

with tempfile.TemporaryDirectory() as folder:
    store = Path(folder) / "run.zarr"
    iterate(body, omega0, eps=0.2, steps=60).save(store)
    with xr.open_zarr(store, consolidated=False) as data:
        first, second = data.omega.transpose("component", "n", ...).to_numpy()
        start = data.omega.isel(n=0).to_numpy()
    longer = Trajectories.load(store).extend(60)

figure, axes = plt.subplots(figsize=(6, 5.4), layout="constrained")
level = np.broadcast_to(energy(body, start), first.shape)
axes.plot(first, second, "-", color="0.8", linewidth=0.5, zorder=1)
states = axes.scatter(first, second, c=level, s=5, zorder=2)
axes.plot(*longer.final.T, "k+", label="after 60 more steps")
figure.colorbar(states, label="energy")
axes.set(xlabel=r"$\Omega_1$", ylabel=r"$\Omega_2$", aspect="equal")
axes.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0))
