"""The closed form: state n of an orbit, in steps or in time, with a rotor or without.

Letters as in `steps_3d`: z, g, e, l, X = e l, Y = -e Im(conj(g) z), K = e k; x = l, u = x - k and
y = -Im(conj(g) z), so that conj(g) z = u - i y. With R = |z| / sqrt(1 + X**2) and A = R |g|, which
are conserved, let psi = arg(z / (1 - i X)) - arg g and (p, q) = (sin(psi / 2), cos(psi / 2)).
Then a step is linear,

    (p, q) -> (1 + e G) (p, q),    G = ((0, A + k), (A - k, 0)),    G**2 = A**2 - k**2,

and the flow is exp(t G / (2 sqrt(I1 I2))) with the R, A, psi of e = 0. State n is a quotient of
quadratic forms in the numbers c and s of (1 + e G)**n = c + s G, up to a factor. Two pairs
(rho, sigma) stand for (c, s):

passes    A**2 > k**2: rho = c - L s = r**n and sigma = s = (1 - rho) / (2 L), where
          L = sqrt(A**2 - k**2), r = (1 - h L) / (1 + h L): from one steady state to another
turns     A**2 <= k**2: rho = cos(n a), sigma = sin(n a) / M, M = sqrt(k**2 - A**2), tan(a) = h M

with h = e for the map, and h = 0 with log r = -2 e n L or a = e n M, e = 1 / (2 sqrt(I1 I2)), for
the flow. The state is (z rho**2 + b rho sigma + c sigma**2) / (rho**2 + d12 rho sigma + d22
sigma**2), where z, b and c are complex numbers, and for eps > 0 and n >= 0

passes    d12 = 2 (L - y), d22 = 2 (L**2 + k x - L y), |g|**2 c = g d22 (i L - k),
          |g|**2 b = g (2 (L x - k (L - y)) + i d22)
turns     d12 = -2 y, d22 = 2 k x + A**2 - k**2, c = -k**2 z - R**2 g (g conj(z) + 2 k),
          b = 2 i (k z + R**2 g)

Back in time conj(g) z, conj(g) b and conj(g) c are conjugated: y -> -y. Differences that cancel
next to a steady state, next to |k| = A and next to the critical level e L = 1 are formed by
identities: L - y, L**2 + k x - L y and 1 - (e L)**2 in `orbit`.
"""

import numpy as np

from .elementary import cosine_and_sine, exponential, is_integer, logarithm, quarter_turns
from .numba import formula, kernel, select, share
from .rows import alignment, pick, write
from .steps_3d import RANGE
from .universal import universal

LANES, GROUP = 128, 8
ROWS_OF_TASK = 128  # times the number of n in a block
# In place of a factor that is 0 exactly on the critical level e L = 1: all that vanish with it stay
# in proportion, so that state 1 and the collapse onto the steady state come out.
TINY = 2.0**-100
CRITICAL = 2.0**-90  # r below this is 0, or negative: no real power
NO_SQUARE = 1e-300  # |A**2 - k**2| below this: its root is replaced, and sin(n a) / M is n h
STEEP = 2.0  # in place of r, if the angle of a step is above half a quarter turn
PARITY_KNOWN = 2.0**53
ZERO_TO_ROUNDING = 2.0**-50  # a denominator below this part of its terms is a pole
FAINT = 1e-140  # of x / y, on the way from a steady state: squares below that are subnormal


@formula
def nonzero(v):
    """The number, or TINY in place of 0."""
    return select(v == 0.0, TINY, v)


@formula
def coordinates(I1, I2, I13, I23, k, w1, w2):
    """x, u, y and sqrt(I1 I2)."""
    s, u = np.sqrt(I1 * I2), I13 * w1 + I23 * w2
    return u + k, u, s * ((I23 / I2) * w1 - (I13 / I1) * w2), s


@formula
def steady(I1, I2, I13, I23, s, u, y):
    """The state with these u and y, times |g|**2."""
    return (I13 / I1) * u + (I23 / s) * y, (I23 / I2) * u - (I13 / s) * y


