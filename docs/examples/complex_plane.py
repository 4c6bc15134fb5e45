"""Complex variables: Newton's method for z³ = 1, and point vortices.

Left, 250,000 initial values of Newton's map; the colour tells which root they reach. Right, two
pairs of point vortices of opposite strength, which pass through each other in turn; dots are the
initial positions.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Field, Map, flow, iterate

newton = Map(lambda z: (z[0] - (z[0] ** 3 - 1) / (3 * z[0] ** 2),), "z", complex=True)
x = np.linspace(-1.5, 1.5, 500)
grid = x + 1j * x[:, np.newaxis]
ends = iterate(newton, grid[..., np.newaxis], steps=40).final[..., 0]

strengths = [1, -1, 1, -1]


def vortices(z):
    rates = []
    for i in range(4):
        total = sum(strengths[j] / (z[i] - z[j]) for j in range(4) if j != i)
        rates.append(np.conj(total / (2j * np.pi)))
    return rates


starts = [0.6j, -0.6j, 1j, -1j]
motion = flow(Field(vortices, "a b c d", complex=True), starts, time=np.linspace(0, 16, 1000))

figure, (left, right) = plt.subplots(
    1, 2, figsize=(8, 3.8), layout="constrained", width_ratios=[1, 1.4]
)
left.imshow(np.angle(ends), extent=(-1.5, 1.5, -1.5, 1.5), origin="lower", cmap="viridis")
left.set(xlabel="Re z", ylabel="Im z", title="Newton's method for $z^3 = 1$")
for name in motion.names:
    z = motion[name]
    (line,) = right.plot(z.real, z.imag, linewidth=1.2)
    right.plot(z.real[0], z.imag[0], "o", color=line.get_color())
right.set(xlabel="Re z", ylabel="Im z", title="Vortices that leapfrog", aspect="equal")
