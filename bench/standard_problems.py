"""Test problems that others have published: the IVP test set, DETEST, STIFF DETEST, kinetic models.

Each right-hand side is a function of (y, m) or (t, y, m), where the module m has the functions of
NumPy. Starts, times and parameters are those of the sources:

Mazzia, Magherini, Test set for IVP solvers, Bari 2008; Hairer, Wanner, Solving ODEs II, 1996;
Hull, Enright, Fellen, Sedgwick, SIAM J. Numer. Anal. 9 (1972); Enright, Hull, Lindberg, BIT 15
(1975); Enright, Pryce, ACM TOMS 13 (1987). Kinetic models name their own.
"""

import inspect
from collections.abc import Callable
from math import cos, pi, sin, sqrt
from typing import NamedTuple

import numpy as np


class Problem(NamedTuple):
    """Equations y' = f in D variables, from a start to a time; `known` are published end values."""

    group: str
    name: str
    f: Callable
    start: tuple
    time: float
    size: float | None = None  # atol is rtol times this; None: flow has no atol
    breaks: tuple = ()  # times at which f jumps
    known: tuple | None = None

    @property
    def D(self):
        return len(self.start)

    @property
    def has_time(self):
        return len(inspect.signature(self.f).parameters) == 3

    def rates(self, t, y, m):
        return self.f(t, y, m) if self.has_time else self.f(y, m)


PROBLEMS = []


def add(group, name, start, time, **options):
    """Return a decorator that appends a problem with this right-hand side."""

    def decorated(f):
        PROBLEMS.append(Problem(group, name, f, tuple(map(float, start)), float(time), **options))
        return f

    return decorated


# ------------------------------------------------------------------------------------- IVP test set
IVP = "IVP test set"


@add(
    IVP, "HIRES", (1, 0, 0, 0, 0, 0, 0, 0.0057), 321.8122,
    known=(0.7371312573325668e-3, 0.1442485726316185e-3, 0.5888729740967575e-4,
           0.1175651343283149e-2, 0.2386356198831331e-2, 0.6238968252742796e-2,
           0.2849998395185769e-2, 0.2850001604814231e-2),
)  # fmt: skip
def hires(y, m):
    pair = 280 * y[5] * y[7]
    return (
        -1.71 * y[0] + 0.43 * y[1] + 8.32 * y[2] + 0.0007,
        1.71 * y[0] - 8.75 * y[1],
        -10.03 * y[2] + 0.43 * y[3] + 0.035 * y[4],
        8.32 * y[1] + 1.71 * y[2] - 1.12 * y[3],
        -1.745 * y[4] + 0.43 * y[5] + 0.43 * y[6],
        -pair + 0.69 * y[3] + 1.71 * y[4] - 0.43 * y[5] + 0.69 * y[6],
        pair - 1.81 * y[6],
        -pair + 1.81 * y[6],
    )


@add(IVP, "POLLU", [{1: 0.2, 3: 0.04, 6: 0.1, 7: 0.3, 8: 0.01, 16: 0.007}.get(i, 0)
                    for i in range(20)], 60)  # fmt: skip
def pollu(y, m):
    r1, r2, r3 = 0.35 * y[0], 26.6 * y[1] * y[3], 1.23e4 * y[4] * y[1]
    r4, r5, r6, r7 = 8.6e-4 * y[6], 8.2e-4 * y[6], 1.5e4 * y[6] * y[5], 1.3e-4 * y[8]
    r8, r9, r10 = 2.4e4 * y[8] * y[5], 1.65e4 * y[10] * y[1], 9e3 * y[10] * y[0]
    r11, r12, r13, r14 = 0.022 * y[12], 1.2e4 * y[9] * y[1], 1.88 * y[13], 1.63e4 * y[0] * y[5]
    r15, r16, r17 = 4.8e6 * y[2], 3.5e-4 * y[3], 0.0175 * y[3]
    r18, r19, r20 = 1e8 * y[15], 4.44e11 * y[15], 1240 * y[16] * y[5]
    r21, r22, r23 = 2.1 * y[18], 5.78 * y[18], 0.0474 * y[0] * y[3]
    r24, r25 = 1780 * y[18] * y[0], 3.12 * y[19]
    return (
        -r1 - r10 - r14 - r23 - r24 + r2 + r3 + r9 + r11 + r12 + r22 + r25,
        -r2 - r3 - r9 - r12 + r1 + r21,
        -r15 + r1 + r17 + r19 + r22,
        -r2 - r16 - r17 - r23 + r15,
        -r3 + 2 * r4 + r6 + r7 + r13 + r20,
        -r6 - r8 - r14 - r20 + r3 + 2 * r18,
        -r4 - r5 - r6 + r13,
        r4 + r5 + r6 + r7,
        -r7 - r8,
        -r12 + r7 + r9,
        -r9 - r10 + r8 + r11,
        r9,
        -r11 + r10,
        -r13 + r12,
        r14,
        -r18 - r19 + r16,
        -r20,
        r20,
        -r21 - r22 - r24 + r23 + r25,
        -r25 + r24,
    )


