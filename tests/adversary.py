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
