"""The four figures of the paper.

Section 4 of the paper shows orbits of four bodies; these are its bodies and step sizes. Each orbit
leaves the dashed half of the line of steady states, follows a level of the first integral F, and
ends on the solid half. The paper does not state the ranges of the axes. No rigid body has the
parameters of figure 1: its ``admissible_I3()`` is NaN.
"""

import matplotlib.pyplot as plt

from suslov_fast import Suslov3D, plot_phase

figures = [
    (Suslov3D(4, 1, -0.5, -0.3), 0.2, 4.0),
    (Suslov3D(4, 3, -0.4, -0.2), 0.2, 10.0),
    (Suslov3D(4, 2, 0, -0.2), 0.02, 100.0),
    (Suslov3D(3, 3, -0.2, -0.2), 1.0, 3.0),
]
figure, axes = plt.subplots(2, 2, figsize=(7.2, 8), layout="constrained")
for panel, letter, (body, eps, extent) in zip(axes.flat, "abcd", figures, strict=True):
    plot_phase(body, eps, extent, ax=panel)
    panel.set_title(f"({letter})", loc="left", weight="bold", fontsize="medium")
entries = axes[0, 0].get_legend_handles_labels()
figure.legend(*entries, loc="outside lower center", ncols=2, frameon=False)
