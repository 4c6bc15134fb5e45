"""The closed form: state n of an orbit, or its state at time n, with a rotor or without.

Symbols are those of `suslov.map_3d`: z, g, e, ell, X = e ell, Y = e nu and K = e k. With
nu = -Im(conj(g) z) and x = ell - k, conj(g) z = x - i nu. (Equation (7) has the same x, and y =
sqrt(I1 I2) nu.) R = |z| / sqrt(1 + X**2) and A = R |g| are conserved. Let
psi = arg(z / (1 - i X)) - arg g and (p, q) = (sin(psi / 2), cos(psi / 2)). Then a step is linear,

    (p, q) -> (1 + e G) (p, q),    G = ((0, A + k), (A - k, 0)),    G**2 = A**2 - k**2,

and the flow is exp(t G / (2 sqrt(I1 I2))) with the R, A, psi of e = 0. State n is a quotient of
quadratic forms in c and s, where (1 + e G)**n is a multiple of c + s e G. Two numbers (rho, sigma)
replace (c, e s); they depend on the kind of the orbit:

passes    A**2 > k**2, root = sqrt(A**2 - k**2), L = e root: rho = c - L s = r**n and
          sigma = e s = (1 - rho) / (2 root), r = (1 - L) / (1 + L): orbits go from one steady
          state to another
turns     A**2 <= k**2, root = sqrt(k**2 - A**2): rho = cos(n a), sigma = sin(n a) / root,
          tan(a) = e root

For the flow n is the time, log r = -2 L and a = L. Then e is 0 in X, Y and K (`e_map`), and
1 / (2 sqrt(I1 I2)) elsewhere. The state is, with complex numbers z, b and c,

    (z rho**2 + b rho sigma + c sigma**2) / (rho**2 + d12 rho sigma + d22 sigma**2).

For eps > 0 and n >= 0

passes    d12 = 2 (root - nu), d22 = 2 (root**2 + k ell - root nu),
          conj(g) b = 2 (root ell - k (root - nu)) + i d22, conj(g) c = d22 (i root - k)
turns     d12 = -2 nu, d22 = 2 k ell + A**2 - k**2,
          conj(g) b = 2 k nu + 2 i (d22 - k ell), conj(g) c = -k d22 - (A**2 - k**2) (ell + i nu)

For n < 0 conj(g) z, conj(g) b and conj(g) c are conjugated: nu -> -nu. `fill_orbit` uses these
identities for differences that cancel next to a steady state, |k| = A or the critical level L = 1:

(root - nu) (root + nu) = ell (ell (1 - Y**2) - k (2 + K X)) / (1 + X**2)
(root**2 + k ell)**2 - (root nu)**2 = ell**2 (x**2 + nu**2) (1 - L**2) / (1 + X**2)
1 - L**2 = (1 - Y + K X) (1 + Y + K X) / (1 + X**2)
A**2 - k**2 = (nu**2 + ell (x - k) - (K ell)**2) / (1 + X**2)
2 k ell + A**2 - k**2 = (nu**2 + ell**2 (1 + K (2 X - K))) / (1 + X**2)

Far from ell = 0, an orbit that turns has b = 2 i (k z + R**2 g) and
c = -k**2 z - R**2 g (g conj(z) + 2 k). Both hold for g = 0, too, but cancel next to ell = 0.

For k = 0 and T < 1 this is Theorem 1: r = exp(eps k1), equation (12), and -tan(psi) is the u of
equation (11) and Proposition 1, half a step later.
"""

import math

import numpy as np

from ..numba.arrays import array_at, block_of, uncounted
from ..numba.decorators import ZERO, formula, kernel, lesser, share
from ..numba.intrinsics import select
from .blocks import are_common, fill_parameters, store_rows
from .map_3d import RANGE, ZERO_TO_ROUNDING, one_step
from .steps import LANES, NO

