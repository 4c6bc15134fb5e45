"""Problems that kernels find hard: log-uniform numbers, and two degenerate sets at a time.

A degenerate set is one where a formula divides by 0, or where numbers cancel. Each is met at a
log-uniform distance, sometimes exactly. What is wrong on both sides of one set is found soon; what
is wrong next to two at once is not.
"""

from fractions import Fraction

import numpy as np


class Adversary:
    """Random numbers."""

    def __init__(self, rng):
        self.rng = rng

    def chance(self, probability):
        return self.rng.random() < probability

    def signed(self, low, high, size=None):
        """Numbers between 10**low and 10**high in modulus."""
        return 10.0 ** self.rng.uniform(low, high, size) * self.rng.choice([-1, 1], size)

    def distance(self):
        """How far from a set: 0, or of any order of magnitude below 1."""
        return 0.0 if self.chance(0.1) else self.signed(-17, 0)

    def two(self, names):
        return set(self.rng.choice(sorted(names), 2, replace=False).tolist())


# ------------------------------------------------------------------------------- three dimensions
def with_k_next_to_A(X, Y, K, d):
    """K of (X - K)**2 + Y**2 = K**2 (1 + X**2)."""
    if X == 0.0:
        return X, Y, K
    root = 1.0 + np.sqrt(1.0 + X * X + Y * Y)
    return X, Y, (1.0 + d) * ((X * X + Y * Y) / (X * root) if d > 0 else -root / X)


# Of X, Y, K and a distance, see `map_3d`: X, Y and K next to the set.
PLANAR = {
    "l = 0": lambda X, Y, K, d: (X * d, Y, K),
    "|k| = A": with_k_next_to_A,
    "|Y| = 1": lambda X, Y, K, d: (X, np.sign(Y) * (1.0 + d), K),
    "pole": lambda X, Y, K, d: (X, (1.0 - K * X + 2.0 * X * X) * (1.0 + d), K),
    "T = 1": lambda X, Y, K, d: (
        (X, np.sign(Y) * np.sqrt(abs(1.0 + K * (2.0 * X - K))) * (1.0 + d), K)
    ),
    "e L = 1": lambda X, Y, K, d: (X, np.sign(Y) * (1.0 + K * X) * (1.0 + d), K),
}
PLACES = ("I along an axis", "units far apart", "small I", "few digits", "I = (1, 1, 1, 0)")


def planar(adversary, largest=1e3):
    """Return I1, I2, I13, I23, k, eps, Omega1, Omega2, as floats, and the sets."""
    while True:
        sets = adversary.two([*PLANAR, *PLACES])
        X, Y, K = adversary.signed(-6, np.log10(largest), 3)
        K = 0.0 if adversary.chance(0.3) else K
        for name, place in PLANAR.items():
            if name in sets:
                X, Y, K = place(X, Y, K, adversary.distance())
        if max(abs(X), abs(Y), abs(K)) <= largest:
            inputs = place_planar(adversary, X, Y, K, sets)
            # A state with l = 0 in floats alone rests, as one with another last digit does.
            if not terms_cancel(inputs) or terms_cancel(tuple(map(Fraction, inputs))):
                return inputs, sets


def place_planar(adversary, X, Y, K, sets):
    """Return the inputs with these X, Y and K, of a random body."""
    I1, I2 = 10.0 ** adversary.rng.uniform(-1, 1, 2)
    g, e = np.exp(1j * adversary.rng.uniform(0, 2 * np.pi)), adversary.signed(-2, 2)
    if "I along an axis" in sets:
        g = adversary.rng.choice([1, 1j, -1, -1j])
    g *= 10.0 ** adversary.rng.uniform(-1, 1)
    if "units far apart" in sets:
        I1, I2, size = np.array([I1, I2, 1.0]) * 10.0 ** adversary.rng.uniform(-10, 10, 3)
        g *= size
    if "small I" in sets:
        g *= 10.0 ** adversary.rng.uniform(-16, 0)
    if "I = (1, 1, 1, 0)" in sets:
        I1, I2, g, e = 1.0, 1.0, 1.0 + 0j, 1.0
    I13, I23, eps = g.real * np.sqrt(I1), g.imag * np.sqrt(I2), 2.0 * e * np.sqrt(I1 * I2)
    z = g * complex(X - K, -Y) / (e * abs(g) ** 2)
    inputs = np.array([I1, I2, I13, I23, K / e, eps, z.real / np.sqrt(I1), z.imag / np.sqrt(I2)])
    if "few digits" in sets:  # products are exact
        inputs = inputs.astype(np.float32).astype(float)
    return tuple(inputs.tolist())


