"""
What the constraint takes
=========================

The torque that keeps the body from turning about its forbidden axis, along a passage: the
multiplier of the continuous equations on the exact motion, and that of the discrete equations
between the states of the map.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Suslov3D, flow, iterate, reaction

body, omega0, eps = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [-0.8, 1.3], 0.5
t = np.linspace(0, 40, 400)
orbit = iterate(body, omega0, eps, steps=80)

figure, axes = plt.subplots(figsize=(6.4, 3.8), layout="constrained")
axes.plot(t, reaction(body, flow(body, omega0, t)), color="steelblue", label="continuous")
axes.plot(orbit.t + eps / 2, orbit.reaction(), "k.", label="discrete, between two states")
axes.set(xlabel="time", ylabel=r"$\lambda$")
axes.legend(frameon=False)