# Letters are as in the head of this file. TINY replaces a factor that is exactly 0 on the critical
# level L = 1. Then all numbers that vanish with this factor keep their ratios, and state 1 and the
# decay to the steady state are right.
TINY = 2.0**-100
CRITICAL = 2.0**-90  # a smaller r may be 0 or negative: r**n is then real for integers n only
NO_SQUARE = 1e-300  # replaces a smaller |A**2 - k**2|, so that sin(n a) / root is n e
PARITY_KNOWN = 2.0**53  # larger floats are even, by rounding: the sign of r**n, r < 0, is unknown
FAINT = 1e-140  # ell / nu below this may have a subnormal square: states unknown for one sign of n
VANISHES = -350.0  # exp(t) is set to 0 for t below this, because its square may be subnormal
ORDINARY = 2.0**32  # sizes of states between 1 / ORDINARY and this need no `unit_of`

# Rows of a block. States, momenta and inverse times are in the unit UNIT.
I1_, I2_, I13_, I23_, K_, EPS, W1, W2 = range(8)  # the body, eps and state 0
B1, B2, C1, C2, D12, D22 = range(8, 14)  # the coefficients b, c, d12, d22 for n >= 0, if eps > 0
BACK = 6  # rows from each of these coefficients to the one for n < 0
PASSES, ROOT = 20, 21  # 1 for an orbit of the kind "passes", else 0; sqrt(|A**2 - k**2|)
R, RATE = 22, 23  # r of an orbit of the kind "passes"; the result of `rate`
MISSING = 24  # the sign of the n with unknown states, if eps > 0; 0 if there are none
TIME, RHO, SIGMA, UNIT, OUT1, OUT2 = range(25, 31)
E_, ROOT_A, G1, G2 = range(31, 35)  # e > 0, sqrt(I1 I2), I13 / I1 and I23 / I2
H1, H2, PER_G = range(35, 38)  # I13 / ROOT_A, I23 / ROOT_A and 1 / |g|**2
TURN1, TURN2 = range(38, 40)  # ROOT_A / I1 and ROOT_A / I2
ROWS = 40
STATE, BODY = np.int64(OUT1), np.int64(I1_)  # typed, see `decorators.ZERO`
new_block = block_of(ROWS, int(LANES))


@formula
def is_ordinary(w1, w2):
    """Return True if the powers of this state in the closed form are in the range of float64."""
    size = select(abs(w1) > abs(w2), abs(w1), abs(w2))
    return (size <= ORDINARY) & (size >= 1.0 / ORDINARY)


@formula
def unit_of(w1, w2, k):
    """Return a power of two about as large as a state: in this unit its square is in range.

    The orbit in this unit is the orbit of omega / unit, k / unit and eps * unit.
    """
    _, exponent = math.frexp(select(abs(w1) > abs(w2), w1, w2))
    least = select(k == 0.0, -800, 0)  # in a smaller unit k**2 may be out of range
    exponent = select(exponent < least, least, select(exponent > 800, 800, exponent))
    return math.ldexp(1.0, exponent)


@formula
def nonzero(v):
    """Return v, a factor of 1 - L**2; TINY in place of 0, as on the critical level L = 1."""
    return select(v == 0.0, TINY, v)


@formula
def constants_of(I1, I2, I13, I23):
    """Return a = sqrt(I1 I2), g1 = I13 / I1, g2 = I23 / I2, I13 / a, I23 / a and 1 / |g|**2."""
    root_a = np.sqrt(I1 * I2)
    g1, g2 = I13 / I1, I23 / I2
    return root_a, g1, g2, I13 / root_a, I23 / root_a, 1.0 / (I13 * g1 + I23 * g2)


@formula
def coordinates(I13, I23, k, root_a, g1, g2, w1, w2):
    """Return ell, x and nu of a state (w1, w2); root_a, g1 and g2 are from `constants_of`."""
    x = I13 * w1 + I23 * w2
    return x + k, x, root_a * (g2 * w1 - g1 * w2)


@formula
def steady(g1, g2, h1, h2, x, nu):
    """Invert `coordinates`: return |g|**2 (w1, w2) from x and nu; h = (I13, I23) / sqrt(I1 I2)."""
    return g1 * x + h2 * nu, g2 * x - h1 * nu