@formula
def difference_of_squares(x, u, y, k, X, K):
    """A**2 - k**2."""
    return (y * y + x * (u - k) - (K * x) * (K * x)) / (1.0 + X * X)


@formula
def orbit(I1, I2, I13, I23, k, eps, w1, w2, discrete, direction):
    """The numbers of an orbit, rows B1 to RATE, with `direction` -1 for n < 0."""
    x, u, y, s = coordinates(I1, I2, I13, I23, k, w1, w2)
    e = 0.5 * select(discrete > 0.0, abs(eps), 1.0) / s
    h = discrete * e
    ahead = select((discrete > 0.0) & (eps < 0.0), -direction, direction)
    y = ahead * y
    X, Y, K = h * x, h * y, h * k
    below = 1.0 / (1.0 + X * X)
    R2 = (I1 * w1 * w1 + I2 * w2 * w2) * below
    square = difference_of_squares(x, u, y, k, X, K)
    passes = square > NO_SQUARE
    root = np.sqrt(select(passes, square, select(square < -NO_SQUARE, -square, NO_SQUARE)))

    # Towards a steady state: gap = L - y, minus = 2 (L**2 + k x - L y).
    less, more, total = nonzero(1.0 - Y), nonzero(1.0 + Y), root + abs(y)
    one_minus_square = (nonzero(less + K * X) * nonzero(more + K * X)) * below  # 1 - (h L)**2
    gap = (x * (x * (less * more) - k * (2.0 + K * X))) * below / total
    gap = select(y < 0.0, total, gap)
    A2, S, product = (u * u + y * y) * below, root * root + k * x, root * abs(y)
    larger = S + select(S < 0.0, -product, product)
    smaller = x * (x / larger) * (A2 * one_minus_square)
    minus = 2.0 * select((y < 0.0) == (S >= 0.0), larger, smaller)
    per_g = 1.0 / (I13 * (I13 / I1) + I23 * (I23 / I2))
    b1, b2 = steady(I1, I2, I13, I23, s, 2.0 * (root * x - k * gap), -ahead * minus)
    c1, c2 = steady(I1, I2, I13, I23, s, -k * minus, -ahead * root * minus)

    # Around: multiples of z, i z, g and i g.
    ks, along, across = k * s, R2 * (x + k), ahead * (R2 * y)
    around1 = -2.0 * ahead * ((ks / I1) * w2 + R2 * (I23 / s))
    around2 = 2.0 * ahead * ((ks / I2) * w1 + R2 * (I13 / s))
    back1, back2 = steady(I1, I2, I13, I23, s, along, -across)
    b1, b2 = select(passes, b1 * per_g, around1), select(passes, b2 * per_g, around2)
    c1 = select(passes, c1 * per_g, -(k * k * w1) - back1)
    c2 = select(passes, c2 * per_g, -(k * k * w2) - back2)
    d12 = select(passes, 2.0 * gap, -2.0 * y)
    d22 = select(passes, minus, 2.0 * k * x + square)

    # r (1.0 for the flow) and log|r|; or the angle a in quarter turns, and what is left to one.
    L = h * root
    one_more = 1.0 / (1.0 + L)
    r = one_minus_square * one_more * one_more
    log_r = logarithm(abs(r), 2.0 * select(L < 1.0, L, 1.0) * one_more)
    steep = L > 1.0
    angle = quarter_turns(select(steep, -1.0, L) / select(steep, L, 1.0))
    r = select(discrete > 0.0, select(passes, r, select(steep, STEEP, 1.0)), 1.0)
    slow = e * root
    rate = select(
        discrete > 0.0,
        select(passes, log_r, angle),
        select(passes, -2.0 * slow, slow / (0.5 * np.pi)),
    )
    undefined = abs(1.0 - Y) < ZERO_TO_ROUNDING * (1.0 + abs(Y))  # 0 / 0, if the state is at rest
    rests = x == 0.0
    rate = select(rests, select(undefined, np.nan, 0.0), rate)
    in_range = (abs(X) <= RANGE) & (abs(Y) <= RANGE) & (abs(K) <= RANGE)
    in_range &= rests | (abs(x) >= FAINT * y)
    passing = select(rests, 0.0, select(passes, 1.0, 0.0))
    return b1, c1, b2, c2, d12, d22, passing, select(in_range, root, np.nan), r, rate


