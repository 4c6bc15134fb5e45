"""Kepler's problem for 10,000 periods, without and with its energy kept.

Above, the change of the energy, where 0 is drawn as 1e-17. Below, the error of the position, which
returns after each period. Without the energy the error of the phase grows as the square of time.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Field, flow


def energy(x):
    return (x[2] ** 2 + x[3] ** 2) / 2 - 1 / np.sqrt(x[0] ** 2 + x[1] ** 2)


kepler = Field.from_hamiltonian(energy, "x y u v")
start = [0.4, 0, 0, 2.0]  # pericentre of an ellipse of eccentricity 0.6
periods = np.unique(np.geomspace(1, 10_000, 60).round())

figure, (above, below) = plt.subplots(2, sharex=True, figsize=(5.2, 5.2), layout="constrained")
for label, field in ("flow of field", kepler), ("flow of field.conserving()", kepler.conserving()):
    motion = flow(field, start, time=2 * np.pi * periods)
    change = abs(motion.energy() + 0.5) + 1e-17
    error = np.hypot(*(motion.states[:, :2] - start[:2]).T)
    above.loglog(periods, change, ".-", linewidth=1, label=label)
    below.loglog(periods, error, ".-", linewidth=1, label=label)
above.set(ylabel="change of the energy")
below.set(xlabel="periods", ylabel="error of the position")
below.legend()