@formula
def difference_of_squares(ell, x, nu, k, X, K):
    """Return A**2 - k**2, by the identity in the head of this file; X = K = 0 for the flow."""
    return (nu * nu + ell * (x - k) - (K * ell) * (K * ell)) / (1.0 + X * X)


@formula
def fill_coefficients(b, l, ahead, passes, root, half_d12, d22_passes, d22_turns, R2, square):
    """Fill rows of lane l with b, c, d12 and d22, for n >= 0 if `ahead` is 1, for n < 0 if -1.

    Formulas and letters are in the head of this file. `passes` is True for an orbit from one steady
    state to another, False for one that turns; `d22_passes` and `d22_turns` are d22 of both kinds.
    """
    row = B1 if ahead > 0.0 else B1 + BACK
    k, w1, w2 = b[K_, l], b[W1, l], b[W2, l]
    g1, g2, h1, h2, per_g = b[G1, l], b[G2, l], b[H1, l], b[H2, l], b[PER_G, l]
    ell, _, nu = coordinates(b[I13_, l], b[I23_, l], k, b[ROOT_A, l], g1, g2, w1, w2)
    # The real parts, and minus the imaginary parts, of conj(g) b and conj(g) c.
    b_x = select(passes, 2.0 * (root * ell - k * half_d12), 2.0 * ahead * k * nu)
    b_nu = -ahead * select(passes, d22_passes, 2.0 * (d22_turns - k * ell))
    c_x = -select(passes, k * d22_passes, k * d22_turns + square * ell)
    c_nu = select(passes, -ahead * root * d22_passes, square * nu)
    b1, b2 = steady(g1, g2, h1, h2, b_x, b_nu)
    c1, c2 = steady(g1, g2, h1, h2, c_x, c_nu)
    # Formulas for an orbit that turns hold for any g, but their terms cancel next to ell = 0.
    i1 = -2.0 * ahead * ((k * b[TURN1, l]) * w2 + R2 * h2)
    i2 = 2.0 * ahead * ((k * b[TURN2, l]) * w1 + R2 * h1)
    back1, back2 = steady(g1, g2, h1, h2, R2 * (ell + k), -(R2 * nu))
    by_g = passes | (2.0 * abs(ell) < abs(k))
    b[row, l] = select(by_g, b1 * per_g, i1)
    b[row + 1, l] = select(by_g, b2 * per_g, i2)
    b[row + 2, l] = select(by_g, c1 * per_g, -(k * k * w1) - back1)
    b[row + 3, l] = select(by_g, c2 * per_g, -(k * k * w2) - back2)
    b[row + 4, l] = select(passes, 2.0 * half_d12, -2.0 * ahead * nu)
    b[row + 5, l] = select(passes, d22_passes, d22_turns)


