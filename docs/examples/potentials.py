"""Suslov problems with potentials.

Let gamma be the vertical as seen from the body. In a potential U(gamma) that is linear or quadratic
the equations of motion are quadratic, so they have Kahan's map. With Omega3 = 0 and
I13 = I23 = 0 they are

    I1 Omega1' = (gamma x dU/dgamma)_1,    I2 Omega2' = (gamma x dU/dgamma)_2,
    gamma' = gamma x Omega.

Jovanovic (2003) reviews the integrable cases of the flow. `report` says here which of them have an
integrable map. Each comment below a call is what it prints. The figure has orbits of the maps of
the potential of Klebsch and Tisserand with a long step: for beta = -alpha they lie on curves, for
beta = 2 alpha they scatter.
"""

import warnings
from fractions import Fraction

import matplotlib.pyplot as plt

from suslov_fast import Field, IntegrationWarning, Map, iterate
from suslov_fast.integrability import planar_entropy, rational_map, report


def suslov(slope, I1=1, I2=1):
    """Return the body in a potential with the gradient slope(g1, g2, g3)."""

    def f(x):
        w1, w2, g1, g2, g3 = x
        U1, U2, U3 = slope(g1, g2, g3)
        torque = (g2 * U3 - g3 * U2) / I1, (g3 * U1 - g1 * U3) / I2
        return *torque, -w2 * g3, w1 * g3, w2 * g1 - w1 * g2

    return Field(f, "w1 w2 g1 g2 g3")


def show(found):
    """Print the integrals, the degrees of the iterates, and their growth."""
    for integral in found.integrals:
        print(integral, "|", integral.basis)
    print(found.degrees[:5], found.growth.kind)


def klebsch_tisserand(beta):
    """Return the body in U = (b1 g1**2 + b2 g2**2 + b3 g3**2) / 2, with alpha = 1.

    With alpha = (b3 - b2) / I1 and beta = (b1 - b3) / I2 the torques are alpha g2 g3 and
    beta g3 g1. The flow is integrable for all alpha and beta (Hu, Santoprete 2017). The map has two
    integrals in general, and its degrees grow exponentially. For beta = -alpha it has four
    integrals and an invariant measure.
    """
    return suslov(lambda g1, g2, g3: ((1 + beta) * g1, 0 * g2, g3))


show(report(klebsch_tisserand(2), degree=2))
# (w2^2 + 2*g1^2)/(eps^2*g3^2 + 2) | identity
# (w1 + g2)*(w1 - g2)/((-eps*g3 + 2)*(eps*g3 + 2)) | identity
# [5, 25, 109, 465, 1973] exponential
special = report(klebsch_tisserand(-1), degree=2)
show(special)
# (w2 - g1)/(w1 + g2) | identity
# (w2 + g1)/(w1 - g2) | identity
# (w1*w2 + g1*g2)/((-eps*g3 + 2)*(eps*g3 + 2)) | identity
# (g1^2 + g2^2 + g3^2)/((-eps*g3 + 2)*(eps*g3 + 2)) | identity
# [3, 9, 19, 33, 51] quadratic
print(len(special.measures), special.measures[0].basis)  # 1 identity


def kharlamova():
    """Return the body in U = c . gamma with c orthogonal to the constrained axis.

    U is the potential of gravity, with the centre of mass along c. The map has three polynomial
    integrals, c1 I1 w1 + c2 I2 w2 and two of degree 2. Its degrees nevertheless grow exponentially.
    """
    return suslov(lambda *g: (1, 2, 0), I1=1, I2=2)


found = report(kharlamova(), degree=2)
show(found)
# w1 + 4*w2 | identity
# -eps^2*g3^2 + 16*w2^2 + 16*g1 | identity
# eps^2*g3^2 + 8*w1*w2 + 16*w2^2 - 4*g2 | identity
# [3, 9, 23, 57, 139] exponential
print(found.growth.based_on.partition(",")[0], round(found.growth.entropy, 6))
# d(k+3) = 3 d(k+2) - d(k+1) - d(k) 0.881374


def on_hyperplane(x):
    """Kharlamova's case on the invariant hyperplane w1 + 4 w2 = 0.

    There the map is integrable: it has three independent integrals in four variables.
    """
    w, g1, g2, g3 = x
    return g3 / 2, -w * g3, -4 * w * g3, w * g1 + 4 * w * g2


show(report(Field(on_hyperplane, "w g1 g2 g3"), degree=2))
# 4*g1 - g2 | identity
# -eps^2*g3^2 + 16*w^2 + 16*g1 | identity
# (g1^2 + 8*g1*g2 + 16*g2^2 + 17*g3^2)/(17*eps^2*w^2 + 4) | identity
# [3, 9, 19, 33, 51] quadratic


