"""One map for all bodies.

In X = eps x / (2 sqrt(I1 I2)) and Y = eps y / (2 I1 I2) the map has no parameter. Orbits of twelve
random realizable bodies with twelve step sizes from 0.2 to 1.9 lie on the conics (X**2 + Y**2) / (1
+ X**2) = t**2; thin lines are four of these levels.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Suslov3D, iterate

rng = np.random.default_rng(4)
body = Suslov3D(*rng.uniform(2, 4, (2, 12)), *rng.uniform(-0.6, 0.6, (2, 12)))
assert np.isfinite(body.admissible_I3()).all()
a = body.I1 * body.I2
# Close to the repelling half of the line, on either side of it.
side = rng.choice([-1, 1], 12)
xy = np.stack([0.1 * side * np.sqrt(a), a], axis=-1)
# to_xy is linear.
of_basis = body.to_xy(np.eye(2)[:, np.newaxis]).swapaxes(0, 1)
omega0 = np.einsum("ni,nij->nj", xy, np.linalg.inv(of_basis))
eps = 2 * np.linspace(0.1, 0.95, 12)

orbits = iterate(body, omega0, eps, steps=60)
x, y = np.moveaxis(body.to_xy(orbits.states), -1, 0)

figure, axes = plt.subplots(figsize=(6, 5), layout="constrained")
t = np.broadcast_to(orbits.body.criticality(orbits.states, orbits.eps)[0], x.shape)
X, Y = eps * x / (2 * np.sqrt(a)), eps * y / (2 * a)
for k, marker in enumerate("os^vD<>PX*ph"):
    style = {"marker": marker, "s": 14, "linewidths": 0, "vmin": 0, "vmax": 1}
    states = axes.scatter(X[:, k], Y[:, k], c=t[:, k], **style)
X, Y = np.meshgrid(np.linspace(-1.1, 1.1, 200), np.linspace(-1, 1, 200))
level = np.sqrt((X**2 + Y**2) / (1 + X**2))
lines = axes.contour(X, Y, level, levels=[0.2, 0.4, 0.6, 0.8], colors="gray", linewidths=0.6)
axes.clabel(lines, fmt="$t = %g$", fontsize=7)
axes.set(xlabel="$X$", ylabel="$Y$", xlim=(-1.1, 1.1), ylim=(-1, 1), aspect="equal")
axes.set_title("twelve bodies (one shape of dots each), twelve step sizes", fontsize=10)
figure.colorbar(states, label="criticality $t$")