@formula
def fill_orbit(b, l, is_map):
    """Fill rows B1 to MISSING of lane l for the orbit from its state 0; RATE becomes L = e ROOT."""
    k, w1, w2 = b[K_, l], b[W1, l], b[W2, l]
    g1, g2, e = b[G1, l], b[G2, l], b[E_, l]
    ell, x, nu = coordinates(b[I13_, l], b[I23_, l], k, b[ROOT_A, l], g1, g2, w1, w2)
    e_map = is_map * e
    X, Y, K = e_map * ell, e_map * nu, e_map * k
    inverse = 1.0 / (1.0 + X * X)
    square = difference_of_squares(ell, x, nu, k, X, K)
    passes = square > NO_SQUARE
    root = np.sqrt(select(passes, square, select(square < -NO_SQUARE, -square, NO_SQUARE)))

    one_minus_Y = nonzero(1.0 - Y)
    one_plus_Y = nonzero(1.0 + Y)
    one_minus_L2 = (nonzero(one_minus_Y + K * X) * nonzero(one_plus_Y + K * X)) * inverse
    per_one_plus_L = 1.0 / (1.0 + e_map * root)
    b[R, l] = select(is_map > 0.0, one_minus_L2 * per_one_plus_L * per_one_plus_L, 1.0)

    # root -+ |nu|, and middle -+ product = root**2 + k ell -+ root |nu|: see the file's head.
    total = root + abs(nu)
    by_x = ell * (ell * (one_minus_Y * one_plus_Y)) * inverse
    by_k = k * (ell * (2.0 + K * X)) * inverse
    # Next to |k| = A the terms by_x and by_k cancel, and root - |nu| is exact.
    cancel = abs(by_x) + abs(by_k) > total * total
    difference = select(cancel, root - abs(nu), (by_x - by_k) / total)
    middle = root * root + k * ell
    product = root * abs(nu)
    larger = middle + select(middle < 0.0, -product, product)
    smaller = ell * (ell / larger) * ((x * x + nu * nu) * inverse * one_minus_L2)
    plus = select(middle < 0.0, smaller, larger)
    minus = select(middle < 0.0, larger, smaller)
    # 2 k ell + A**2 - k**2, by the formula with the smaller terms.
    by_squares = (nu * nu + (ell * ell) * (1.0 + K * (2.0 * X - K))) * inverse
    size = (nu * nu + (ell * ell) * (1.0 + K * K + 2.0 * abs(K * X))) * inverse
    d22_turns = select(size < abs(2.0 * k * ell), by_squares, 2.0 * k * ell + square)
    R2 = (b[I1_, l] * w1 * w1 + b[I2_, l] * w2 * w2) * inverse
    negative = nu < 0.0
    half_d12 = select(negative, total, difference)
    d22_passes = 2.0 * select(negative, plus, minus)
    fill_coefficients(b, l, 1.0, passes, root, half_d12, d22_passes, d22_turns, R2, square)
    half_d12 = select(negative, difference, total)
    d22_passes = 2.0 * select(negative, minus, plus)
    fill_coefficients(b, l, -1.0, passes, root, half_d12, d22_passes, d22_turns, R2, square)

    fixed = ell == 0.0
    in_range = (abs(X) <= RANGE) & (abs(Y) <= RANGE) & (abs(K) <= RANGE)
    undefined = abs(1.0 - abs(Y)) < ZERO_TO_ROUNDING * (1.0 + abs(Y))  # 0 / 0 if ell = 0
    missing = select(fixed, undefined, abs(ell) < FAINT * abs(nu))
    b[PASSES, l] = select(fixed, 0.0, select(passes, 1.0, 0.0))
    b[ROOT, l] = select(in_range, root, np.nan)
    b[RATE, l] = select(fixed, 0.0, e * root)
    b[MISSING, l] = select(missing, select(negative, -1.0, 1.0), 0.0)


@formula
def rate(passes, L, r, is_map):
    """Return the rate of an orbit: log|r| if it passes, and the angle a = arctan(L) if it turns.

    Letters are as in the head of this file, with L = e root. For the flow the rate is -2 L or L.
    For the map, if L > 1, the angle is a - pi / 2, which keeps more digits; then `pair` adds
    (n % 2) pi / 2.
    """
    if is_map == 0.0:
        return -2.0 * L if passes > 0.0 else L
    if passes == 0.0:
        return -math.atan(1.0 / L) if L > 1.0 else math.atan(L)
    less = 2.0 * select(L < 1.0, L, 1.0) / (1.0 + L)  # 1 - |r|
    return math.log1p(-less) if less < 0.5 else math.log(abs(r))


@formula
def has_power(r, n):
    """Return True if r**n is a real number with a known sign, for n >= 0."""
    return r >= CRITICAL or (n == np.floor(n) and n <= PARITY_KNOWN)


@formula
def pair(n, passes, root, r, rate):
    """Return rho and sigma at step or time n >= 0 by the `rate`; NaN if r**n is not real."""
    t = rate * n if n > 0.0 and rate != 0.0 else 0.0
    if passes == 0.0:
        t += 0.5 * np.pi * (n % 2.0) if rate < 0.0 else 0.0
        return np.cos(t), np.sin(t) / root  # `math` raises at infinity
    if not has_power(r, n):
        return np.nan, np.nan
    if t > -1.0:
        less = math.expm1(t)
        rho = 1.0 + less
    else:
        rho = 0.0 if t < VANISHES else math.exp(t)
        less = rho - 1.0
    if r < 0.0 and n % 2.0 == 1.0:
        rho, less = -rho, -2.0 - less
    return rho, -0.5 * less / root