def terms_cancel(inputs):
    """True if l = 0, in floats or in fractions."""
    _, _, I13, I23, k, _, w1, w2 = inputs
    return (I13 * w1 + I23 * w2) + k == 0


def index(adversary, largest):
    """A number of steps, of any order of magnitude and of either sign."""
    few = adversary.chance(0.4)
    n = adversary.rng.integers(1, 4) if few else 10.0 ** adversary.rng.uniform(0, largest)
    return int(n) * int(adversary.rng.choice([-1, 1]))


# ----------------------------------------------------------------------------------- n dimensions
ND = ("d_i = 0", "two d_i = 0", "J equal", "omega along I", "pole", "next state = 0", "far apart")


def in_n_dimensions(adversary):
    """Return J, I, eps, omega and the sets, with J and I each within a factor 1e8."""
    rng, sets = adversary.rng, adversary.two(ND)
    m, spread = int(rng.integers(2, 7)), 3.9 if "far apart" in sets else 0.5
    J = 10.0 ** rng.uniform(-spread, spread, m)
    I, omega = adversary.signed(-spread, spread, m), adversary.signed(-spread, spread, m)
    J[:] = J[0] if "J equal" in sets else J
    if "two d_i = 0" in sets:
        J[1] = J[0] * (1.0 + adversary.distance())
    if "omega along I" in sets:
        omega = I * adversary.signed(-1, 1) + omega * adversary.distance()
    eps = adversary.signed(-3, 4) * J.min() / np.linalg.norm(I) / np.linalg.norm(omega)
    if sets & {"d_i = 0", "two d_i = 0"}:
        eps = 2.0 * J[0] * (1.0 + adversary.distance()) / (I @ omega)
    if "pole" in sets:
        eps = next_to_a_pole(field_of_body(J, I, omega), eps) * (1.0 + adversary.distance())
    if "next state = 0" in sets:  # from very far, a step leads next to 0
        omega = omega * 10.0 ** rng.uniform(0, 12)
    return J, I, float(eps), omega, sets


def field_of_body(J, I, omega):
    """The derivative of the field (p omega_i - I_i |omega|**2) / J_i."""
    p, one = I @ omega, np.eye(len(J))
    return (p * one + np.outer(omega, I) - 2.0 * np.outer(I, omega)) / J[:, None]


def next_to_a_pole(slope, eps):
    """The step size at which 1 - eps / 2 f' is singular that is nearest to eps, if there is one."""
    eigenvalues = np.linalg.eigvals(slope)
    real = eigenvalues.real[(eigenvalues.imag == 0.0) & (eigenvalues.real != 0.0)]
    return min(2.0 / real, key=lambda pole: abs(pole - eps), default=eps)


# ------------------------------------------------------------------------------------------ fields
FIELD = ("pole", "pivot = 0", "at rest", "next state = 0", "units far apart", "nilpotent")


def field(adversary):
    """Return the coefficients (q, l, c) of a sparse field, units of its components, eps, a state
    and the sets.
    """
    rng, sets = adversary.rng, adversary.two(FIELD)
    D = int(rng.integers(1, 7))
    units = 2.0 ** rng.integers(-15, 16, D) if "units far apart" in sets else np.ones(D)
    tables = [rng.normal(size=(D,) * n) for n in (3, 2, 1)]
    for n, table in enumerate(tables):
        table *= rng.random(table.shape) < 1.5 / D ** (2 - n)
    if "nilpotent" in sets:  # component i depends on those after it
        i = np.arange(D)
        tables[0] *= (i[:, None, None] < i[:, None]) & (i[:, None, None] < i)
        tables[1] *= i[:, None] < i
    x, eps = rng.normal(size=D), adversary.signed(-3, 3)
    slope = np.einsum("ijk,k->ij", tables[0] + tables[0].swapaxes(1, 2), x) + tables[1]
    if "pole" in sets:
        eps = next_to_a_pole(slope, eps) * (1.0 + adversary.distance())
    elif "pivot = 0" in sets and slope[0, 0] != 0.0:
        eps = 2.0 / slope[0, 0] * (1.0 + adversary.distance())
    value = np.einsum("ijk,j,k->i", tables[0], x, x) + tables[1] @ x
    if "at rest" in sets:
        tables[2][:] = -value + adversary.distance() * tables[2]
    elif "next state = 0" in sets:  # A (x_next - x) = eps f
        tables[2][:] = (np.eye(D) - 0.5 * eps * slope) @ (x * (adversary.distance() - 1.0)) / eps
        tables[2] -= value
    for n, table in enumerate(tables):
        table *= units.reshape(D, *[1] * (2 - n))
        for axis in range(1, 3 - n):
            table /= units.reshape([-1 if k == axis else 1 for k in range(3 - n)])
    return tables, units, float(eps), x * units, sets