@add(
    IVP, "RING", [0] * 15, 1e-3, size=1.0,
    known=(-0.2339057358486745e-1, -0.7367485485540825e-2, 0.2582956709291169, -0.4064465721283450,
           -0.4039455665149794, 0.2607966765422943, 0.1106761861269975, 0.2939904342435596e-6,
           -0.2840029933642329e-7, 0.7267198267264553e-3, 0.7929487196960840e-3,
           -0.7255283495698965e-3, -0.7941401968526521e-3, 0.7088495416976114e-4,
           0.2390059075236570e-4),
)  # fmt: skip
def ring_modulator(t, y, m):
    in1, in2 = 0.5 * m.sin(2e3 * pi * t), 2 * m.sin(2e4 * pi * t)

    def q(u):
        return 40.67286402e-9 * (m.exp(17.7493332 * u) - 1)

    q1, q2 = q(y[2] - y[4] - y[6] - in2), q(-y[3] + y[5] - y[6] - in2)
    q3, q4 = q(y[3] + y[4] + y[6] + in2), q(-y[2] - y[5] + y[6] + in2)
    return (
        (y[7] - 0.5 * y[9] + 0.5 * y[10] + y[13] - y[0] / 25e3) / 1.6e-8,
        (y[8] - 0.5 * y[11] + 0.5 * y[12] + y[14] - y[1] / 25e3) / 1.6e-8,
        (y[9] - q1 + q4) / 2e-12,
        (-y[10] + q2 - q3) / 2e-12,
        (y[11] + q1 - q3) / 2e-12,
        (-y[12] - q2 + q4) / 2e-12,
        (-y[6] / 50 + q1 + q2 - q3 - q4) / 1e-8,
        -y[0] / 4.45,
        -y[1] / 4.45,
        (0.5 * y[0] - y[2] - 17.3 * y[9]) / 5e-4,
        (-0.5 * y[0] + y[3] - 17.3 * y[10]) / 5e-4,
        (0.5 * y[1] - y[4] - 17.3 * y[11]) / 5e-4,
        (-0.5 * y[1] + y[5] - 17.3 * y[12]) / 5e-4,
        (-y[0] + in1 - (50 + 36.3) * y[13]) / 2e-3,
        (-y[1] - (600 + 36.3) * y[14]) / 2e-3,
    )


@add(IVP, "Medical Akzo", [0, 1] * 200, 20, size=1.0, breaks=(5.0,))
def medical_akzo(t, y, m):
    N, found = 200, []
    u = [m.where(t <= 5, 2.0, 0.0), *y[0::2]]
    u.append(u[-1])
    for j in range(1, N + 1):
        side = (j / N - 1) ** 2 / 4
        alpha, beta = 2 * (j / N - 1) * side / 4, side * side
        rate = alpha * (u[j + 1] - u[j - 1]) * (N / 2)
        rate = rate + beta * N**2 * (u[j - 1] - 2 * u[j] + u[j + 1])
        reaction = 100 * u[j] * y[2 * j - 1]
        found += [rate - reaction, -reaction]
    return found


@add(IVP, "VDPOL", (2, 0), 2, size=1e-3, known=(0.1706167732170483e1, -0.8928097010247975))
def van_der_pol(y, m):
    return y[1], ((1 - y[0] * y[0]) * y[1] - y[0]) * 1e6


