"""Energy and modified energy.

The continuous motion conserves the energy. Under the map it rises while the body passes from one
steady rotation to the other, by an amount of order eps squared, and returns. The map conserves the
modified energy to rounding, on the scale of the lower panel.
"""

import matplotlib.pyplot as plt

from suslov_fast import Suslov3D, iterate

body = Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3)
figure, axes = plt.subplots(2, 1, figsize=(6.4, 5), sharex=True, layout="constrained")
for eps, style in ((0.4, "-"), (0.2, "--"), (0.1, ":")):
    orbit = iterate(body, [-0.9, 1.3], eps, steps=round(80 / eps))
    for panel, quantity in zip(axes, (orbit.energy(), orbit.modified_energy()), strict=True):
        panel.plot(orbit.time, quantity / quantity[0] - 1, style, label=rf"$\epsilon = {eps}$")
axes[0].set(ylabel="relative change\nof the energy")
axes[1].set(ylabel="relative change of\nthe modified energy", xlabel="time", ylim=(-6e-15, 6e-15))
figure.suptitle("one passage: the energy returns, the modified energy stays")
axes[0].legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
