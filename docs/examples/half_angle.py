"""
The half-angle plane
====================

In the half-angle plane (u, v) a step of the gyrostat is the linear map 1 + delta B, whose entries
depend on the level of the first integral alone; u / v is the tangent of half the phase of Omega.
With a slow rotor (left) every line through the origin tends to an eigenvector of B, an attracting
steady state; with a fast one (right) points turn on spirals around the origin, and the motion is a
rotation. Black dots are states of the map, read off an orbit, of length 1; circles are the powers
of the linear map; red lines are the eigenvectors.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import SuslovGyrostat, iterate

figure, axes = plt.subplots(1, 2, figsize=(7.2, 4.4), layout="constrained")
omega0, eps, steps = [-0.9, 1.1], 0.5, 12
for panel, letter, k in zip(axes, "ab", (0.4, 2.6), strict=True):
    body = SuslovGyrostat(I1=2.3, I2=1.4, I13=0.5, I23=-0.7, k=k)
    delta = eps / (2 * np.sqrt(body.I1 * body.I2))
    chi = body.I13 / np.sqrt(body.I1) + 1j * body.I23 / np.sqrt(body.I2)

    # The phase of each state of the orbit.
    orbit = iterate(body, omega0, eps, steps).omega
    z = orbit @ [np.sqrt(body.I1), 1j * np.sqrt(body.I2)]
    w = z / (1 - 1j * delta * (k + (z / chi).real * abs(chi) ** 2))
    A = abs(w[0]) * abs(chi)
    psi = np.unwrap(np.angle(w / chi))
    points = np.stack([np.sin(psi / 2), np.cos(psi / 2)])
    panel.plot(*points, "k.", markersize=5, label="states of the map")

    # The powers of the linear map, and the field of directions of B.
    B = np.array([[0, A + k], [A - k, 0]])
    powers = [points[:, 0]]
    for _ in range(steps):
        powers.append(powers[-1] + delta * B @ powers[-1])
    look = {"marker": "o", "fillstyle": "none", "color": "steelblue", "linewidth": 0.6}
    panel.plot(*np.transpose(powers), markersize=5, label=r"$(1 + \delta B)^n (u, v)$", **look)
    u, v = np.meshgrid(np.linspace(-3, 3, 40), np.linspace(-3, 3, 40))
    flow = np.tensordot(B, np.stack([u, v]), 1)
    panel.streamplot(u, v, *flow, color="0.8", linewidth=0.6, density=0.7, arrowsize=0.7)
    if abs(k) < A:
        for sign, style, name in ((1, "-", "attracting"), (-1, "--", "repelling")):
            u_end, v_end = 9 * np.array([A + k, sign * np.sqrt(A**2 - k**2)])
            panel.plot([-u_end, u_end], [-v_end, v_end], style, color="crimson", label=name)
    compared = "<" if abs(k) < A else ">"
    panel.set(xlim=(-3, 3), ylim=(-3, 3), aspect="equal", xlabel="$u$", ylabel="$v$")
    panel.set_title(f"({letter})", loc="left", weight="bold", fontsize="medium")
    panel.set_title(f"$|k| {compared} A$", fontsize="medium")
entries = axes[0].get_legend_handles_labels()
figure.legend(*entries, loc="outside lower center", ncols=4, frameon=False, fontsize="small")