@formula
def state(b, l):
    """Return the state of lane l of a block `b` from its rows RHO and SIGMA; NaN after a pole."""
    ahead, rho, sigma = b[TIME, l] >= 0.0, b[RHO, l], b[SIGMA, l]
    rho2 = rho * rho
    rho_sigma = rho * sigma
    sigma2 = sigma * sigma
    d12 = select(ahead, b[D12, l], b[D12 + BACK, l]) * rho_sigma
    d22 = select(ahead, b[D22, l], b[D22 + BACK, l]) * sigma2
    d = (rho2 + d22) + d12
    size = (rho2 + abs(d22)) + abs(d12)
    inverse = 1.0 / select(abs(d) > ZERO_TO_ROUNDING * size, d, np.nan)
    c1 = select(ahead, b[C1, l], b[C1 + BACK, l]) * sigma2
    c2 = select(ahead, b[C2, l], b[C2 + BACK, l]) * sigma2
    b1 = select(ahead, b[B1, l], b[B1 + BACK, l]) * rho_sigma
    b2 = select(ahead, b[B2, l], b[B2 + BACK, l]) * rho_sigma
    w1 = (b[W1, l] * rho2 + c1) + b1
    w2 = (b[W2, l] * rho2 + c2) + b2
    return (w1 * inverse) * b[UNIT, l], (w2 * inverse) * b[UNIT, l]


@formula
def adjacent(b, l):
    """Return state 1 or -1 of lane l of a block `b` by a step: for large K `state` may be 0 / 0."""
    eps = abs(b[EPS, l]) * b[TIME, l]
    w1, w2 = one_step(
        b[I1_, l], b[I2_, l], b[I13_, l], b[I23_, l], b[K_, l], eps, b[W1, l], b[W2, l]
    )
    in_range = select(np.isnan(b[ROOT, l]), np.nan, b[UNIT, l])
    return w1 * in_range, w2 * in_range


@formula
def reason(b, l):
    """Return why lane l has no state: 0, 1 or 2, as in `states`."""
    if b[PASSES, l] > 0.0 and not has_power(b[R, l], abs(b[TIME, l])):
        return 0
    if b[PASSES, l] == 0.0 and b[TIME, l] * b[MISSING, l] > 0.0:
        return 2  # the state would be 0 / 0
    total = b[ROOT, l] + b[RHO, l]
    for row in range(B1, D22 + BACK + 1):
        total += b[row, l]
    return 2 if abs(total) < np.inf else 1


@formula
def fill_bodies(b, first, width, lanes, parameters, is_map):
    """Fill `lanes` lanes with the bodies of `width` trajectories from `first` on, repeatedly."""
    i = first
    for l in range(lanes):
        fill_parameters(b, l, BODY, parameters, i)
        i = i + 1 if i + 1 < first + width else first
    for l in range(LANES):
        I1, I2 = b[I1_, l], b[I2_, l]
        root_a, b[G1, l], b[G2, l], b[H1, l], b[H2, l], b[PER_G, l] = constants_of(
            I1, I2, b[I13_, l], b[I23_, l]
        )
        b[ROOT_A, l] = root_a
        b[TURN1, l] = root_a / I1
        b[TURN2, l] = root_a / I2
        b[E_, l] = 0.5 * select(is_map > 0.0, abs(b[EPS, l]), 1.0) / root_a
        b[UNIT, l] = 1.0


@formula
def rescale(b, lanes, is_map):
    """Divide very large and small states in `b`, and k, by a power of two, which goes to UNIT."""
    for l in range(lanes):
        if not is_ordinary(b[W1, l], b[W2, l]):
            unit = unit_of(b[W1, l], b[W2, l], b[K_, l])
            inverse = 1.0 / unit
            b[UNIT, l] = unit
            b[K_, l] *= inverse
            b[EPS, l] *= unit
            b[W1, l] *= inverse
            b[W2, l] *= inverse
            if is_map > 0.0:
                b[E_, l] = 0.5 * abs(b[EPS, l]) / b[ROOT_A, l]


