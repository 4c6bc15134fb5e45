"""The paper's equations as printed, in arithmetic of 60 digits or in fractions.

The module shares no code with the package. Implicit equations are solved as linear systems, whose
coefficients are found by evaluating the equations. Equation numbers are those of the paper; k is
the momentum of a rotor along the axis, which the paper does not have.
"""

from fractions import Fraction
from functools import partial
from itertools import pairwise

import mpmath
from mpmath import mp, mpf

mp.dps = 60


def exactly(*numbers):
    """Return numbers, such as floats, with 60 digits."""
    return [mpf(number) for number in numbers]


def ds(I1, I2, I13, I23, eps, I3, omega, following):
    """Residuals of the three equations (3)."""
    (w1, w2, w3), (v1, v2, v3) = omega, following
    of12, of13, of23 = (v1 * w2 + w1 * v2) / 2, (v1 * w3 + w1 * v3) / 2, (v2 * w3 + w2 * v3) / 2
    right1 = I2 * of23 + I23 * w3 * v3 - I3 * of23 - I13 * of12 - I23 * w2 * v2
    right2 = I3 * of13 - I13 * w3 * v3 - I1 * of13 + I23 * of12 + I13 * w1 * v1
    return [
        I1 * (v1 - w1) + I13 * (v3 - w3) - eps * right1,
        I2 * (v2 - w2) + I23 * (v3 - w3) - eps * right2,
        v3 + w3,
    ]


def ds1(I1, I2, I13, I23, eps, omega, following, k=0):
    """Residuals of equations (4), which are (3) with Omega3 = 0, and the averaged terms in k."""
    first, second, _ = ds(I1, I2, I13, I23, eps, 0, [*omega, 0], [*following, 0])
    turn1, turn2 = (eps * k * (w + v) / 2 for w, v in zip(omega, following, strict=True))
    return [first + turn2, second - turn1]


def solve_affine(residual, dimension, number=mpf):
    """Find the zero of an affine function by elimination; None if there is not exactly one."""
    constant, columns = residual([number(0)] * dimension), []
    for j in range(dimension):
        unit = [number(int(i == j)) for i in range(dimension)]
        columns.append([v - c for v, c in zip(residual(unit), constant, strict=True)])
    rows = [[*row, -c] for *row, c in zip(*columns, constant, strict=True)]
    for k in range(dimension):
        largest = max(range(k, dimension), key=lambda i: abs(rows[i][k]))
        rows[k], rows[largest] = rows[largest], rows[k]
        if rows[k][k] == 0:
            return None
        for i in range(dimension):
            factor = rows[i][k] / rows[k][k] if i != k else 0
            rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    return [row[-1] / row[k] for k, row in enumerate(rows)]


def step(I1, I2, I13, I23, eps, omega, k=0, number=mpf):
    """The next state; None at a pole, if numbers are fractions."""
    *parameters, k = map(number, (I1, I2, I13, I23, eps, k))
    state = [*map(number, omega)]
    return solve_affine(lambda v: ds1(*parameters, state, v, k), 2, number)


rational_step = partial(step, number=Fraction)


def orbit(I1, I2, I13, I23, eps, omega, steps, k=0):
    """States 0 to `steps`."""
    return iterated(partial(step, I1, I2, I13, I23, eps, k=k), omega, steps)


def iterated(step, omega, steps):
    states = [exactly(*omega)]
    for _ in range(steps):
        states.append(step(states[-1]))
    return states


def kahan_step(f, eps, x, number=mpf):
    """(y - x) / eps = -f(x) / 2 + 2 f((x + y) / 2) - f(y) / 2 for quadratic f, linear in y."""
    x, eps = [*map(number, x)], number(eps)

    def residual(y):
        middle = f([(a + b) / 2 for a, b in zip(x, y, strict=True)])
        terms = zip(x, y, f(x), middle, f(y), strict=True)
        return [b - a - eps * (2 * m - (p + q) / 2) for a, b, p, m, q in terms]

    return solve_affine(residual, len(x), number)


def step_full(I1, I2, I13, I23, eps, I3, omega):
    parameters, state = exactly(I1, I2, I13, I23, eps, I3), exactly(*omega)
    return solve_affine(lambda v: ds(*parameters, state, v), 3)


