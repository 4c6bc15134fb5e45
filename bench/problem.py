"""The problem that every benchmark solves, and its solution in long doubles.

Long doubles have 64 bits of mantissa on x86. The body is that of the paper's first figure, the
states are random.
"""

import functools
import itertools

import formulas
import numpy as np
from formulas import Formulas

from suslov_fast import Field, Suslov3D, SuslovND

BODY = Suslov3D(*formulas.BODY)
PRECISE = Formulas(np.longdouble)
# Number of trajectories that are compared with the reference, and number of their steps.
CHECKED, STEPS = 64, 1000
EPS_FIELD = 1 / 64


def lorenz_system(x):
    return 10 * (x[1] - x[0]), 28 * x[0] - x[1] - x[0] * x[2], x[0] * x[1] - 8 / 3 * x[2]


def volterra_chain(x):
    return [x[i] * (x[(i + 1) % len(x)] - x[i - 1]) for i in range(len(x))]


def henon_heiles(x):
    """A Hamiltonian, whose motions are bounded where it is below 1/6."""
    return (x[2] ** 2 + x[3] ** 2 + x[0] ** 2 + x[1] ** 2) / 2 + x[0] ** 2 * x[1] - x[1] ** 3 / 3


@functools.cache
def sparse_field(D):
    """Return the Lorenz system for D = 3, Hénon and Heiles's for 4, else a Volterra chain."""
    if D == 4:
        return Field.from_hamiltonian(henon_heiles, D)
    return Field(lorenz_system if D == 3 else volterra_chain, D)


def lorenz_96(x):
    return [x[i - 1] * (x[(i + 1) % len(x)] - x[i - 2]) - x[i] + 8 for i in range(len(x))]


def korteweg_de_vries(u):
    D, h = len(u), 1.0

    def at(i):
        return u[i % D]

    return [
        -(at(i + 1) - at(i - 1)) * (at(i + 1) + at(i) + at(i - 1)) / h
        - (at(i + 2) - 2 * at(i + 1) + 2 * at(i - 1) - at(i - 2)) / (2 * h**3)
        for i in range(D)
    ]


def fermi_pasta_ulam_tsingou(x):
    """Particles with a quadratic force between fixed ends: positions, then momenta."""
    q, p = [0, *x[: len(x) // 2], 0], x[len(x) // 2 :]
    springs = [b - a + (b - a) ** 2 / 4 for a, b in itertools.pairwise(q)]
    return [*p, *(b - a for a, b in itertools.pairwise(springs))]


def fisher_on_a_grid(u):
    n = round(len(u) ** 0.5)

    def at(i, j):
        return u[n * (i % n) + j % n]

    return [
        at(i + 1, j) + at(i - 1, j) + at(i, j + 1) + at(i, j - 1) - 4 * at(i, j)
        + at(i, j) * (1 - at(i, j))
        for i in range(n)
        for j in range(n)
    ]  # fmt: skip


@functools.cache
def lattice(f, D):
    return Field(f, D)


@functools.cache
def dense_field(D):
    """A field with all of its terms, whose orbits stay in reach for hundreds of steps."""
    rng = np.random.default_rng(D)
    return Field.from_terms(rng.normal(size=(D, D, D)) / D**2, -np.eye(D))


def starts(batch, components=2, low=-2, high=2):
    """Random states; larger batches extend smaller ones."""
    return np.random.default_rng(0).uniform(low, high, (batch, components))


def henon_map(x):
    return 1 - 1.4 * x[0] ** 2 + x[1], 0.3 * x[0]


def standard_map(x):
    p = np.mod(x[1] + 1.2 * np.sin(x[0]), 2 * np.pi)
    return np.mod(x[0] + p, 2 * np.pi), p


OWN_MAPS = {"Hénon": henon_map, "standard": standard_map}


def starts_field(batch, D):
    """States whose orbits by these fields stay in reach."""
    return starts(batch, D, -0.2, 0.2) if D == 4 else starts(batch, D, 0.5, 1)


def body_nd(components):
    """A body in components + 1 dimensions, whose motions with |Omega| about 1 are similar."""
    rng = np.random.default_rng(components)
    return SuslovND(
        J=rng.uniform(1, 4, components), I=rng.normal(size=components) / components**0.5
    )


def starts_nd(batch, components):
    """States with |Omega| about 1."""
    return np.random.default_rng(3).normal(size=(batch, components)) / components**0.5


def aligned(shape, offset=0):
    """Return a touched C-contiguous array of zeros, at a multiple of 64 bytes plus some doubles."""
    size = int(np.prod(shape))
    room = np.empty(size + 16)
    room.fill(0.0)
    start = -room.ctypes.data % 64 // 8 + offset
    return room[start : start + size].reshape(shape)


def relative_error(computed, reference):
    """The largest |computed - reference| / |reference|, of vectors on the last axis."""
    difference = np.sqrt(((computed - reference) ** 2).sum(-1))
    return float((difference / np.sqrt((reference**2).sum(-1))).max())


@functools.cache
def orbit(steps):
    """States 0 to `steps` of CHECKED trajectories, (steps + 1, CHECKED, 2), by iteration."""
    states = [PRECISE.enter(*starts(CHECKED).T.astype(np.longdouble))]
    for _ in range(steps):
        states.append(formulas.advance(*states[-1]))
    return np.stack([np.stack(PRECISE.leave(*each), axis=-1) for each in states])
