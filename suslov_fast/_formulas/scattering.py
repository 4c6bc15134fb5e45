"""Angle in space between the angular velocities at time -infinity and infinity.

In the body frame, with tau = C t / a, the angular velocity is

    omega = (alpha tanh(tau) + gamma sech(tau)) e + beta sech(tau) e',

where e points along the line of steady states, e' is normal to it, and alpha, beta, gamma are the
numbers below. The spinor form of R' = R Omega is 2 i psi' = (omega . sigma) psi. In z = exp(tau) it
has four regular singular points, 0, i, -i and infinity. It is invariant under z -> -z with
a change of sign of beta and gamma, and under z -> 1 / z with that of gamma. So the loop around i
consists of the path from 0 to infinity, traversed twice, and of half-turns about 0 and infinity,
whose effect is known. Let U be the unitary matrix of the path from 0 to infinity and
G = diag(exp(pi alpha / 2), exp(-pi alpha / 2)),

    trace (G U)**2 = 2 cosh(pi kappa),  kappa = sqrt((alpha - i gamma)**2 - beta**2),

by the exponents at i. With U = (S, F; -F*, S*) this is a linear equation for S:

    cosh(pi alpha / 2) Re S + i sinh(pi alpha / 2) Im S = cosh(pi kappa / 2),

up to a sign, and the angle between the angular velocities is 2 arcsin |S|.
"""

import math

import numpy as np

from .._jit import formula, select
from .elementary import exponential, scaled
from .trigonometric import arctangent, of_quarter_turns

# Sines of more quarter turns than this have no correct digits.
FAR = 1e15
# Above this v, exp(-pi v) is 0; below it, in the range of `scaled`.
VANISHING = 450.0
# Bound of moments over products of inertia below which the angle is pi to rounding.
NEAR = 2.0**-60


@formula
def coefficients(I1, I2, I13, I23):
    """alpha, beta and gamma; NaN where I13 = I23 = 0."""
    a, k = I1 * I2, np.sqrt(I13 * I13 + I23 * I23)
    D = I13 * (I13 * I2) + I23 * (I23 * I1)
    root = np.sqrt(a) / k
    return a * (k / D), root, root * (I13 * (I2 - I1) / D * I23)


@formula
def less(v):
    """1 - exp(-pi v) for v >= 0."""
    p, k = exponential(-math.pi * min(v, VANISHING), 0.0)
    return select(k == 0.0, -p, 1.0 - scaled(1.0 + p, k))


@formula
def kappa(alpha, beta, gamma):
    """p, |q| of kappa = p + i q, and alpha - p, for coefficients up to the order of 1."""
    near = np.sqrt((alpha - beta) * (alpha - beta) + gamma * gamma)
    far = np.sqrt((alpha + beta) * (alpha + beta) + gamma * gamma)
    size, square = near * far, (alpha - beta) * (alpha + beta) - gamma * gamma  # of kappa**2
    larger = np.sqrt(0.5 * (size + abs(square)))
    smaller = select(larger > 0.0, abs(alpha * gamma) / larger, 0.0)
    p, q = (larger, smaller) if square >= 0.0 else (smaller, larger)
    # alpha**2 - p**2 is the smaller root of d**2 - total d + (alpha beta)**2, from which alpha - p
    # is accurate near p = alpha. Elsewhere half the digits of p may be rounding errors, and the
    # plain difference contains the same ones.
    total, product = alpha * alpha + beta * beta + gamma * gamma, alpha * beta
    gap = 2.0 * product / (total + size) * product / (alpha + p)
    return p, q, select(p < 0.5 * alpha, alpha - p, gap)


@formula
def scattering_angle(I1, I2, I13, I23, unit):
    """Angle 2 arcsin |S|; moments over products of inertia are `unit` times the arguments.

    |S|**2 and 1 - |S|**2 are sums of positive terms: with A, P, Q = pi/2 times alpha, p, q

    |S|**2 = (cosh(P) cos(Q) / cosh(A))**2 + (sinh(P) sin(Q) / sinh(A))**2,
    1 - |S|**2 = sinh(A - P) sinh(A + P) ((cos(Q) / cosh(A))**2 + (sin(Q) / sinh(A))**2).
    """
    alpha, beta, gamma = coefficients(I1, I2, I13, I23)
    largest = max(max(alpha, beta), abs(gamma))
    p, q, gap = kappa(alpha / largest, beta / largest, gamma / largest)
    # Below the least of these moments the angle is pi to rounding.
    unit = max(unit, NEAR) * largest
    A, P, gap = unit * (alpha / largest), unit * p, unit * gap
    sine, cosine = of_quarter_turns(min(unit * q, FAR))
    # All terms divided by exp(A).
    p, k = exponential(-0.5 * math.pi * min(gap, 2.0 * VANISHING), 0.0)
    decay = scaled(1.0 + p, k)
    cosine, sine = cosine / (2.0 - less(A)), sine / less(A)
    real, imaginary = (2.0 - less(P)) * cosine, less(P) * sine
    S = decay * np.sqrt(real * real + imaginary * imaginary)
    F = np.sqrt(less(gap) * less(A + P) * (cosine * cosine + sine * sine))
    return 2.0 * arctangent(S, F) + 0.0 * alpha