def rotor(I13, I23, omega, k=0):
    """l = I13 Omega1 + I23 Omega2 + k, which is x of equation (7) for k = 0."""
    return mpmath.fdot(exactly(I13, I23), exactly(*omega)) + k


def xy(I1, I2, I13, I23, omega):
    """x and y of equation (7)."""
    (w1, w2), (I1, I2, I13, I23) = exactly(*omega), exactly(I1, I2, I13, I23)
    return rotor(I13, I23, omega), I23 * I1 * w1 - I13 * I2 * w2


def first_integral(I1, I2, I13, I23, eps, omega, k=0):
    """F of Lemma 1."""
    l, (I1, I2, eps) = rotor(I13, I23, omega, k), exactly(I1, I2, eps)
    return 2 * energy_nd([I1, I2], omega) / (4 * I1 * I2 + (eps * l) ** 2)


def level(I1, I2, I13, I23, eps, omega, k=0):
    """h / (I1 I2), with h = D F and D = I13**2 I2 + I23**2 I1."""
    F = first_integral(I1, I2, I13, I23, eps, omega, k)
    I1, I2, I13, I23 = exactly(I1, I2, I13, I23)
    return (I13**2 / I1 + I23**2 / I2) * F


def criticality(*problem, k=0):
    return problem[4] * mpmath.sqrt(level(*problem, k))


def closed_form(*problem):
    """h, k1 with its sign, and k2 of y = 2 sqrt(h I1 I2) tanh(k2), for t < 1 (Section 4)."""
    I1, I2, _, _, eps = exactly(*problem[:5])
    a, y = I1 * I2, xy(*problem[:4], problem[5])[1]
    h = a * level(*problem)
    k1 = -mpmath.asinh(2 * eps * mpmath.sqrt(a * h) / (a - h * eps**2)) / eps
    return h, k1, mpmath.atanh(y / (2 * mpmath.sqrt(a * h)))


def invariant_density(I1, I2, I13, I23, eps, omega, k=0):
    """Density of the invariant measure dx dy / (x (4 I1 I2 + eps**2 x**2))."""
    l, (I1, I2, eps) = rotor(I13, I23, omega, k), exactly(I1, I2, eps)
    return 1 / (l * (4 * I1 * I2 + (eps * l) ** 2))


def matrix(I1, I2, I13, I23, eps, omega, k=0):
    """The matrix above equation (5), as printed, and the terms in k."""
    I1, I2, I13, I23, eps = exactly(I1, I2, I13, I23, eps)
    w1, w2 = exactly(*omega)
    return [
        [1 + eps * I13 / (2 * I1) * w2, eps * (I13 * w1 + 2 * I23 * w2 + k) / (2 * I1)],
        [-eps * (2 * I13 * w1 + I23 * w2 + k) / (2 * I2), 1 - eps * I23 / (2 * I2) * w1],
    ]


def relative_error(computed, exact):
    """|computed - exact| / |exact| of vectors."""
    difference = mpmath.norm([mpf(c) - e for c, e in zip(computed, exact, strict=True)])
    size = mpmath.norm(list(exact))
    return float(difference / size) if size else float(difference)


def worst_error(states, exact):
    return max(map(relative_error, states, exact))


def energy_error(J, computed, exact):
    """Error in the energy norm, relative to the norm of the exact state."""
    difference = [mpf(c) - e for c, e in zip(computed, exact, strict=True)]
    return float(mpmath.sqrt(energy_nd(J, difference) / energy_nd(J, exact)))


def vector_field(I1, I2, I13, I23, omega, k=0):
    """The first two equations (2), solved for the derivative."""
    l, (w1, w2), (I1, I2) = rotor(I13, I23, omega, k), exactly(*omega), exactly(I1, I2)
    return -l * w2 / I1, l * w1 / I2


def derivative(function, state, digits=20):
    """Derivative of a function of vectors, by central differences."""
    h, columns, state = mpf(10) ** -digits, [], exactly(*state)
    for j in range(len(state)):
        after, before = (
            function([w + sign * h * (i == j) for i, w in enumerate(state)]) for sign in (1, -1)
        )
        columns.append([(a - b) / (2 * h) for a, b in zip(after, before, strict=True)])
    return list(zip(*columns, strict=True))


def quotient(eps, omega, following):
    """(Omega_next - Omega) / eps."""
    return [(v - w) / mpf(eps) for v, w in zip(following, omega, strict=True)]