def map_on_level(a, b, c, eps=Fraction(1, 4)):
    """Return Kharlamova's map on the level a, b, c of its integrals, as a map of (w2, g3).

    The integrals determine w1, g1 and g2. On each level with a != 0 below the entropy is proved to
    be log(1 + sqrt(2)), so the map has no fourth rational integral there.
    """

    def step(x, eps):
        w2, g3 = x
        w1 = a - 4 * w2
        g1 = (b + eps**2 * g3**2) / 16 - w2**2
        g2 = (eps**2 * g3**2 + 8 * w1 * w2 + 16 * w2**2 - c) / 4

        def equation(s):
            """Return the next w2, and the equation for the next g3 = s, which is linear."""
            v2 = w2 + eps * (g3 + s) / 4
            v1 = a - 4 * v2
            h1 = g1 - eps * (w2 * s + v2 * g3) / 2
            h2 = g2 + eps * (w1 * s + v1 * g3) / 2
            return v2, s - g3 - eps * (w2 * h1 + v2 * g1 - w1 * h2 - v1 * g2) / 2

        at_0, at_1 = equation(0)[1], equation(1)[1]
        s = at_0 / (at_0 - at_1)
        return equation(s)[0], s

    return rational_map(Map(lambda x: step(x, eps), 2), Map(lambda x: step(x, -eps), 2))


levels = [(1, 1, 2), (1, 3, -1), (2, 1, 2), (-1, 0, 0), (3, -2, 1), (1, 0, 0), (2, 2, 7)]
levels += [(5, 1, 1), (Fraction(1, 2), 5, 1)]
found = [planar_entropy(map_on_level(*level)) for level in levels]
print({(str(each.minimal), each.proved) for each in found})  # {('x^2 - 2*x - 1', True)}
print(planar_entropy(map_on_level(0, 1, 2)).entropy)  # 0.0


def lagrange():
    """Return the body in a linear potential with c along the constrained axis, and I1 = I2.

    The map has three integrals and a measure, and its degrees grow quadratically.
    """
    return suslov(lambda *g: (0, 0, 1))


found = report(lagrange(), degree=2)
print([(f.degree, f.basis) for f in found.integrals])
# [(2, 'identity'), (2, 'identity'), (4, 'identity')]
print(found.integrals[0])  # (w1*g1 + w2*g2)/(-eps^2*g3 + 4)
print(found.measures[0].basis, found.degrees[:5], found.growth.kind)
# identity [4, 12, 25, 44, 68] quadratic


PAIRS = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3)]


def so4(b):
    """Return the problem of Fedorov and Kozlov (1995) on so(4), with the constraint W34 = 0.

    M_ij = (l_i + l_j) W_ij, so W_ij' = (l_i - l_j) / (l_i + l_j) (W**2)_ij for the other pairs. On
    the page "n dimensions" the constraints are others: W_ij = 0 for all i, j < n. With
    l = (1, 2, 5, b) the map has two integrals for general b. It has four integrals, a measure and
    quadratic growth if l3 = l4 or l1 l2 = l3 l4: for b = 5 and b = 2/5. For b = 1 and b = 2 one of
    the velocities is constant.
    """
    moments = 1, 2, 5, b

    def f(x):
        W = [[0] * 4 for _ in range(4)]
        for (i, j), value in zip(PAIRS, x, strict=True):
            W[i][j], W[j][i] = value, -value
        square = {(i, j): sum(W[i][k] * W[k][j] for k in range(4)) for i, j in PAIRS}
        return [
            Fraction(moments[i] - moments[j]) / (moments[i] + moments[j]) * square[i, j]
            for i, j in PAIRS
        ]

    return Field(f, "w12 w13 w14 w23 w24")


reports = {b: report(so4(b), degree=2) for b in (3, 5, Fraction(2, 5))}
for found in reports.values():
    counts = len(found.integrals), len(found.measures)
    print(*counts, found.degrees[:5], found.growth.kind)
# 2 0 [5, 25, 109, 465, 1973] exponential
# 4 1 [3, 9, 19, 33, 51] quadratic
# 4 1 [3, 9, 19, 33, 51] quadratic
show(reports[5])
# (9*w13^2 + 14*w23^2)/(eps^2*w23^2 + eps^2*w24^2 + 18) | identity
# (9*w13*w14 + 14*w23*w24)/(eps^2*w23^2 + eps^2*w24^2 + 18) | identity
# (w13*w24 - w14*w23)/(eps^2*w23^2 + eps^2*w24^2 + 18) | identity
# (2*w12^2 + w13^2 + w14^2)/(eps^2*w23^2 + eps^2*w24^2 + 18) | identity
# [3, 9, 19, 33, 51] quadratic


figure, panels = plt.subplots(1, 2, figsize=(7.4, 3.7), layout="constrained")
starts = [[0.4, w2, 0.6, 0, 0.8] for w2 in (-0.5, 0.1, 0.7, 1.2)]
for axes, beta, name in zip(panels, (-1, 2), (r"\beta = -\alpha", r"\beta = 2\alpha"), strict=True):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IntegrationWarning)  # the map counts, also beyond poles
        run = iterate(klebsch_tisserand(beta), starts, eps=3 / 2, steps=600)
    for k in range(len(starts)):
        axes.plot(run.states[:, k, 0], run.states[:, k, 4], ".", markersize=2)
    axes.set(xlabel=r"$\Omega_1$", ylabel=r"$\gamma_3$", title=f"${name}$")
panels[1].set(xlim=(-3, 3), ylim=(-3, 3))