@formula
def pair(n, passes, root, r, rate):
    """(rho, sigma) after n >= 0 steps, or at time n of the flow; NaN if there is no real power."""
    t = select(n > 0.0, rate * n, 0.0)
    # As above log|r|; where r < 0, odd n change the sign.
    rho, less = exponential(select(passes > 0.0, t, 0.0))
    changes = (r < 0.0) & ~is_integer(0.5 * n)
    rho, less = select(changes, -rho, rho), select(changes, -2.0 - less, less)
    rho = select((r < CRITICAL) & ~(is_integer(n) & (n <= PARITY_KNOWN)), np.nan, rho)
    # Angles; where a is more than half a quarter turn, t counts from n quarter turns.
    half = 0.5 * n
    c, s = cosine_and_sine(t + select(r == STEEP, n - 2.0 * np.floor(half), 0.0))
    return select(passes > 0.0, rho, c), select(passes > 0.0, -0.5 * less, s) / root


@formula
def state(w1, w2, b1, c1, b2, c2, d12, d22, rho, sigma):
    """The state of a pair; NaN after a pole."""
    square, both, other = rho * rho, rho * sigma, sigma * sigma
    second, third = d12 * both, d22 * other
    d, size = (square + third) + second, (square + abs(third)) + abs(second)
    inverse = 1.0 / select(abs(d) > ZERO_TO_ROUNDING * size, d, np.nan)
    return (
        ((w1 * square + c1 * other) + b1 * both) * inverse,
        ((w2 * square + c2 * other) + b2 * both) * inverse,
    )


# Rows of a block.
(W1, W2, B1, C1, B2, C2, D12, D22, PASSES, ROOT, R, RATE) = range(12)
(Q1, Q2, Q13, Q23, QK, QE) = range(12, 18)  # I1, I2, I13, I23, k and eps
ROWS = 18


@formula
def orbits_of(b, first, width, used, parameters, omega0, discrete, direction):
    """Fill the lanes: `width` orbits from trajectory `first` on, again and again."""
    I1, I2, I13, I23, k, eps = parameters
    for l in range(width):
        i = first + l
        b[W1, l], b[W2, l], b[Q1, l], b[Q2, l] = (
            omega0[i, 0],
            omega0[i, 1],
            pick(I1, i),
            pick(I2, i),
        )
        b[Q13, l], b[Q23, l], b[QK, l], b[QE, l] = (
            pick(I13, i),
            pick(I23, i),
            pick(k, i),
            pick(eps, i),
        )
    for group in range(0, width, GROUP):
        for j in range(GROUP):
            l = np.uint64(group) + np.uint64(j)
            (
                b[B1, l], b[C1, l], b[B2, l], b[C2, l], b[D12, l], b[D22, l],
                b[PASSES, l], b[ROOT, l], b[R, l], b[RATE, l],
            ) = orbit(
                b[Q1, l], b[Q2, l], b[Q13, l], b[Q23, l], b[QK, l], b[QE, l], b[W1, l], b[W2, l],
                discrete, direction,
            )  # fmt: skip
    for row in range(RATE + 1):
        for l in range(width, used):
            b[row, l] = b[row, l - width]


@formula
def explain(b, l, n, reasons, i):
    """Note why a state of trajectory i is NaN."""
    if b[ROOT, l] != b[ROOT, l]:
        reasons[1, i] = True
    elif b[PASSES, l] > 0.0 and b[R, l] < CRITICAL and not (is_integer(n) and n <= PARITY_KNOWN):
        reasons[0, i] = True
    else:
        reasons[2, i] = True


