"""
A run from a Zarr store
=======================

A run is written to a Zarr store, opened again as an xarray dataset, and drawn from there. The store
holds all that is needed to go on with the run.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

from suslov_fast import Suslov3D, Trajectories, iterate

body = Suslov3D(I1=4, I2=3, I13=-0.4, I23=-0.2)
omega0 = np.random.default_rng(3).uniform(-6, 6, (40, 2))

with tempfile.TemporaryDirectory() as folder:
    store = Path(folder) / "run.zarr"
    iterate(body, omega0, eps=0.2, steps=60).save(store)
    with xr.open_zarr(store, consolidated=False) as data:
        first, second = data.omega.transpose("component", "n", ...).to_numpy()
    longer = Trajectories.load(store).extend(60)

figure, axes = plt.subplots(figsize=(5, 5), layout="constrained")
axes.plot(first, second, ".-", linewidth=0.5, markersize=3)
axes.plot(*longer.final.T, "k+", label="after 60 steps more")
axes.set(xlabel=r"$\Omega_1$", ylabel=r"$\Omega_2$", aspect="equal")
axes.legend(frameon=False)