@add(
    IVP, "OREGO", (1, 2, 3), 360,
    known=(0.1000814870318523e1, 0.1228178521549917e4, 0.1320554942846706e3),
)  # fmt: skip
def oregonator(y, m):
    return (
        77.27 * (y[1] + y[0] * (1 - 8.375e-6 * y[0] - y[1])),
        (y[2] - (1 + y[0]) * y[1]) / 77.27,
        0.161 * (y[0] - y[2]),
    )


# Between spikes two components are small, and have digits of their own with atol alone.
add(IVP, "OREGO, atol", (1, 2, 3), 360, size=1.0, known=PROBLEMS[-1].known)(oregonator)


@add(
    IVP, "ROBER", (1, 0, 0), 1e11, size=1e-14,
    known=(0.2083340149701255e-7, 0.8333360770334713e-13, 0.9999999791665050),
)  # fmt: skip
def robertson(y, m):
    slow, back, fast = 0.04 * y[0], 1e4 * y[1] * y[2], 3e7 * y[1] * y[1]
    return back - slow, slow - back - fast, fast


def e5(y, m):
    slow, third = 7.89e-10 * y[0], 1.1e7 * y[0] * y[2]
    fast, fourth = 1.13e9 * y[1] * y[2], 1.13e3 * y[3]
    return -slow - third, slow - fast, slow - third + fourth - fast, third - fourth


add(
    IVP,
    "E5",
    (1.76e-3, 0, 0, 0),
    1e13,
    size=1e-22,
    known=(0.1152903278711829e-290, 0.8867655517642120e-22, 0.8854814626268838e-22, 0),
)(e5)


@add(
    IVP, "PLEI",
    (3, 3, -1, -3, 2, -2, 2, 3, -3, 2, 0, 0, -4, 4, 0, 0, 0, 0, 0, 1.75, -1.5, 0, 0, 0, -1.25,
     1, 0, 0), 3,
)  # fmt: skip
def pleiades(y, m):
    found = [*y[14:28]]
    for axis in (0, 7):
        for i in range(7):
            total = 0.0
            for j in range(7):
                if j != i:
                    dx, dy = y[j] - y[i], y[j + 7] - y[i + 7]
                    square = dx * dx + dy * dy
                    total = total + (j + 1) * (dy if axis else dx) / (square * m.sqrt(square))
            found.append(total)
    return found


def _ring_of_cusps():
    angles = [2 * pi * i / 32 for i in range(1, 33)]
    return [value for a in angles for value in (0, -2 * cos(a), 2 * sin(a))]


@add(IVP, "CUSP", _ring_of_cusps(), 1.1)
def cusps(z, m):
    found, D = [], 32**2 / 144

    def spread(k):
        return D * (z[k - 3] - 2 * z[k] + z[(k + 3) % 96])

    for i in range(0, 96, 3):
        y, a, b = z[i : i + 3]
        u = (y - 0.7) * (y - 1.3)
        v = u / (u + 0.1)
        found += [
            -1e4 * (y * y * y + a * y + b) + spread(i),
            b + 0.07 * v + spread(i + 1),
            (1 - a * a) * b - a - 0.4 * y + 0.035 * v + spread(i + 2),
        ]
    return found


@add(IVP, "BRUSS, 128", [v for i in range(1, 65) for v in (1 + sin(2 * pi * i / 65), 3)], 10)
def brusselator(z, m):
    u, v, found, D = [1, *z[0::2], 1], [3, *z[1::2], 3], [], 65**2 / 50
    for i in range(1, 65):
        product = u[i] * u[i] * v[i]
        found += [
            1 + product - 4 * u[i] + D * (u[i - 1] - 2 * u[i] + u[i + 1]),
            3 * u[i] - product + D * (v[i - 1] - 2 * v[i] + v[i + 1]),
        ]
    return found


def _wave(i):
    x = 2 * pi * i / 128
    return cos(x) * (1 + sin(x)) + 0.3 * cos(8 * x)


@add(IVP, "KS, 128", [_wave(i) for i in range(128)], 20)
def kuramoto_sivashinsky(u, m):
    """By differences on 128 points of 32 pi."""
    h, found = 32 * pi / 128, []
    for i in range(128):
        a, b, c, d, e = (u[(i + k) % 128] for k in (-2, -1, 0, 1, 2))
        second = (b - 2 * c + d) * (1 / h**2)
        fourth = (a - 4 * b + 6 * c - 4 * d + e) * (1 / h**4)
        found.append(-second - fourth - (d * d - b * b) * (1 / (4 * h)))
    return found


