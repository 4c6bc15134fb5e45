"""The half-angle plane.

In the half-angle plane (p, q) a step of the gyrostat is the linear map 1 + e G, whose entries
depend on the level of the first integral alone; p / q is the tangent of half the phase psi of
Omega. With a slow rotor (left) every line through the origin tends to an eigenvector of G, an
attracting steady state; with a fast one (right) points turn around the origin, and the motion is a
rotation. Circles are the powers of the linear map. Black dots are states of the map: only the
direction of a point has a meaning, which is that of psi / 2, read off an orbit with eps = 0.5; they
are drawn at the distance of the circle. Red lines are the eigenvectors.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Suslov3D, iterate

figure, axes = plt.subplots(1, 2, figsize=(7.2, 4.4), layout="constrained")
omega0, eps, steps = [-0.9, 1.1], 0.5, 12
for panel, letter, k in zip(axes, "ab", (0.4, 2.6), strict=True):
    body = Suslov3D(I1=2.3, I2=1.4, I13=0.5, I23=-0.7, k=k)
    e = eps / (2 * np.sqrt(body.I1 * body.I2))
    g = body.I13 / np.sqrt(body.I1) + 1j * body.I23 / np.sqrt(body.I2)

    # The phase of each state of the orbit.
    orbit = iterate(body, omega0, eps, steps).states
    z = orbit @ [np.sqrt(body.I1), 1j * np.sqrt(body.I2)]
    w = z / (1 - 1j * e * (k + (z * g.conjugate()).real))
    A = abs(w[0]) * abs(g)
    psi = np.unwrap(np.angle(w / g))
    directions = np.stack([np.sin(psi / 2), np.cos(psi / 2)])

    # The powers of the linear map, and the field of directions of G.
    G = np.array([[0, A + k], [A - k, 0]])
    powers = [directions[:, 0]]
    for _ in range(steps):
        powers.append(powers[-1] + e * G @ powers[-1])
    powers = np.transpose(powers)
    panel.plot(*directions * np.hypot(*powers), "k.", markersize=4, label="states of the map")
    look = {"marker": "o", "fillstyle": "none", "color": "steelblue", "linewidth": 0.6}
    panel.plot(*powers, markersize=8, label=r"$(1 + e G)^n (p, q)$", **look)
    p, q = np.meshgrid(np.linspace(-3, 3, 40), np.linspace(-3, 3, 40))
    flow = np.tensordot(G, np.stack([p, q]), 1)
    panel.streamplot(p, q, *flow, color="0.8", linewidth=0.6, density=0.7, arrowsize=0.7)
    if abs(k) < A:
        for sign, style, name in ((1, "-", "attracting"), (-1, "--", "repelling")):
            p_end, q_end = 9 * np.array([A + k, sign * np.sqrt(A**2 - k**2)])
            panel.plot([-p_end, p_end], [-q_end, q_end], style, color="crimson", label=name)
    compared = "<" if abs(k) < A else ">"
    panel.set(xlim=(-3, 3), ylim=(-3, 3), aspect="equal", xlabel="$p$", ylabel="$q$")
    panel.set_title(f"({letter})", loc="left", weight="bold", fontsize="medium")
    panel.set_title(f"$k = {k} {compared} A = {A:.2f}$", fontsize="medium")
entries = axes[0].get_legend_handles_labels()
figure.legend(*entries, loc="outside lower center", ncols=4, frameon=False, fontsize="small")
