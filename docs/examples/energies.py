"""
Energy and modified energy
==========================

The continuous motion conserves the energy E. The map does not: E rises while the body passes from
one steady rotation to the other, by an amount of order eps squared, and comes back. What the map
conserves is the modified energy, to rounding.
"""

import matplotlib.pyplot as plt

from suslov_fast import Suslov3D, iterate

body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
figure, axes = plt.subplots(figsize=(6.4, 4), layout="constrained")
for eps, style in ((0.4, "-"), (0.2, "--"), (0.1, ":")):
    orbit = iterate(body, [-0.8, 1.3], eps, steps=round(60 / eps))
    for quantity, colour in ((orbit.energy(), "crimson"), (orbit.modified_energy(), "black")):
        axes.plot(orbit.t, quantity / quantity[0] - 1, style, color=colour)
    axes.plot([], [], style, color="gray", label=rf"$\epsilon = {eps}$")
axes.plot([], [], color="crimson", label="energy")
axes.plot([], [], color="black", label="modified energy")
axes.set(xlabel="time", ylabel="relative change")
axes.legend(frameon=False)