@add(IVP, "BEAM", [0] * 80, 5, size=1.0, breaks=(pi,))
def beam(t, y, m):
    """Two products and a tridiagonal solution give the second derivatives of 40 angles."""
    n = 40
    angles, rates = y[:n], y[n:]
    s = m.sin(t)
    force = m.where(t <= pi, 1.5 * s * s, 0.0)
    sines, cosines = [m.sin(a) for a in angles], [m.cos(a) for a in angles]
    to_next = [angles[k] - angles[k + 1] for k in range(n - 1)]
    off = [-m.cos(a) for a in to_next]  # of C; D has -sin there
    skew = [m.sin(a) for a in to_next]
    v = []
    for k in range(n):
        before = -angles[0] if k == 0 else angles[k - 1]
        after = angles[k] if k == n - 1 else angles[k + 1]
        bending = n**4 * (before - 2 * angles[k] + after)
        v.append(bending + n**2 * force * (cosines[k] + sines[k]))

    def skewed(x):
        found = []
        for k in range(n):
            total = 0.0
            if k > 0:
                total = total + skew[k - 1] * x[k - 1]
            if k < n - 1:
                total = total - skew[k] * x[k + 1]
            found.append(total)
        return found

    diagonal = [1.0, *[2.0] * (n - 2), 3.0]
    right = [w + r * r for w, r in zip(skewed(v), rates, strict=True)]
    pivots = [diagonal[0]]
    for k in range(1, n):
        factor = off[k - 1] / pivots[k - 1]
        pivots.append(diagonal[k] - factor * off[k - 1])
        right[k] = right[k] - factor * right[k - 1]
    u = [right[-1] / pivots[-1]]
    for k in range(n - 2, -1, -1):
        u.append((right[k] - off[k] * u[-1]) / pivots[k])
    u.reverse()
    found = []
    for k, of_u in enumerate(skewed(u)):
        total = diagonal[k] * v[k] + of_u
        if k > 0:
            total = total + off[k - 1] * v[k - 1]
        if k < n - 1:
            total = total + off[k] * v[k + 1]
        found.append(total)
    return [*rates, *found]


# ------------------------------------------------------------------------------------------- DETEST
DETEST = "DETEST"
add(DETEST, "A1", (1,), 20)(lambda y, m: (-y[0],))
add(DETEST, "A2", (1,), 20)(lambda y, m: (-y[0] * y[0] * y[0] / 2,))
add(DETEST, "A3", (1,), 20)(lambda t, y, m: (y[0] * m.cos(t),))
add(DETEST, "A4", (1,), 20)(lambda y, m: (y[0] / 4 * (1 - y[0] / 20),))
add(DETEST, "A5", (4,), 20)(lambda t, y, m: ((y[0] - t) / (y[0] + t),))
add(DETEST, "B1", (1, 3), 20)(lambda y, m: (2 * (y[0] - y[0] * y[1]), -(y[1] - y[0] * y[1])))
add(DETEST, "B2", (2, 0, 1), 20)(lambda y, m: (-y[0] + y[1], y[0] - 2 * y[1] + y[2], y[1] - y[2]))
add(DETEST, "B3", (1, 0, 0), 20)(lambda y, m: (-y[0], y[0] - y[1] * y[1], y[1] * y[1]))


@add(DETEST, "B4", (3, 0, 0), 20)
def on_a_torus(y, m):
    r = m.sqrt(y[0] * y[0] + y[1] * y[1])
    return -y[1] - y[0] * y[2] / r, y[0] - y[1] * y[2] / r, y[0] / r


add(DETEST, "B5", (0, 1, 1), 20)(lambda y, m: (y[1] * y[2], -(y[0] * y[2]), -0.51 * y[0] * y[1]))
_FIRST_OF_10 = (1, *[0] * 9)
add(DETEST, "C1", _FIRST_OF_10, 20)(
    lambda y, m: (-y[0], *[y[i - 1] - y[i] for i in range(1, 9)], y[8])
)
add(DETEST, "C2", _FIRST_OF_10, 20)(
    lambda y, m: (-y[0], *[i * y[i - 1] - (i + 1) * y[i] for i in range(1, 9)], 9 * y[8])
)