def reaction(I1, I2, I13, I23, omega, following, derivative):
    """Multiplier in the third equation (2), with a polarised product."""
    I1, I2, I13, I23 = exactly(I1, I2, I13, I23)
    (w1, w2), (v1, v2) = omega, following
    return I13 * derivative[0] + I23 * derivative[1] - (I1 - I2) * (w1 * v2 + v1 * w2) / 2


def hat(omega):
    """The antisymmetric matrix with these numbers as the last column."""
    m = len(omega)
    S = mpmath.zeros(m + 1)
    for k in range(m):
        S[k, m], S[m, k] = omega[k], -omega[k]
    return S


def attitude(columns, eps):
    """Rotations R_next = R cay(eps (Omega + Omega_next) / 2), by matrix inversion."""
    one = mpmath.eye(len(columns[0]) + 1)
    rotations = [one]
    for before, after in pairwise(columns):
        pairs = zip(exactly(*before), exactly(*after), strict=True)
        S = hat([mpf(eps) * (v + w) / 4 for v, w in pairs])
        rotations.append(rotations[-1] * mpmath.inverse(one - S) * (one + S))
    return rotations


def dsn(J, I, eps, omega, following):
    """Residuals of equations (15)."""
    m = range(len(J))
    product = sum(following[i] * omega[i] for i in m)
    p, p_next = sum(I[i] * omega[i] for i in m), sum(I[i] * following[i] for i in m)
    return [
        J[i] * (following[i] - omega[i])
        - (-eps * I[i] * product + eps * p_next * omega[i] / 2 + eps * p * following[i] / 2)
        for i in m
    ]


def step_nd(J, I, eps, omega, number=mpf):
    """The next state; None at a pole, if numbers are fractions."""
    J, I, omega = ([*map(number, each)] for each in (J, I, omega))
    return solve_affine(lambda v: dsn(J, I, number(eps), omega, v), len(J), number)


rational_step_nd = partial(step_nd, number=Fraction)


def parts_by_eigenvalue(J, I, omega):
    """For each eigenvalue of diag(J), in the order in which it first stands there:

    the eigenvalue, |I_E|**2, I_E . omega, and the part of omega in E orthogonal to I, in fractions.
    """
    parts = []
    for a in dict.fromkeys(J):
        E = [i for i, J_i in enumerate(J) if J_i == a]
        of_I, of_omega = ([Fraction(each[i]) for i in E] for each in (I, omega))
        square = sum(x * x for x in of_I)
        along = sum(x * y for x, y in zip(of_I, of_omega, strict=True))
        ratio = along / square if square else 0
        across = [y - ratio * x for x, y in zip(of_I, of_omega, strict=True)]
        parts.append((a, square, along, across))
    return parts


def energy_nd(J, omega):
    """Half the sum of J_i Omega_i**2."""
    return sum(i * w**2 for i, w in zip(exactly(*J), exactly(*omega), strict=True)) / 2


def vector_field_nd(J, I, omega):
    """Right sides of equations (14), divided by J."""
    J, I, w = exactly(*J), exactly(*I), exactly(*omega)
    p, square = mpmath.fdot(I, w), mpmath.fdot(w, w)
    return [(p * w[k] - I[k] * square) / J[k] for k in range(len(J))]


def reaction_nd(J, I, omega, following, derivative):
    """lambda = M' - [M, Omega] of equations (13), M = I Omega + Omega I, products polarised.

    J does not determine the trace of the second moments of mass, which cancels.
    """
    J, I, n = exactly(*J), exactly(*I), len(J) + 1
    inertia = mpmath.diag([J_i - J[0] for J_i in J] + [J[0]])
    for k in range(n - 1):
        inertia[k, n - 1] = inertia[n - 1, k] = I[k]

    def momentum(v):
        return inertia * hat(v) + hat(v) * inertia

    def bracket(v, w):
        return momentum(v) * hat(w) - hat(w) * momentum(v)

    polarised = (bracket(omega, following) + bracket(following, omega)) / 2
    reaction = momentum(derivative) - polarised
    return [[reaction[i, j] for j in range(n - 1)] for i in range(n - 1)]


def orbit_nd(J, I, eps, omega, steps):
    return iterated(partial(step_nd, J, I, eps), omega, steps)


