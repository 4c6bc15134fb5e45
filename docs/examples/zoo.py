"""
A zoo of Kahan maps
===================

Orbits of the maps of twenty quadratic fields, in the plane of two components. The first twelve maps
are integrable. Orbits whose largest Lyapunov exponent exceeds 0.02 per unit of time are red.
:doc:`This page </theory/zoo>` has the equations, their sources and the table.
"""

from fractions import Fraction
from functools import cache
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import to_rgba

from suslov_fast import QuadraticField, Suslov3D, SuslovGyrostat, iterate, lyapunov_exponents
from suslov_fast.integrability import darboux_polynomials, degrees, growth, hk_bases, kahan

of_function, of_hamiltonian = QuadraticField.from_function, QuadraticField.from_hamiltonian


def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def scaled(numbers, x):
    return [a * b for a, b in zip(numbers, x, strict=True)]


def volterra(N):
    """A periodic chain: each species eats the next and is eaten by the one before."""
    return of_function(lambda x: [x[k] * (x[(k + 1) % N] - x[k - 1]) for k in range(N)], N)


def rigid_body(*beta):
    """The gyrostat of Zhukovsky and Volterra."""
    return of_function(
        lambda x: [
            a * b + c
            for a, b, c in zip(
                (1, 2, -3), (x[1] * x[2], x[2] * x[0], x[0] * x[1]), cross(x, beta), strict=True
            )
        ],
        3,
    )


def in_fluid(a, b):
    """Kirchhoff's equations for 2 H = sum a_i m_i^2 + b_i p_i^2."""

    def field(x):
        m, p = x[:3], x[3:]
        u, v = scaled(a, m), scaled(b, p)
        force = [k + l for k, l in zip(cross(m, u), cross(p, v), strict=True)]
        return [*force, *cross(p, u)]

    return of_function(field, 6)


def lagrange(x):
    """A heavy symmetric top in the frame of the body."""
    m, p = x[:3], x[3:]
    turn = (m[0], m[1], m[2] / 2)
    force = [k + l for k, l in zip(cross(m, turn), cross(p, (0, 0, 1)), strict=True)]
    return [*force, *cross(p, turn)]


def nambu(x):
    """Cross product of the gradients of 2 x1^2 + x2^2 + x3^2 + x1 x2 and x3^2 + x1 x2 + x1 x3."""
    x1, x2, x3 = x
    return cross((4 * x1 + x2, x1 + 2 * x2, 2 * x3), (x2 + x3, x1, x1 + 2 * x3))


def henon_heiles(x):
    q1, q2, p1, p2 = x
    return (p1**2 + p2**2 + q1**2 + q2**2) / 2 + q1**2 * q2 - q2**3 / 3


class Entry(NamedTuple):
    """A field, the step size and initial states of its picture, and the plane it shows."""

    field: QuadraticField
    eps: float
    starts: list
    plane: tuple = (0, 1)
    reach: float | None = None  # half the width of the picture, by default that of most states


def random(dimension, size, count=8):
    return np.random.default_rng(0).uniform(-size, size, (count, dimension)).tolist()