def heat(y, m):
    z = [0, *y, 0]
    return [z[i - 1] - 2 * z[i] + z[i + 1] for i in range(1, len(y) + 1)]


add(DETEST, "C3", _FIRST_OF_10, 20)(heat)
add(DETEST, "C4", (1, *[0] * 50), 20)(heat)
_MASSES = (0.000954786104043, 0.000285583733151, 0.0000437273164546, 0.0000517759138449,
           0.00000277777777778)  # fmt: skip
_POSITIONS = (
    (3.42947415189, 3.35386959711, 1.35494901715), (6.64145542550, 5.97156957878, 2.18231499728),
    (11.2630437207, 14.6952576794, 6.27960525067), (-30.1552268759, 1.65699966404, 1.43785752721),
    (-21.1238353380, 28.4465098142, 15.3882659679),
)  # fmt: skip
_VELOCITIES = (
    (-0.557160570446, 0.505696783289, 0.230578543901),
    (-0.415570776342, 0.365682722812, 0.169143213293),
    (-0.325325669158, 0.189706021964, 0.0877265322780),
    (-0.0240476254170, -0.287659532608, -0.117219543175),
    (-0.176860753121, -0.216393453025, -0.0148647893090),
)


@add(DETEST, "C5", np.ravel([_POSITIONS, _VELOCITIES]), 20)
def planets(y, m):
    k2, sun, bodies = 2.95912208286, 1.00000597682, [y[3 * i : 3 * i + 3] for i in range(5)]

    def over_cube(v):
        square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
        cube = square * m.sqrt(square)
        return [a / cube for a in v]

    own, found = [over_cube(v) for v in bodies], [*y[15:30]]
    for i in range(5):
        pulls = {j: over_cube([b - a for a, b in zip(bodies[i], bodies[j], strict=True)])
                 for j in range(5) if j != i}  # fmt: skip
        for k in range(3):
            total = -(sun + _MASSES[i]) * own[i][k]
            for j, pull in pulls.items():
                total = total + _MASSES[j] * (pull[k] - own[j][k])
            found.append(k2 * total)
    return found


def kepler(z, m):
    x, y, u, v = z
    square = x * x + y * y
    cube = square * m.sqrt(square)
    return u, v, -x / cube, -y / cube


for _number, _e in enumerate((0.1, 0.3, 0.5, 0.7, 0.9), 1):
    add(DETEST, f"D{_number}", (1 - _e, 0, 0, sqrt((1 + _e) / (1 - _e))), 20)(kepler)
add(DETEST, "E1", (0.6713967071418030, 0.09540051444747446), 20)(
    lambda t, y, m: (y[1], -(y[1] / (t + 1) + (1 - 0.25 / ((t + 1) * (t + 1))) * y[0]))
)
add(DETEST, "E2", (2, 0), 20)(lambda y, m: (y[1], (1 - y[0] * y[0]) * y[1] - y[0]))
add(DETEST, "E3", (0, 0), 20)(
    lambda t, y, m: (y[1], y[0] * y[0] * y[0] / 6 - y[0] + 2 * m.sin(2.78535 * t))
)
add(DETEST, "E4", (30, 0), 20)(lambda y, m: (y[1], 0.032 - 0.4 * y[1] * y[1]))
add(DETEST, "E5", (0, 0), 20)(lambda t, y, m: (y[1], m.sqrt(1 + y[1] * y[1]) / (25 - t)))

# ------------------------------------------------------------------------------------- STIFF DETEST
STIFF = "STIFF DETEST"
add(STIFF, "A1", [1] * 4, 20)(lambda y, m: (-0.5 * y[0], -y[1], -100 * y[2], -90 * y[3]))
add(STIFF, "A2", [0] * 9, 120)(
    lambda y, m: (
        -1800 * y[0] + 900 * y[1],
        *[y[i - 1] - 2 * y[i] + y[i + 1] for i in range(1, 8)],
        1000 * y[7] - 2000 * y[8] + 1000,
    )
)
add(STIFF, "A3", [1] * 4, 20)(
    lambda y, m: (
        -1e4 * y[0] + 100 * y[1] - 10 * y[2] + y[3],
        -1e3 * y[1] + 10 * y[2] - 10 * y[3],
        -y[2] + 10 * y[3],
        -0.1 * y[3],
    )
)
add(STIFF, "A4", [1] * 10, 1)(lambda y, m: [-((i + 1) ** 5) * y[i] for i in range(10)])
add(STIFF, "B1", (1, 0, 1, 0), 20)(
    lambda y, m: (
        -y[0] + y[1],
        -100 * y[0] - y[1],
        -100 * y[2] + y[3],
        -10000 * y[2] - 100 * y[3],
    )
)


