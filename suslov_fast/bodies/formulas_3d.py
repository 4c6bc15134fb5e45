"""Formulas of bodies in three dimensions, on arrays of states.

X, Y, K, e, ell, g and z are defined in `core.suslov.map_3d`, nu in `core.suslov.closed_form`, x and
y in equation (7). Numbers of equations refer to the paper.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray
from ..core.suslov import closed_form as closed, map_3d
from ..maps.evaluation import Formula
from ..maps.formulas import KAHAN
from ..maps.problem import Problem


def _numbers(problem: Problem) -> tuple[Any, ...]:
    """Return I1, I2, I13, I23, k, eps and the components of states, as arrays that broadcast."""
    components = (problem.x[..., i] for i in range(problem.x.shape[-1]))
    return tuple(map(np.array, (*problem.body._constants, problem.eps, *components)))


def _vectors(problem: Problem, *components: FloatArray) -> FloatArray:
    """Return the vectors (..., n) with these components."""
    return np.stack([np.broadcast_to(each, problem.batch) for each in components], axis=-1)


def in_range(number: FloatArray) -> FloatArray:
    """Return the number, or NaN if it is beyond the range of float64."""
    return number + 0.0 * number


def _energy(problem: Problem) -> FloatArray:
    I1, I2, _, _, _, _, w1, w2 = _numbers(problem)
    return np.asarray(0.5 * (I1 * w1 * w1 + I2 * w2 * w2))


def _to_xy(problem: Problem) -> FloatArray:
    """Return x = I13 w1 + I23 w2 and y = I23 I1 w1 - I13 I2 w2, equation (7)."""
    I1, I2, I13, I23, _, _, w1, w2 = _numbers(problem)
    return _vectors(problem, I13 * w1 + I23 * w2, I23 * I1 * w1 - I13 * I2 * w2)


def _momentum(problem: Problem) -> FloatArray:
    I1, I2, I13, I23, k, _, w1, w2 = _numbers(problem)
    return _vectors(problem, I1 * w1, I2 * w2, I13 * w1 + I23 * w2 + k)


def _reaction(problem: Problem) -> FloatArray:
    """Return lambda = (next_ell - ell) / eps - (I1 - I2) (w1 next2 + next1 w2) / 2, equation (4).

    For eps = 0 it is lambda of equation (2). Both terms are fractions with the denominator det A;
    no large numbers cancel in the numerators.
    """
    I1, I2, I13, I23, k, eps, w1, w2 = _numbers(problem)
    a, half = I1 * I2, 0.5 * eps
    x, y = I13 * w1 + I23 * w2, I23 * I1 * w1 - I13 * I2 * w2
    ell = x + k
    difference = I1 * w1 * w1 * (I13 * w1 + k) - I2 * w2 * w2 * (I23 * w2 + k)
    mean = w1 * w2 * (1.0 - half * half * k * ell / a) + half * difference / a
    Y = half * y / a
    square = half * half * ell * (2.0 * ell - k) / a
    det = (1.0 - Y) + square
    size = 1.0 + abs(Y) + abs(square)
    det = np.where(abs(det) > map_3d.ZERO_TO_ROUNDING * size, in_range(det), np.nan)
    return np.asarray((ell * (y - half * ell * x) / a - (I1 - I2) * mean) / det)


def _first_integral(problem: Problem) -> FloatArray:
    """Return F of Lemma 1, (6): (I1 w1**2 + I2 w2**2) / (4 I1 I2 + eps**2 ell**2)."""
    I1, I2, I13, I23, k, eps, w1, w2 = _numbers(problem)
    step = eps * (I13 * w1 + I23 * w2 + k)
    return np.asarray((I1 * w1 * w1 + I2 * w2 * w2) / in_range(4.0 * I1 * I2 + step * step))


def _modified_energy(problem: Problem) -> FloatArray:
    I1, I2, *_ = _numbers(problem)
    return np.asarray(2.0 * I1 * I2 * _first_integral(problem))


def density(product: Any, ell: FloatArray, eps: Any) -> FloatArray:
    """Return 1 / (ell (4 I1 I2 + eps**2 ell**2)) for the product I1 I2."""
    step = eps * ell
    return np.asarray(1.0 / in_range(ell * (4.0 * product + step * step)))


def _invariant_density(problem: Problem) -> FloatArray:
    I1, I2, I13, I23, k, eps, w1, w2 = _numbers(problem)
    return density(I1 * I2, I13 * w1 + I23 * w2 + k, eps)


def _criticality(problem: Problem) -> FloatArray:
    """Return T = e |g| |z| / sqrt(1 + X**2), on the side of 1 on which the steps test it."""
    I1, I2, I13, I23, k, eps, w1, w2 = _numbers(problem)
    of_g = I13 * (I13 / I1) + I23 * (I23 / I2)
    step = eps * (I13 * w1 + I23 * w2 + k)
    size = np.hypot(np.sqrt(I1 * of_g) * w1, np.sqrt(I2 * of_g) * w2)
    T = in_range(abs(eps) * size) / np.hypot(2.0 * np.sqrt(I1 * I2), step)
    near = (k != 0.0) | (abs(T - 1.0) < 1e-6)
    if near.any():
        frame = map_3d.frame_of.of_arrays(I1, I2, I13, I23, k, eps)  # bits as in steps of the map
        X, Y = map_3d.XY_in_frame.of_arrays(frame, I13, I23, k, w1, w2)
        beyond = map_3d.is_supercritical.of_arrays(frame, X, Y)
        T = np.where(near & beyond & (T < 1.0), 1.0, T)
        T = np.where(near & ~beyond & (T >= 1.0), 1.0 - 2.0**-53, T)
    return np.where(eps < 0.0, -T, T)


def _rotation_number(problem: Problem) -> FloatArray:
    """Return sign(k) arctan(e mu) / pi with mu**2 = k**2 - A**2; 0 if mu**2 is negative."""
    I1, I2, I13, I23, k, eps, w1, w2 = _numbers(problem)
    root_a, g1, g2, *_ = closed.constants_of.of_arrays(I1, I2, I13, I23)
    ell, x, nu = closed.coordinates.of_arrays(I13, I23, k, root_a, g1, g2, w1, w2)
    e = 0.5 * eps / root_a
    square = -closed.difference_of_squares.of_arrays(ell, x, nu, k, e * ell, e * k)
    turns = np.arctan(abs(e) * np.sqrt(np.where(square < 0.0, 0.0, square))) / np.pi
    return np.where(e * k < 0.0, -turns, turns)


@np.errstate(all="ignore")
def closed_form(problem: Problem) -> tuple[FloatArray, ...]:
    """Return h, k1, k2 and t of Section 4 of the paper; k1 and k2 are NaN unless -1 < t < 1.

    h = (I1 I2 x**2 + y**2) / (4 I1 I2 + eps**2 x**2) is equation (9), k1 = -(2 / eps) artanh t
    solves equation (12), and sinh k2 = y / (|x| sqrt(I1 I2 (1 - t**2))).
    """
    I1, I2, I13, I23, k, eps, w1, w2 = _numbers(problem)
    t = _criticality(problem)
    unit = closed.unit_of.of_arrays(w1, w2, 0.0)
    w1, w2, eps = w1 / unit, w2 / unit, eps * unit
    frame = map_3d.frame_of.of_arrays(I1, I2, I13, I23, k, eps)
    X, Y = map_3d.XY_in_frame.of_arrays(frame, I13, I23, k, w1, w2)
    root_a, g1, g2, *_ = closed.constants_of.of_arrays(I1, I2, I13, I23)
    x, _, nu = closed.coordinates.of_arrays(I13, I23, k, root_a, g1, g2, w1, w2)
    h = 0.25 * (x * x + nu * nu) / (1.0 + X * X)
    T = abs(t)
    complement = (1.0 - Y) * (1.0 + Y) / (1.0 + X * X)  # 1 - T**2
    angle = np.where(T < 0.5, np.arctanh(T), -0.5 * np.log(complement / (1.0 + T) ** 2))
    k1 = -2.0 * unit * np.sqrt(h / (I1 * I2)) * np.where(T > 0.0, angle / T, 1.0)
    k2 = np.where(h == 0.0, 0.0, np.arcsinh(nu / (abs(x) * np.sqrt(complement))))
    k1, k2 = (np.where(abs(Y) < 1.0, each, np.nan) for each in (k1, k2))
    return h * unit * unit, k1[()], k2[()], t[()]


@np.errstate(all="ignore")
def limits(problem: Problem) -> list[FloatArray]:
    """Return the limits of an orbit, or for eps = 0 of a motion, at -infinity and +infinity.

    They are steady states (Proposition 2), and NaN for an orbit on a closed curve.
    """
    I1, I2, I13, I23, k, eps, w1, w2 = _numbers(problem)
    unit = closed.unit_of.of_arrays(w1, w2, k)
    w1, w2, k, eps = w1 / unit, w2 / unit, k / unit, eps * unit
    root_a, g1, g2, h1, h2, per_g = closed.constants_of.of_arrays(I1, I2, I13, I23)
    ell, x, nu = closed.coordinates.of_arrays(I13, I23, k, root_a, g1, g2, w1, w2)
    e = 0.5 * eps / root_a
    X, Y, K = e * ell, e * nu, e * k
    square = closed.difference_of_squares.of_arrays(ell, x, nu, k, X, K)
    is_known = (abs(X) <= map_3d.RANGE) & (abs(Y) <= map_3d.RANGE) & (abs(K) <= map_3d.RANGE)
    root = np.where(is_known, np.sqrt(square), np.nan)
    root = np.where(eps < 0.0, -root, root)
    fixed = (ell == 0.0) | (w1 == 0.0) & (w2 == 0.0)
    both = []
    for sign in (1.0, -1.0):
        v1, v2 = closed.steady.of_arrays(g1, g2, h1, h2, -k, sign * root)
        v1, v2 = np.where(fixed, w1, v1 * per_g), np.where(fixed, w2, v2 * per_g)
        undefined = (ell == 0.0) & (abs(1.0 + sign * Y) < 2.0 * map_3d.ZERO_TO_ROUNDING)  # 0 / 0
        limit = (np.where(undefined, np.nan, v * unit) for v in (v1, v2))
        both.append(_vectors(problem, *limit))
    return both


@np.errstate(all="ignore")
def step_full(problem: Problem) -> FloatArray:
    """Return the next state of equations (3): w3_next = -w3; the first two give the increments."""
    I1, I2, I13, I23, _, eps, w1, w2, w3 = _numbers(problem)
    I3, half = problem.body.I3, 0.5 * eps
    x = I13 * w1 + I23 * w2
    a11 = I1 + half * (I13 * w2)
    a12 = half * (x + I23 * w2 + (I3 - I2) * w3)
    a21 = half * ((I1 - I3) * w3 - x - I13 * w1)
    a22 = I2 - half * (I23 * w1)
    b1 = 2.0 * (I13 * w3 - half * (I23 * w3 * w3 + w2 * x))
    b2 = 2.0 * (I23 * w3 + half * (I13 * w3 * w3 + w1 * x))
    det = a11 * a22 - a12 * a21
    size = abs(a11 * a22) + abs(a12 * a21)
    inverse = 1.0 / np.where(abs(det) > map_3d.ZERO_TO_ROUNDING * size, det, np.nan)
    next1 = w1 + (a22 * b1 - a12 * b2) * inverse
    next2 = w2 + (a11 * b2 - a21 * b1) * inverse
    return _vectors(problem, next1, next2, -w3)


def scattering_angle(
    I1: FloatArray, I2: FloatArray, I13: FloatArray, I23: FloatArray
) -> FloatArray:
    """Return the angle (...) of bodies without a rotor."""
    # Formulas with sums of positive terms, which lose no digits. Let A, B, C and P + i Q be pi / 2
    # times alpha, beta, abs(gamma) and the conjugate of kappa, and S = sin(angle / 2). Then A - P
    # is the real part of B**2 / (A + i C + P + i Q), and
    # |S|**2 = (cosh(P) cos(Q) / cosh(A))**2 + (sinh(P) sin(Q) / sinh(A))**2,
    # 1 - |S|**2 = sinh(A - P) sinh(A + P) ((cos(Q) / cosh(A))**2 + (sin(Q) / sinh(A))**2).
    with np.errstate(all="ignore"):  # I13 = I23 = 0 gives NaN; numbers may underflow to 0
        m = np.hypot(I13, I23)
        D = I13 * I13 * I2 + I23 * I23 * I1
        A = 0.5 * np.pi * (I1 * I2 * (m / D))
        B = 0.5 * np.pi * np.sqrt(I1 * I2) / m
        C = abs(B * (I13 * (I2 - I1) / D * I23))
        kappa = np.sqrt((A - B) * (A + B) - C * C + 2j * (A * C))
        P, Q = kappa.real, kappa.imag
        gap = B * (B / np.hypot(A + P, C + Q)) * ((A + P) / np.hypot(A + P, C + Q))  # A - P
        # Numerators and denominators are divided by exp(A), so that they do not overflow.
        cosine = np.cos(Q) / (1.0 + np.exp(-2.0 * A))
        sine = np.sin(Q) / -np.expm1(-2.0 * A)
        S = np.exp(-gap) * np.hypot((1.0 + np.exp(-2.0 * P)) * cosine, -np.expm1(-2.0 * P) * sine)
        product = np.expm1(-2.0 * gap) * np.expm1(-2.0 * (A + P))
        return np.asarray(2.0 * np.arctan2(S, np.sqrt(product) * np.hypot(cosine, sine)))[()]


def eigenvalues_in_3d(problem: Problem, slopes: FloatArray) -> NDArray[Any]:
    """Return the eigenvalues (..., 2) of f' at steady states: exactly 0 along a line of these."""
    I1, I2, _, _, k = problem.body._constants
    trace = np.trace(slopes, axis1=-2, axis2=-1)
    at_rest = (problem.x == 0.0).all(axis=-1)
    root = np.where(at_rest, 2j * k / np.sqrt(I1 * I2), trace)[..., np.newaxis]
    values = np.asarray(0.5 * (trace[..., np.newaxis] + root * [1.0, -1.0]))
    return values if np.any(k) else values.real


IN_3D = {
    **KAHAN,
    "energy": Formula(_energy),
    "to_xy": Formula(_to_xy),
    "momentum": Formula(_momentum),
    "reaction": Formula(_reaction),
    "first_integral": Formula(_first_integral),
    "modified_energy": Formula(_modified_energy),
    "invariant_density": Formula(_invariant_density, poles=True),
    "criticality": Formula(_criticality),
    "rotation_number": Formula(_rotation_number),
}
