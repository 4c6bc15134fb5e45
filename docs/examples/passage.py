"""Time of passage.

The number of steps until an orbit is half way between its two steady states, where y = 0 and, in
the closed form, theta = k1 n eps + k2 vanishes; here eps = 1.5. It diverges at the dashed,
repelling half of the line, and is negative for states past the middle. Outside the black lines, t
>= 1, and orbits jump instead of passing.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Suslov3D

body, eps = Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3), 1.5
axis = np.linspace(-16, 16, 400)
omega = np.stack(np.meshgrid(axis, axis), axis=-1)
constants = body.closed_form(omega, eps)
n = np.where(constants.t < 1, -constants.k2 / (constants.k1 * eps), np.nan)

figure, axes = plt.subplots(figsize=(6.4, 4.8), layout="constrained")
image = axes.pcolormesh(axis, axis, n, cmap="coolwarm", vmin=-4, vmax=4, rasterized=True)
# Negative levels are dashed, for prints in grey.
axes.contour(axis, axis, n, levels=[-2, -1, -0.5, 0.5, 1, 2], colors="0.3", linewidths=0.6)
axes.contour(axis, axis, constants.t, levels=[1.0], colors="black")
axes.plot([], [], color="black", label="$t = 1$")
line = np.array([body.I23, -body.I13]) / np.hypot(body.I13, body.I23)
for sign, style, name in ((40, "--", "repelling"), (-40, "-", "attracting")):
    ends = np.outer([0, sign], line)
    axes.plot(*ends.T, style, color="crimson", linewidth=1.5, label=f"{name} steady states")
axes.set(xlim=(-16, 16), ylim=(-16, 16), aspect="equal")
axes.set(xlabel=r"$\Omega_1$", ylabel=r"$\Omega_2$")
figure.suptitle(r"$\epsilon = 1.5$")
axes.legend(frameon=False, ncols=3, fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1))
figure.colorbar(image, label="steps to the middle of the passage", extend="both")