def rotating(a):
    return lambda y, m: (
        -10 * y[0] + a * y[1],
        -a * y[0] - 10 * y[1],
        -4 * y[2],
        -y[3],
        -0.5 * y[4],
        -0.1 * y[5],
    )


def coupled_upwards(b):
    return lambda y, m: (
        -y[0] + 2,
        -10 * y[1] + b * y[0] * y[0],
        -40 * y[2] + 4 * b * (y[0] * y[0] + y[1] * y[1]),
        -100 * y[3] + 10 * b * (y[0] * y[0] + y[1] * y[1] + y[2] * y[2]),
    )


for _number, _a in enumerate((3, 8, 25, 100), 2):
    add(STIFF, f"B{_number}", [1] * 6, 20)(rotating(_a))
add(STIFF, "C1", [1] * 4, 20)(
    lambda y, m: (
        -y[0] + y[1] * y[1] + y[2] * y[2] + y[3] * y[3],
        -10 * y[1] + 10 * (y[2] * y[2] + y[3] * y[3]),
        -40 * y[2] + 40 * y[3] * y[3],
        -100 * y[3] + 2,
    )
)
for _number, _b in enumerate((0.1, 1, 10, 20), 2):
    add(STIFF, f"C{_number}", [1] * 4, 20)(coupled_upwards(_b))
add(STIFF, "D1", [0] * 3, 400)(
    lambda y, m: (
        0.2 * (y[1] - y[0]),
        10 * y[0] - (60 - 0.125 * y[2]) * y[1] + 0.125 * y[2],
        0 * y[2] + 1,
    )
)
add(STIFF, "D2", (1, 0, 0), 40)(
    lambda y, m: (
        -0.04 * y[0] + 0.01 * y[1] * y[2],
        400 * y[0] - 100 * y[1] * y[2] - 3000 * y[1] * y[1],
        30 * y[1] * y[1],
    )
)
add(STIFF, "D3", (1, 1, 0, 0), 20)(
    lambda y, m: (
        y[2] - 100 * y[0] * y[1],
        y[2] + 2 * y[3] - 100 * y[0] * y[1] - 2e4 * y[1] * y[1],
        -y[2] + 100 * y[0] * y[1],
        -y[3] + 1e4 * y[1] * y[1],
    )
)
add(STIFF, "D4", (1, 1, 0), 50)(
    lambda y, m: (
        -0.013 * y[0] - 1000 * y[0] * y[2],
        -2500 * y[1] * y[2],
        -0.013 * y[0] - 1000 * y[0] * y[2] - 2500 * y[1] * y[2],
    )
)


@add(STIFF, "D5", (0, 0), 100)
def reactor_dynamics(y, m):
    total = 0.01 + y[0] + y[1]
    return (
        0.01 - (1 + (y[0] + 1000) * (y[0] + 1)) * total,
        0.01 - (1 + y[1] * y[1]) * total,
    )


@add(STIFF, "D6", (1, 0, 0), 1, size=1e-10)
def reactions(y, m):
    first = -y[0] + 1e8 * y[2] * (1 - y[0])
    second = -10 * y[1] + 3e7 * y[2] * (1 - y[1])
    return first, second, -first - second


@add(STIFF, "E1", [0] * 4, 1)
def control(y, m):
    g = 100.0
    last = (y[0] * y[0] - m.sin(y[0]) - g**4) * y[0]
    last = last + (y[1] * y[2] / (y[0] * y[0] + 1) - 4 * g**3) * y[1] + (1 - 6 * g**2) * y[2]
    return y[1], y[2], y[3], last + (10 * m.exp(-y[3] * y[3]) - 4 * g) * y[3] + 1


