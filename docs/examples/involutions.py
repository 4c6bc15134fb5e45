"""The map as a product of two involutions.

A *Manin involution* exchanges the two points in which a line through a fixed centre meets a conic
of a pencil. On the conics of the first integral, F = const, the map of the Suslov body and that of
the gyrostat are each the product of two of them (van der Kamp, Celledoni, McLachlan, McLaren,
Owren, Quispel, arXiv:1806.05917, treat pencils of this kind). The centre of the second involution
lies at infinity, in the direction of the line of steady states. The centre of the first follows
from two steps; that the product is the map is then checked exactly, at fifty random points. For the
body it is the point at which the map is undefined, 0/0.
"""

import random
from fractions import Fraction

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Suslov3D
from suslov_fast.integrability import kahan

EPS = Fraction(1, 2)
BODIES = {
    "Suslov body": Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.25),
    "gyrostat, k = 1/2": Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.25, k=0.5),
}


def first_integral(body, x):
    """Numerator and denominator of F, quadratic polynomials."""
    I1, I2, I13, I23 = map(Fraction, (body.I1, body.I2, body.I13, body.I23))
    l = I13 * x[0] + I23 * x[1] + Fraction(getattr(body, "k", 0))
    return I1 * x[0] ** 2 + I2 * x[1] ** 2, 4 * I1 * I2 + (EPS * l) ** 2


def second_point(body, x, direction):
    """The other point of a line through x on the conic of x."""
    P, Q = first_integral(body, x)

    def on_line(t):  # t (a + b t)
        p, q = first_integral(body, [a + t * b for a, b in zip(x, direction, strict=True)])
        return p * Q - q * P

    a, b = (on_line(1) - on_line(-1)) / 2, (on_line(1) + on_line(-1)) / 2
    return [c - a / b * d for c, d in zip(x, direction, strict=True)]


def through(centre, x):
    return [a - b for a, b in zip(centre, x, strict=True)]


def centre(body, step, steady):
    """Where the lines meet that join x with the second involution of its image, for two x."""
    lines = []
    for x in ([Fraction(3), Fraction(1)], [Fraction(-2), Fraction(5)]):
        y = second_point(body, step(x), steady)
        a, b = y[1] - x[1], x[0] - y[0]
        lines.append((a, b, a * x[0] + b * x[1]))
    (a, b, c), (d, e, f) = lines
    return [(c * e - b * f) / (a * e - b * d), (a * f - c * d) / (a * e - b * d)]


figure, axes = plt.subplots(1, 2, figsize=(7.2, 3.8), layout="constrained")
rng = random.Random(0)
for ax, (name, body) in zip(axes, BODIES.items(), strict=True):
    step = kahan(body.field(), EPS)
    steady = [Fraction(body.I23), -Fraction(body.I13)]
    C = centre(body, step, steady)
    for _ in range(50):
        x = [Fraction(rng.randrange(-99, 99), rng.randrange(1, 20)) for _ in range(2)]
        between = second_point(body, x, through(C, x))
        assert tuple(second_point(body, between, steady)) == step(x)
    print(f"{name}: the centre of the first involution is ({C[0]}, {C[1]})")

    # Four steps. The lines of the first involution all meet in its centre, far away.
    levels = np.linspace(-4, 4, 200)
    X = np.array(np.meshgrid(levels, levels))
    P, Q = first_integral(body, X.astype(object))
    ax.contour(*X, (P / Q).astype(float), levels=8, colors="0.8", linewidths=0.8)
    x = [Fraction(3), Fraction(-1, 5)]
    for _ in range(4):
        between, image = second_point(body, x, through(C, x)), step(x)
        first, second = np.array([(x, between), (between, image)], float)
        (one,) = ax.plot(*first.T, "C0-", linewidth=1.2)
        (two,) = ax.plot(*second.T, "C1--", linewidth=1.8)
        (dots,) = ax.plot(*first[0], "ko", markersize=4)
        x = image
    ax.set(title=name, xlabel=r"$\Omega_1$", aspect="equal")
axes[0].set_ylabel(r"$\Omega_2$")
names = "first involution", "second involution", "states of the map"
figure.legend([one, two, dots], names, loc="outside lower center", ncols=3, frameon=False)