def solution_with_rotor(I1, I2, I13, I23, k, eps, w1, w2, n, flows=False):
    """State n of the map, or the state of the flow at time n.

    With z = sqrt(I1) w1 + i sqrt(I2) w2, half its angle (p, q) is multiplied by 1 + e G in a step,
    G = ((0, A + k), (A - k, 0)), and by exp(t G / (2 sqrt(I1 I2))) in time t. None at a pole.
    """
    root1, root2 = mpmath.sqrt(I1), mpmath.sqrt(I2)
    z, g = mpmath.mpc(root1 * w1, root2 * w2), mpmath.mpc(I13 / root1, I23 / root2)
    e = mpf(0) if flows else eps / (2 * root1 * root2)
    zeta = z / mpmath.mpc(1, -e * (I13 * w1 + I23 * w2 + k))
    R, size = abs(zeta), abs(g)
    A, direction = R * size, g / size if size else mpf(1)
    half = mpmath.sqrt(zeta / direction / R) if R else mpf(1)  # exp(i psi / 2)
    q, p = half.real, half.imag
    square = A * A - k * k
    c, s = exponential(square, n / (2 * root1 * root2)) if flows else power_of_step(square, e, n)
    p, q = c * p + s * (A + k) * q, c * q + s * (A - k) * p
    turned = mpmath.mpc(1, -e * k) * mpmath.mpc(q, p) ** 2 - mpmath.mpc(0, e * A * (p**2 + q**2))
    below = p**2 + q**2 - 2 * e * A * p * q
    if not below:
        return None
    z = R * direction * turned / below
    return z.real / root1, z.imag / root2


def power_of_step(square, e, n):
    """(c, s) of c + s G, a multiple of (1 + e G)**n, with G**2 = square."""
    if n != int(n):
        root = mpmath.sqrt(mpmath.mpc(square))  # imaginary where powers turn
        up, down = (1 + e * root) ** n, (1 - e * root) ** n
        return ((up + down) / 2).real, ((up - down) / (2 * root)).real
    c, s, n = mpf(1), mpf(0), int(n)
    by, of, left = e if n > 0 else -e, mpf(1), abs(n)  # (1 + e G)**-1 is a multiple of 1 - e G
    while left:
        if left % 2:
            c, s = c * of + square * s * by, c * by + s * of
        of, by, left = of * of + square * by * by, 2 * of * by, left // 2
    return c, s


def exponential(square, t):
    """(c, s) of c + s G, a multiple of exp(t G), with G**2 = square."""
    root = mpmath.sqrt(abs(square))
    if square > 0:
        small = mpmath.exp(-2 * root * abs(t))
        return (1 + small) / 2, mpmath.sign(t) * (1 - small) / (2 * root)
    return mpmath.cos(root * t), mpmath.sin(root * t) / root if root else t


def limits_with_rotor(I1, I2, I13, I23, k, eps, w1, w2):
    """The steady states conj(g) z = -k +- i L to which an orbit tends, four numbers, or None."""
    root1, root2 = mpmath.sqrt(I1), mpmath.sqrt(I2)
    z, g = mpmath.mpc(root1 * w1, root2 * w2), mpmath.mpc(I13 / root1, I23 / root2)
    e = eps / (2 * root1 * root2)
    R = abs(z) / abs(mpmath.mpc(1, e * (I13 * w1 + I23 * w2 + k)))
    square = (R * abs(g)) ** 2 - k * k
    if square < 0:
        return None
    L = mpmath.sign(eps) * mpmath.sqrt(square)
    ends = [g * mpmath.mpc(-k, sign * L) / abs(g) ** 2 for sign in (-1, 1)]
    return [part for end in ends for part in (end.real / root1, end.imag / root2)]


def condition(solution, problem, distance):
    """The solution for exact inputs, and the sum of its changes if each changes by half an ulp.

    The condition is inf where one of these solutions does not exist.
    """
    half_ulp, problem = mpf(2) ** -53, exactly(*problem)
    want, total = solution(*problem), half_ulp
    for i, number in enumerate(problem):
        if number:
            changed = solution(*problem[:i], number * (1 + half_ulp), *problem[i + 1 :])
            exist = want is not None and changed is not None
            total += distance(changed, want) if exist else mpmath.inf
    return want, float(total)