TOP = [[0.3, 0.2, each, 0.1, 0.4, 0.8] for each in (0.5, 1)]
CHAIN = (0.2, 0.5, 0.8, 1.5, 2)
ZOO = {
    "Suslov body": Entry(
        QuadraticField.of(Suslov3D(4, 2, -0.5, -0.25)), 1 / 4, random(2, 2, 24), reach=2.6
    ),
    "Suslov gyrostat": Entry(
        QuadraticField.of(SuslovGyrostat(4, 2, -0.5, -0.25, k=0.5)),
        1 / 4,
        random(2, 2, 24),
        reach=2.6,
    ),
    "cubic Hamiltonian": Entry(
        of_hamiltonian(lambda x: (x[1] ** 2 - x[0] ** 2) / 2 + x[0] ** 3 / 3, 2),
        1 / 2,
        [[each, 0] for each in (1.1, 1.2, 1.3, 1.4, 1.48)],
    ),
    "Nahm, octahedral": Entry(
        of_function(
            lambda x: (2 * x[0] ** 2 - 12 * x[1] ** 2, -6 * x[0] * x[1] - 4 * x[1] ** 2), 2
        ),
        1 / 4,
        [[each, 0.5] for each in (0.2, 0.5, 0.75, 1.1)],
    ),
    "Euler top": Entry(
        of_function(lambda x: (2 * x[1] * x[2], -3 * x[2] * x[0], x[0] * x[1]), 3),
        1 / 2,
        random(3, 1, 10),
        (0, 2),
    ),
    "Zhukovsky-Volterra, one beta": Entry(rigid_body(1, 0, 0), 1 / 2, random(3, 1, 10)),
    "Nambu": Entry(of_function(nambu, 3), 1 / 4, random(3, 1, 6)),
    "Volterra chain, N = 3": Entry(volterra(3), 1 / 4, [[1, 1, each] for each in CHAIN]),
    "Volterra chain, N = 4": Entry(volterra(4), 1 / 4, [[1, 0.5, each, 1] for each in CHAIN]),
    "Lagrange top": Entry(of_function(lagrange, 6), 1 / 4, TOP, (3, 4)),
    "Kirchhoff": Entry(in_fluid((1, 1, 2), (1, 1, 3)), 1 / 4, TOP, (3, 4)),
    "Clebsch": Entry(in_fluid((1, 1, 1), (1, 2, 5)), 1 / 4, TOP, (3, 4)),
    "Lotka-Volterra": Entry(
        of_function(lambda x: (x[0] * (1 - x[1]), x[1] * (x[0] - 1)), 2),
        1 / 2,
        [[1, each] for each in (1.3, 1.8, 2.4, 3, 3.5)],
    ),
    "Zhukovsky-Volterra, two betas": Entry(
        rigid_body(1, 2, 0), 5 / 4, [[each, 0.3, 0.4] for each in (-0.9, -0.5, -0.1, 0.3, 0.7)]
    ),
    "Zhukovsky-Volterra, three betas": Entry(rigid_body(1, 2, 3), 1.0, random(3, 2, 10)),
    "Volterra chain, N = 5": Entry(volterra(5), 3 / 4, [[1, 0.5, each, 1, 0.5] for each in CHAIN]),
    "body in a fluid": Entry(in_fluid((1, 2, 4), (1, 3, 2)), 1 / 4, TOP, (3, 4)),
    "Henon-Heiles": Entry(
        of_hamiltonian(henon_heiles, 4),
        1 / 4,
        [[0, each, (0.32 - each**2 + 2 * each**3 / 3) ** 0.5, 0] for each in (-0.2, 0, 0.2, 0.4)],
        (1, 3),
    ),
    "Lorenz": Entry(
        of_function(
            lambda x: (
                10 * (x[1] - x[0]),
                x[0] * (28 - x[2]) - x[1],
                x[0] * x[1] - Fraction(8, 3) * x[2],
            ),
            3,
        ),
        1 / 64,
        [[1, 1, 20]],
        (0, 2),
    ),
    "generic planar field": Entry(
        of_function(
            lambda x: (
                -x[0] / 8 - x[1] + x[0] ** 2,
                x[0] - x[1] / 8 + x[0] * x[1] / 2 + x[1] ** 2 / 2,
            ),
            2,
        ),
        1 / 4,
        random(2, 0.5, 4),
    ),
}
CHAOTIC = 0.02  # exponent above which an orbit is red


@cache
def exponents(name, steps=50_000):
    """Largest Lyapunov exponent of each orbit of the picture, per unit of time."""
    entry = ZOO[name]
    return lyapunov_exponents(entry.field, entry.starts, entry.eps, steps)[:, 0] / entry.eps


def facts(name):
    """Degrees and growth; integrals and their degree; degree of a measure; largest exponent."""
    field, eps, *_ = ZOO[name]
    D, map = field.dimension, kahan(field, eps)
    found = degrees(map, {2: 12, 3: 9, 4: 7}.get(D, 6))
    highest = {2: 6, 3: 4, 4: 3}.get(D, 2)
    for degree in range(1, highest + 1):
        integrals = hk_bases(map, degree).independent
        if integrals >= min(D - 1, 4):
            break
    for of_measure in range(1, 7 if D < 4 else 5):
        if measure := bool(darboux_polynomials(map, of_measure)):
            break
    measured = (measure, of_measure)
    return found, growth(found), (integrals, degree), measured, exponents(name).max()


def row(name):
    """A row of the table in Markdown."""
    found, (kind, entropy, _), integrals, measure, exponent = facts(name)
    cells = (
        name,
        ZOO[name].field.dimension,
        ", ".join(map(str, found[:6])),
        f"{kind}, {entropy:.2f}" if entropy else kind,
        f"{integrals[0]} of degree {integrals[1]}" if integrals[0] else f"none to {integrals[1]}",
        f"degree {measure[1]}" if measure[0] else f"none to {measure[1]}",
        f"{exponent + 0.0:.2f}",
    )
    return f"| {' | '.join(map(str, cells))} |"


# %%
# The table of the page.

for name in ZOO:
    print(row(name))

# %%
# The picture. Axes show the middle of the orbits; some of them come close to poles.

figure, axes = plt.subplots(5, 4, figsize=(7.2, 9.2), layout="constrained")
for ax, (name, entry) in zip(axes.flat, ZOO.items(), strict=True):
    states = iterate(entry.field, entry.starts, entry.eps, 1500).x[..., entry.plane]
    chaotic = exponents(name) > CHAOTIC
    colours = plt.colormaps["viridis"](np.linspace(0, 0.85, len(chaotic)))
    colours[chaotic] = to_rgba("crimson")
    for orbit, colour in zip(np.moveaxis(states, 1, 0), colours, strict=True):
        ax.plot(*orbit.T, ".", color=colour, markersize=0.8)
    low, high = np.percentile(states, [2, 98], axis=(0, 1))
    (left, bottom), (right, top) = low - 0.25 * (high - low), high + 0.25 * (high - low)
    if entry.reach:
        left, bottom, right, top = -entry.reach, -entry.reach, entry.reach, entry.reach
    ax.set(xlim=(left, right), ylim=(bottom, top), xticks=[], yticks=[])
    ax.set_title(name, fontsize=7)
