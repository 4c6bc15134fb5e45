"""Reaction torque of the constraint.

The torque that keeps the body from turning about the constrained axis, while it passes from one
steady rotation to the other: the Lagrange multiplier of the continuous equations on the exact
motion, and that of the discrete equations between two states of the map, with eps = 0.5.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Suslov3D, flow, iterate

body, omega0, eps = Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3), [-0.9, 1.3], 0.5
time = np.linspace(0, 60, 400)
orbit = iterate(body, omega0, eps, steps=120)

figure, axes = plt.subplots(figsize=(6.4, 3.8), layout="constrained")
axes.plot(
    time,
    body.reaction(flow(body, omega0, time=time).states),
    color="steelblue",
    label="continuous",
)
axes.plot(
    orbit.time + eps / 2,
    orbit.body.reaction(orbit.states, orbit.eps),
    "k.",
    label="discrete, between two states",
)
axes.set(xlabel="time", ylabel=r"reaction torque $\lambda$")
axes.set_title(r"$\epsilon = 0.5$")
axes.legend(frameon=False, loc="lower right")