add(STIFF, "E2", (2, 0), 1)(lambda y, m: (y[1], 5 * (1 - y[0] * y[0]) * y[1] - y[0]))
add(STIFF, "E3", (1, 1, 0), 500)(
    lambda y, m: (-(55 + y[2]) * y[0] + 65 * y[1], 0.0785 * (y[0] - y[1]), 0.1 * y[0])
)


@add(STIFF, "E4", (0, -2, -1, -1), 1000)
def coupled(y, m):
    total = 0.5 * (y[0] + y[1] + y[2] + y[3])
    z = [total - a for a in y]
    g = (
        10 * z[0] + 10 * z[1] + 0.5 * (z[0] * z[0] - z[1] * z[1]),
        -10 * z[0] + 10 * z[1] + z[0] * z[1],
        -1000 * z[2] + z[2] * z[2],
        -0.01 * z[3] + z[3] * z[3],
    )
    total = 0.5 * (g[0] + g[1] + g[2] + g[3])
    return [total - a for a in g]


add(STIFF, "E5", (1.76e-3, 0, 0, 0), 1000, size=1e-20)(e5)


@add(STIFF, "F1", (50, 0, 600, 0.1), 1000)
def catalysis(y, m):
    k = m.exp(20.7 - 1500 / y[0])
    return (
        1.3 * (y[2] - y[0]) + 10400 * k * y[1],
        1880 * (y[3] - y[1] * (1 + k)),
        1752 - 269 * y[2] + 267 * y[0],
        0.1 + 320 * y[1] - 321 * y[3],
    )


add(STIFF, "F2", (1, 0), 240)(
    lambda y, m: (-y[0] - y[0] * y[1] + 294 * y[1], y[0] * (1 - y[1]) / 98 - 3 * y[1])
)


@add(STIFF, "F3", (4e-6, 1e-6, 0, 0, 0), 100, size=1e-14)
def enzymes(y, m):
    first, second = 1e7 * y[1] * y[0], 1e7 * y[1] * y[4]
    return (
        -first + 10 * y[2],
        -first - second + 10 * y[2] + 10 * y[3],
        first - 1.001e4 * y[2] + 1e-3 * y[3],
        1e4 * y[2] - 10.001 * y[3] + second,
        10 * y[3] - second,
    )


@add(STIFF, "F4", (4, 1.1, 4), 300)
def oregonator_of_enright(y, m):
    s = 77.27
    return (
        s * (y[1] - y[0] * y[1] + y[0] - 8.375e-6 * y[0] * y[0]),
        (-y[1] - y[0] * y[1] + y[2]) / s,
        0.161 * (y[0] - y[2]),
    )


@add(STIFF, "F5", (3.365e-7, 8.261e-3, 1.642e-3, 9.380e-6), 100, size=1e-10)
def four_species(y, m):
    first = 1e11 * (3 * y[0] * y[1] - 0.0012 * y[3])
    second = 9e11 * y[0] * y[2]
    return (
        -first - second,
        -3e11 * y[0] * y[1] + 2e7 * y[3],
        1e8 * y[3] - second,
        first + second,
    )


# ----------------------------------------------------------------------------------- kinetic models
KINETIC = "Kinetic models"


@add(KINETIC, "calcium (Goldbeter, Dupont, Berridge 1990)", (0.15, 1.6), 10)
def calcium(x, m):
    z, y = x
    pumped, z2 = 65 * z * z / (1 + z * z), z * z
    released = 500 * y * y / (4 + y * y) * z2 * z2 / (0.9**4 + z2 * z2)
    return 1 + 7.3 * 0.3 - pumped + released + y - 10 * z, pumped - released - y


@add(KINETIC, "repressilator (Elowitz, Leibler 2000)", (1, 2, 3, 1, 2, 3), 60)
def repressilator(x, m):
    rna, protein = x[:3], x[3:]
    return [
        *[-rna[i] + 216 / (1 + protein[i - 1] * protein[i - 1]) + 0.216 for i in range(3)],
        *[-5 * (protein[i] - rna[i]) for i in range(3)],
    ]


def _hill8(x, k):
    square = x * x
    fourth = square * square
    return fourth * fourth / (k**8 + fourth * fourth)


@add(KINETIC, "cell cycle of three (Ferrell, Tsai, Yang 2011)", (0, 0, 0), 25)
def three_variables(x, m):
    return (
        0.1 - 3 * x[0] * _hill8(x[2], 0.5),
        3 * (1 - x[1]) * _hill8(x[0], 0.5) - x[1],
        3 * (1 - x[2]) * _hill8(x[1], 0.5) - x[2],
    )


