"""Scattering angle.

At time minus infinity and at plus infinity the body turns steadily, about two axes in space. The
angle between them (scattering_angle) depends on the body alone. The figure
shows it as a function of the products of inertia, for all bodies with two ratios of I1 and I2;
black lines, also in the colour bar, are at 1, 10 and 30 degrees. Where
Suslov3D.admissible_I3 is NaN, no rigid body has the parameters.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import BoundaryNorm

from suslov_fast import Suslov3D

bounds = [0.01, 0.03, 0.1, 0.3, 1, 3, 10, 20, 30, 45]
style = {"cmap": "viridis", "norm": BoundaryNorm(bounds, 256, extend="min"), "extend": "min"}
I13, I23 = np.linspace(-0.6, 0.6, 241), np.linspace(-0.96, 0.96, 385)

figure, axes = plt.subplots(1, 2, figsize=(6.4, 4.4), sharey=True, layout="constrained")
for panel, ratio in zip(axes, (1, 4), strict=True):
    I1, I2 = np.sqrt(ratio), 1 / np.sqrt(ratio)  # I1 I2 = 1
    body = Suslov3D(I1, I2, I13, I23[:, np.newaxis])
    degrees = np.rad2deg(body.scattering_angle())
    degrees[np.isnan(body.admissible_I3()[0])] = np.nan
    shades = panel.contourf(I13, I23, degrees, bounds, **style)
    lines = panel.contour(I13, I23, degrees, [1, 10, 30], colors="black", linewidths=0.7)
    panel.text(0.04, 0.04, "no body", color="0.35", transform=panel.transAxes)
    panel.set(title=rf"$I_1 / I_2 = {ratio:g}$", xlabel=r"$I_{13} / \sqrt{I_1 I_2}$")
    panel.set(xticks=[-0.5, 0, 0.5], aspect="equal")
axes[0].set_ylabel(r"$I_{23} / \sqrt{I_1 I_2}$")
bar = figure.colorbar(shades, ax=axes, ticks=bounds, format="%g")
bar.add_lines(lines)  # at 1, 10 and 30 degrees
bar.set_label("scattering angle (degrees)")
