"""Orbits of the Suslov body, and of a field with a cubic Hamiltonian.

Left, figure 2 of the paper: every orbit leaves the dashed half of the line of steady states and
tends to the solid half; thin lines are levels of the first integral of the map. Right, orbits of
the map of a cubic Hamiltonian around its centre: the map conserves the modified energy exactly.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Field, Suslov3D, iterate, plot_phase

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 4.2), layout="constrained")
plot_phase(Suslov3D(4, 3, -0.4, -0.2), 0.2, 10.0, ax=left)
left.set_title("the Suslov body of figure 2")

field = Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 + x[0] ** 2 / 2 - x[0] ** 3 / 3, 2)
starts = np.stack([np.linspace(0.1, 0.95, 8), np.zeros(8)], axis=-1)
run = iterate(field, starts, eps=0.4, steps=400)
run.plot(ax=right, lines=False, color=run.modified_energy()[0])
figure.axes[-1].set_ylabel("modified energy")
right.set_title(r"$x' = K\,\nabla H$, $H$ cubic")
right.set_aspect("equal")