@kernel
def states(part, parts, parameters, omega0, discrete, n, out, reasons):
    """States of trajectories by the closed form.

    parameters   (I1, I2, I13, I23, k, eps), each (1,) or (B,)
    omega0       (B, 2), state 0; NaN gives NaN
    discrete     1.0 for the map, 0.0 for the flow (n are times, and eps is not used)
    n            (N,), of any sign and in any order
    out          (N, B, 2)
    reasons      (3, B) bool, set where a state is NaN: n is not an integer where r has no real
                 power; X, Y or K above RANGE; the state after a pole, or after the point 0 / 0

    A block is `width` trajectories at `abreast` n, so that few trajectories fill the lanes, too.
    """
    B, N, flat = len(omega0), len(n), out.reshape(out.size)
    b, tile, times = np.ones((ROWS, LANES)), np.empty(2 * LANES), np.ones(LANES)
    abreast = max(1, LANES // max(B, 1))
    lead, shift = alignment(out, 0, B, LANES)
    blocks = (B + shift + LANES - 1) // LANES
    rows = abreast * ROWS_OF_TASK
    chunks, order = (N + rows - 1) // rows, np.empty(rows + 1, np.int64)
    first_task, last_task = share(blocks * chunks, part, parts)
    for task in range(first_task, last_task):
        block, begin = task // chunks, task % chunks * rows
        first = max(block * LANES - shift, 0)
        width = min((block + 1) * LANES - shift, B) - first
        at, end = 0, 0
        for direction in (1.0, -1.0):
            for j in range(begin, min(begin + rows, N)):
                order[end] = j  # kept if n has this sign
                end += 1 if (n[j] >= 0.0) == (direction > 0.0) else 0
            if at < end:
                used = width * min(abreast, end - at)
                orbits_of(b, first, width, used, parameters, omega0, discrete, direction)
            while at < end:
                count = min(abreast, end - at)
                used, failed = width * count, 0
                for row in range(count):
                    for l in range(row * width, (row + 1) * width):
                        times[l] = abs(n[order[at + row]])
                for l in range(LANES):
                    rho, sigma = pair(times[l], b[PASSES, l], b[ROOT, l], b[R, l], b[RATE, l])
                    tile[2 * l], tile[2 * l + 1] = state(
                        b[W1, l], b[W2, l], b[B1, l], b[C1, l], b[B2, l], b[C2, l],
                        b[D12, l], b[D22, l], rho, sigma,
                    )  # fmt: skip
                for l in range(used):
                    failed += 1 if tile[2 * l] != tile[2 * l] else 0
                if failed > 0:
                    for l in range(used):
                        if tile[2 * l] != tile[2 * l] and not np.isnan(b[W1, l] + b[W2, l]):
                            explain(b, l, times[l], reasons, first + l % width)
                place = 2 * (order[at] * B + first)
                if order[at + count - 1] - order[at] == count - 1:  # neighbours in the output
                    write(tile, flat, place, 2 * used, lead)
                else:
                    for row in range(count):
                        place = 2 * order[at + row] * B
                        for j in range(2 * B):
                            flat[place + j] = tile[2 * B * row + j]
                at += count


@universal("(),(),(),(),(),(),(d)->(d),(d)")
def limits(I1, I2, I13, I23, k, eps, omega, minus, plus):
    """The states to which an orbit tends for n to -infinity and +infinity.

    They are the steady states u = -k, y = +- L; NaN for an orbit that turns, and itself, twice, for
    one that rests.
    """
    w1, w2 = omega[0], omega[1]
    x, u, y, s = coordinates(I1, I2, I13, I23, k, w1, w2)
    e = 0.5 * eps / s
    X, Y, K = e * x, e * y, e * k
    square = difference_of_squares(x, u, y, k, X, K)
    in_range = abs(X) <= RANGE and abs(Y) <= RANGE and abs(K) <= RANGE
    per_g = 1.0 / (I13 * (I13 / I1) + I23 * (I23 / I2))
    L = np.copysign(np.sqrt(square), eps) if in_range and square >= 0.0 else np.nan
    rests = eps == 0.0 or x == 0.0 or (w1 == 0.0 and w2 == 0.0)
    for out, sign in ((minus, 1.0), (plus, -1.0)):
        v1, v2 = steady(I1, I2, I13, I23, s, -k, sign * L)
        out[0], out[1] = (w1, w2) if rests else (v1 * per_g, v2 * per_g)
        if x == 0.0 and abs(1.0 + sign * Y) < 2.0 * ZERO_TO_ROUNDING:  # 0 / 0
            out[0], out[1] = np.nan, np.nan