@add(KINETIC, "cell division (Tyson 1991)", (0, 0.75, 0, 0.25, 0, 0), 100)
def cell_division(x, m):
    c2, cp, pm, active, y, yp = x
    total = c2 + cp + pm + active
    made, share = 200 * cp * y, active / total
    opened = pm * (0.018 + 180 * share * share)
    return (
        active - 1e6 * c2 + 1e3 * cp,
        -made + 1e6 * c2 - 1e3 * cp,
        made - opened,
        opened - active,
        0.015 - made,
        active - 0.6 * yp,
    )


@add(KINETIC, "glycolysis (Bier, Bakker, Westerhoff 2000)", (3, 1), 500)
def glycolysis(x, m):
    used = 0.02 * x[0] * x[1]
    return 0.36 - used, 2 * used - 6 * x[1] / (13 + x[1])


@add(KINETIC, "MAPK cascade (Kholodenko 2000)", (90, 10, 280, 10, 10, 280, 10, 10), 4000)
def cascade(x, m):
    v1 = 2.5 * x[0] / ((1 + x[7] / 9) * (10 + x[0]))
    v2 = 0.25 * x[1] / (8 + x[1])
    v3, v4 = 0.025 * x[1] * x[2] / (15 + x[2]), 0.025 * x[1] * x[3] / (15 + x[3])
    v5, v6 = 0.75 * x[4] / (15 + x[4]), 0.75 * x[3] / (15 + x[3])
    v7, v8 = 0.025 * x[4] * x[5] / (15 + x[5]), 0.025 * x[4] * x[6] / (15 + x[6])
    v9, v10 = 0.5 * x[7] / (15 + x[7]), 0.5 * x[6] / (15 + x[6])
    return (
        v2 - v1, v1 - v2, v6 - v3, v3 + v5 - v4 - v6, v4 - v5, v10 - v7, v7 + v9 - v8 - v10,
        v8 - v9,
    )  # fmt: skip


@add(KINETIC, "mitosis (Goldbeter 1991)", (0.01, 0.01, 0.01), 100)
def mitosis(x, m):
    c, kinase, protease = x
    v1, v3 = 3 * c / (0.5 + c), kinase
    return (
        0.025 - 0.25 * protease * c / (0.02 + c) - 0.01 * c,
        v1 * (1 - kinase) / (0.005 + 1 - kinase) - 1.5 * kinase / (0.005 + kinase),
        v3 * (1 - protease) / (0.005 + 1 - protease) - 0.5 * protease / (0.005 + protease),
    )


@add(KINETIC, "circadian PER (Goldbeter 1995)", (0.1, 0.25, 0.25, 0.25, 0.25), 72)
def circadian(x, m):
    rna, p0, p1, p2, pn = x
    square = pn * pn
    v1, v2 = 3.2 * p0 / (2 + p0), 1.58 * p1 / (2 + p1)
    v3, v4 = 5 * p1 / (2 + p1), 2.5 * p2 / (2 + p2)
    return (
        0.76 / (1 + square * square) - 0.65 * rna / (0.5 + rna),
        0.38 * rna - v1 + v2,
        v1 - v2 - v3 + v4,
        v3 - v4 - 1.9 * p2 + 1.3 * pn - 0.95 * p2 / (0.2 + p2),
        1.9 * p2 - 1.3 * pn,
    )


@add(KINETIC, "zero-order switch (Goldbeter, Koshland 1981)", (0.0,), 60)
def zero_order(x, m):
    return (1.05 * (1 - x[0]) / (0.01 + 1 - x[0]) - x[0] / (0.01 + x[0]),)


@add(KINETIC, "glycolysis (Selkov 1968)", (1, 1), 100)
def selkov(x, m):
    made = (0.06 + x[0] * x[0]) * x[1]
    return made - x[0], 0.6 - made


@add(KINETIC, "toggle switch (Gardner, Cantor, Collins 2000)", (0.1, 0.2), 50)
def toggle(x, m):
    return 156.25 / (1 + m.power(x[1], 2.5)) - x[0], 15.6 / (1 + x[0]) - x[1]
