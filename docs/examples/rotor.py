"""A rotor turns scattering into rotation.

Seven gyrostats start with the same angular velocity and differ in the momentum k of the rotor. Up
to k = A, Omega goes from one steady state to another and stays there; A depends on the level of the
first integral, and close to it the passage takes long. Beyond A there is no steady state to go to:
Omega turns for ever, first in rare jumps, then evenly. On the right: the turns of the map per step,
measured over the last 8,000 of 10,000 steps, and their exact mean,
rotation_number, which is 0 up to A.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Suslov3D, iterate

moments, omega0, eps = {"I1": 4, "I2": 2, "I13": -0.5, "I23": -0.3}, [-1.2, 1.6], 0.2


def turned(k, steps):
    """Turns of Omega since the start, and A, for rotors of momentum k."""
    body = Suslov3D(**moments, k=k)
    run = iterate(body, omega0, eps, steps)
    phi = np.unwrap(np.arctan2(*np.moveaxis(run.states * np.sqrt([4, 2]), -1, 0)[::-1]), axis=0)
    R = 2 * np.sqrt(body.I1 * body.I2 * run.first_integral()[0])
    A = R * np.sqrt(body.I13**2 / body.I1 + body.I23**2 / body.I2)
    return run.time, (phi - phi[0]) / (2 * np.pi), A


k = np.array([0.0, 0.5, 0.9, 1.0, 1.1, 1.3, 1.8])
time, turns, A = turned(k, 600)
figure, axes = plt.subplots(1, 2, figsize=(7.2, 3.6), layout="constrained")
colours = plt.colormaps["viridis"](np.linspace(0, 0.9, len(k)))
for each, curve, ratio, colour in zip(k, turns.T, k / A, colours, strict=True):
    style = "-" if ratio > 1 else "--"
    axes[0].plot(time, curve, style, color=colour, label=f"{each:.1f} ({ratio:.2f})")
axes[0].set(xlabel="time", ylabel=r"turns of $\Omega$")
axes[0].legend(title="$k$ ($k / A$)", frameon=False, fontsize="small", title_fontsize="small")

many = np.linspace(0, 2, 81)
_, turns, A = turned(many, 10_000)
axes[1].plot(many, (turns[-1] - turns[2000]) / 8000, "k.", markersize=4, label="measured")
formula = Suslov3D(**moments, k=many).rotation_number(omega0, eps)
axes[1].plot(many, formula, color="crimson", linewidth=1, label="rotation number")
axes[1].axvline(np.interp(0, many - A, many), color="0.7", linewidth=0.8, label="$k = A$")
axes[1].set(xlabel="momentum $k$ of the rotor", ylabel=rf"turns per step, $\epsilon = {eps}$")
axes[1].legend(frameon=False, fontsize="small")
figure.suptitle("a rotor with $k > A$ makes the angular velocity turn for ever")
