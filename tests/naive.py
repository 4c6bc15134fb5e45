"""The paper's equations, slowly and literally, in arithmetic of 60 digits.

Nothing here comes from the package, and nothing is solved by hand: each discrete equation is
written down as printed, the coefficients of the unknowns are read off by evaluating it, and the
linear system is solved.
"""

import mpmath
from mpmath import mp, mpf

mp.dps = 60


def exactly(*numbers):
    """Floats as numbers of 60 digits, unchanged."""
    return [mpf(float(number)) for number in numbers]


def ds1(I1, I2, I13, I23, eps, omega, following):
    """Left side minus right side of the two equations (ds1)."""
    (w1, w2), (v1, v2) = omega, following
    return [
        I1 * (v1 - w1) - eps * (-I13 / 2 * (v1 * w2 + w1 * v2) - I23 * w2 * v2),
        I2 * (v2 - w2) - eps * (I23 / 2 * (v1 * w2 + w1 * v2) + I13 * w1 * v1),
    ]


def ds(I1, I2, I13, I23, eps, I3, omega, following):
    """Left side minus right side of the three equations (ds)."""
    (w1, w2, w3), (v1, v2, v3) = omega, following
    right1 = (
        I2 / 2 * (v2 * w3 + w2 * v3)
        + I23 * w3 * v3
        - I3 / 2 * (v2 * w3 + w2 * v3)
        - I13 / 2 * (v1 * w2 + w1 * v2)
        - I23 * w2 * v2
    )
    right2 = (
        I3 / 2 * (v1 * w3 + w1 * v3)
        - I13 * w3 * v3
        - I1 / 2 * (v1 * w3 + w1 * v3)
        + I23 / 2 * (v1 * w2 + w1 * v2)
        + I13 * w1 * v1
    )
    return [
        I1 * (v1 - w1) + I13 * (v3 - w3) - eps * right1,
        I2 * (v2 - w2) + I23 * (v3 - w3) - eps * right2,
        v3 + w3,
    ]


def solve_affine(residual, dimension):
    """The zero of an affine function of `dimension` unknowns."""
    zero = [mpf(0)] * dimension
    constant = residual(zero)
    matrix = mpmath.matrix(dimension)
    for j in range(dimension):
        unit = list(zero)
        unit[j] = mpf(1)
        for i, value in enumerate(residual(unit)):
            matrix[i, j] = value - constant[i]
    return list(mpmath.lu_solve(matrix, [-value for value in constant]))


def step(I1, I2, I13, I23, eps, omega):
    parameters = exactly(I1, I2, I13, I23, eps)
    state = [mpf(component) for component in omega]
    return solve_affine(lambda v: ds1(*parameters, state, v), 2)


def orbit(I1, I2, I13, I23, eps, omega, steps):
    """The states 0 ... steps."""
    states = [exactly(*omega)]
    for _ in range(steps):
        states.append(step(I1, I2, I13, I23, eps, states[-1]))
    return states


def step_full(I1, I2, I13, I23, eps, I3, omega):
    parameters = exactly(I1, I2, I13, I23, eps, I3)
    state = exactly(*omega)
    return solve_affine(lambda v: ds(*parameters, state, v), 3)


def first_integral(I1, I2, I13, I23, eps, omega):
    """F of equation (i1)."""
    I1, I2, I13, I23, eps = exactly(I1, I2, I13, I23, eps)
    w1, w2 = (mpf(component) for component in omega)
    return (I1 * w1**2 + I2 * w2**2) / (4 * I1 * I2 + eps**2 * (I13 * w1 + I23 * w2) ** 2)


def xy(I1, I2, I13, I23, omega):
    """Equation (xy)."""
    I1, I2, I13, I23 = exactly(I1, I2, I13, I23)
    w1, w2 = (mpf(component) for component in omega)
    return I13 * w1 + I23 * w2, I23 * I1 * w1 - I13 * I2 * w2


def criticality(I1, I2, I13, I23, eps, omega):
    """eps sqrt(h / (I1 I2)) with the h of equation (i2)."""
    x, y = xy(I1, I2, I13, I23, omega)
    I1, I2, eps = exactly(I1, I2, eps)
    a = I1 * I2
    return eps * mpmath.sqrt((a * x**2 + y**2) / (4 * a + eps**2 * x**2) / a)


def relative_error(computed, exact):
    """|computed - exact| / |exact| of vectors."""
    difference = mpmath.norm([mpf(float(c)) - e for c, e in zip(computed, exact, strict=True)])
    size = mpmath.norm(list(exact))
    return float(difference / size) if size else float(difference)