@formula
def start_orbits(b, first, width, used, omega0, is_map):
    """Fill the first `used` lanes of a block `b` with orbits from the states 0 in `omega0` (B, 2).

    The lanes get trajectories `first` to first + width - 1, again and again. Return True if a lane
    got a unit (`unit_of`): then rows of its body have changed, and must be filled for other orbits.
    """
    i = first
    for l in range(used):
        b[W1, l], b[W2, l] = omega0[i, 0], omega0[i, 1]
        i = i + 1 if i + 1 < first + width else first
    extreme = ZERO
    for l in range(LANES):
        extreme += ~is_ordinary(b[W1, l], b[W2, l])
    if extreme > 0:
        rescale(b, used, is_map)
    for l in range(LANES):
        fill_orbit(b, l, is_map)
    for l in range(used):
        b[RATE, l] = rate(b[PASSES, l], b[RATE, l], b[R, l], is_map)
    return extreme > 0


@kernel
def states(part, parts, parameters, omega0, is_map, n, out, reasons):
    """Compute part `part` of `parts` of the states of trajectories, by the closed form.

    parameters   (I1, I2, I13, I23, k, eps), each (1,) or (B,)
    omega0       (B, 2), state 0; NaN gives NaN
    is_map       1.0 for the map, 0.0 for the flow (then n are times, and eps is ignored)
    n            (N,), of any sign and in any order
    out          (N, B, 2)
    reasons      (3, B) bool, set to True where a state is NaN, with the letters of the head of this
                 file. 0: r**n is not real; 1: X, Y or K is above RANGE, or a number is out of
                 range; 2: a pole is before the state, or 0 / 0
    """
    parameters, omega0, n, reasons = uncounted((parameters, omega0, n, reasons))
    target = array_at(out.ctypes.data, (out.size,), np.float64)
    B, N, b = len(omega0), len(n), new_block()
    # If there are few trajectories, a block has each at several values of n, to use all lanes.
    abreast = LANES // B if 0 < B < LANES else 1
    blocks = (B + LANES - 1) // LANES
    rows = (N + abreast - 1) // abreast
    begin, end = share(blocks * rows, part, parts)
    common = are_common(parameters)
    started, filled = ZERO - 1, NO  # the block in `b`; True if the next one has the same bodies
    for task in range(begin, end):
        block = task // rows
        row = task % rows * abreast
        first = block * LANES
        width = lesser(LANES, B - first)
        count = lesser(abreast, N - row)
        used = width * count
        if block != started:
            if not filled:
                lanes = LANES if common and B > LANES else used
                fill_bodies(b, first, width, lanes, parameters, is_map)
            scaled = start_orbits(b, first, width, used, omega0, is_map)
            started, filled = block, common and not scaled
        for j in range(count):
            for l in range(j * width, (j + 1) * width):
                forward = is_map == 0.0 or b[EPS, l] >= 0.0
                steps = abs(n[row + j]) if is_map > 0.0 else abs(n[row + j]) * b[UNIT, l]
                b[TIME, l] = n[row + j] if forward else -n[row + j]
                b[RHO, l], b[SIGMA, l] = pair(steps, b[PASSES, l], b[ROOT, l], b[R, l], b[RATE, l])
                if b[TIME, l] * b[MISSING, l] > 0.0:
                    b[RHO, l] = np.nan
        special = ZERO
        for l in range(LANES):
            b[OUT1, l], b[OUT2, l] = state(b, l)
            exists = abs(b[OUT1, l]) + abs(b[OUT2, l]) < np.inf
            usual = exists & (abs(b[TIME, l]) != 1.0)
            special += ~usual
        for l in range(used if special > 0 else 0):
            if is_map > 0.0 and abs(b[TIME, l]) == 1.0:
                b[OUT1, l], b[OUT2, l] = adjacent(b, l)
            exists = abs(b[OUT1, l]) + abs(b[OUT2, l]) < np.inf
            if not exists and abs(b[W1, l] + b[W2, l]) < np.inf:
                b[OUT1, l], b[OUT2, l] = np.nan, np.nan
                reasons[reason(b, l), first + l % width] = True
        store_rows(b, STATE, target, 2 * (row * B + first), used)
