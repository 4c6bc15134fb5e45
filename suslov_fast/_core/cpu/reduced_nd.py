"""Loops over n-dimensional bodies whose problem is solved, which move as bodies in three do.

three    (5, B): I1, I2, I13, I23 of the 3D bodies, and the step sizes, in the units of time in
         which states are of the order of 1.
state    (B, 2), the states of these bodies.
along,   (B, m): omega is along times the first component of such a state, plus across times the
across   second.
"""

import numpy as np
from numba import prange

from ..formulas.coordinates import sum_of_products
from ..formulas.elementary import exponent, scaled
from ..formulas.reduction import as_product, orthogonal, state_nd, sum_in_two
from ..jit import Loop, part
from ..lanewise import lanewise
from . import intrinsics  # noqa: F401  (compiles what is imported from vector)
from .blocks import TASKS
from .equal_steps import GROUP
from .equal_steps import fill_run as fill_run_loop
from .orbits import WIDTH
from .tiles import BEYOND_CACHES, write_numbers
from .vector import (
    VECTOR,
    borrowed,
    fence,
    shuffled,
    splat,
    store_at,
    to_cache_line,
    vector_at,
)

# States of three dimensions that are made at a time, which stay in the caches until they are read,
# and numbers of a row of a block in n dimensions, if it has more lanes than a vector.
STATES, ROW = 2**15, 2**10

fill_run = fill_run_loop.inner

# The largest exponents of states, of step sizes and of J over J that are taken here: nothing comes
# near the ends of float64 then, at poles neither.
LARGEST, LONGEST, FARTHEST = 900.0, 200.0, 300.0


@part
def largest_of(row):
    """The largest |number|; NaN if one is."""
    largest = 0.0
    for i in range(row.size):
        largest = max(largest, abs(row[i]))
        if row[i] != row[i]:
            return np.nan
    return largest


@part
def rest(p, omega, b, three, state, along, across):
    """A state that does not move, as itself."""
    three[3, b], state[b, 0], state[b, 1] = p, 1.0, 0.0
    for i in range(omega.size):
        along[b, i], across[b, i] = omega[i], 0.0


@part
def split(I, omega, own, k, b, three, state, along, across):
    """The parts of omega along I and orthogonal to it, where I_k is the largest component of I.

    The second is made of I_k omega_i - I_i omega_k, which are accurate next to the steady states,
    where all of them vanish.
    """
    m, omega_k = I.size, scaled(omega[k], -own)
    p, p_lost, square, of_differences, coupled = 0.0, 0.0, 0.0, 0.0, 0
    for i in range(m):
        w = scaled(omega[i], -own)
        p, p_lost = sum_in_two(p, p_lost, I[i], w)
        across[b, i] = sum_of_products(I[k], w, -I[i], omega_k)
        square += I[i] * I[i]
        of_differences += I[i] * across[b, i]
        coupled += I[i] != 0.0
    if coupled == 0:
        rest(0.0, omega, b, three, state, along, across)
        return
    for i in range(m):
        across[b, i] = orthogonal(across[b, i], I[i], of_differences / square, I[k])
    unit = exponent(largest_of(across[b]))
    length = 0.0
    for i in range(m):
        across[b, i] = scaled(across[b, i], -unit)
        length += across[b, i] * across[b, i]
    if length == 0.0 or three[4, b] == 0.0:
        rest(p, omega, b, three, state, along, across)
        return
    length, norm = np.sqrt(length), np.sqrt(square)
    total = p + p_lost
    omega1, I23 = as_product(total, p_lost - (total - p))
    if coupled == 1:
        omega1, I23 = omega_k, I[k]
    three[3, b], state[b, 0] = I23, omega1
    state[b, 1] = scaled(norm * length / I23, unit)
    for i in range(m):
        along[b, i] = scaled(I23 * I[i] / square, own)
        across[b, i] = scaled(across[b, i] / length * (I23 / norm), own)


@part
def reduce_one(J, I, eps, omega, b, three, state, along, across):
    """A trajectory; returns whether its numbers are in a range that is taken here."""
    m, k = J.size, 0
    for i in range(m):
        k = i if abs(I[i]) > abs(I[k]) else k
    largest = largest_of(omega)
    own = exponent(largest) if largest > 0.0 else 0.0
    step = scaled(eps, max(min(own, 1000.0), -1000.0))
    three[4, b] = step
    three[0, b], three[1, b], three[2, b] = J[k], J[0 if k > 0 else m - 1], 0.0
    if m != 2:
        split(I, omega, own, k, b, three, state, along, across)
    apart = abs(exponent(three[0, b]) - exponent(three[1, b]))
    in_range = (apart <= FARTHEST) & (abs(own) + apart <= LARGEST) & (largest == largest)
    return in_range & (exponent(step) <= LONGEST)


def _reduce(J, I, eps, omega, three, state, along, across, fits):
    """The 3D problem of trajectories of bodies whose problem is solved; of n = 3, only `fits`.

    J, I    (B, m), or (1, m) where one body serves all.
    eps     (B,) or (1,)
    omega   (B, m), the states at step 0.
    fits    (B,), receives whether the trajectory is in a range that is taken here.
    """
    batch = omega.shape[0]
    n_tasks = min((batch + WIDTH - 1) // WIDTH, TASKS)
    for task in prange(n_tasks):
        for b in range(task * batch // n_tasks, (task + 1) * batch // n_tasks):
            fits[b] = reduce_one(
                J[b if J.shape[0] > 1 else 0],
                I[b if I.shape[0] > 1 else 0],
                eps[b if eps.size > 1 else 0],
                omega[b],
                b,
                three,
                state,
                along,
                across,
            )


@part
def lanes_of(m):
    """The trajectories of a block, in whole vectors."""
    return max(min(WIDTH, ROW // m // VECTOR * VECTOR), VECTOR)


@part
def padded(m):
    """The components of a trajectory and what fills their last vector, if they fill one."""
    return (m + VECTOR - 1) // VECTOR * VECTOR if m >= VECTOR else m


@part
def length_of_row(m):
    """The numbers of a row at most, and what its last vectors may reach beyond it."""
    return max(lanes_of(m) * m, ROW) + VECTOR * VECTOR


@part
def room_of(m):
    """The numbers that a task works in, beside states: coefficients and a row."""
    return 2 * lanes_of(m) * padded(m) + length_of_row(m)


@part
def take_coefficients(along, across, first, width, coefficients):
    """Those of each trajectory, along before across; of few components, those of a block.

    A single trajectory is there as often as a vector has lanes.
    """
    m, step = along.shape[1], padded(along.shape[1])
    lanes = (width + VECTOR - 1) // VECTOR * VECTOR
    apart, other = (2 * step, step) if m >= VECTOR else (m, lanes * m)
    for l in range(lanes):
        b = first + min(l, width - 1)
        for i in range(step):
            coefficients[apart * l + i] = along[b, i] if i < m else 0.0
            coefficients[apart * l + other + i] = across[b, i] if i < m else 0.0


@part
def expand(states, begin, rows, width, m, coefficients, row):
    """States of some rows, from those of 3D.

    Vectors of the last components come first: what they write beyond them is written over.
    """
    step = padded(m)
    apart = 2 * step if width > 1 else 0
    if width == 1:  # its rows are as trajectories that are all alike
        rows, width = 1, rows
    for i in range(step - VECTOR, -1, -VECTOR):
        place = i
        for k in range(begin, begin + 2 * rows * width, 2 * width):
            omega = states[k : k + 2 * width]
            for l in range(width):
                along = vector_at(coefficients, apart * l + i)
                across = vector_at(coefficients, apart * l + step + i)
                state = state_nd(along, across, splat(omega[2 * l]), splat(omega[2 * l + 1]))
                store_at(row, place, state)
                place += m


def _expanding(m):
    places = [[2 * ((VECTOR * k + j) // m) for j in range(VECTOR)] for k in range(m)]

    @lanewise
    def expand_group(states, begin, coefficients, c, other, row, place):
        """VECTOR states of few components, from those of 3D; `other` of c is across, c along."""
        pairs = vector_at(states, begin), vector_at(states, begin + VECTOR)
        for k, firsts in enumerate(places):
            omega1 = shuffled(*pairs, firsts)
            omega2 = shuffled(*pairs, [each + 1 for each in firsts])
            along = vector_at(coefficients, c + k * VECTOR)
            across = vector_at(coefficients, c + other + k * VECTOR)
            store_at(row, place + k * VECTOR, state_nd(along, across, omega1, omega2))

    return expand_group


expand1, expand3, expand4, expand5, expand6, expand7 = map(_expanding, (1, 3, 4, 5, 6, 7))


@part
def expand_few(states, begin, rows, width, m, coefficients, row):
    """`expand` of fewer components than a vector has lanes; what a group has beyond the last
    trajectory is written over.
    """
    other = (width + VECTOR - 1) // VECTOR * VECTOR * m
    apart = VECTOR * m if width > 1 else 0
    if width == 1:
        rows, width = 1, rows
    for r in range(rows):
        for l in range(0, width, VECTOR):
            k, c, place = begin + 2 * (r * width + l), l // VECTOR * apart, (r * width + l) * m
            if m == 3:
                expand3(states, k, coefficients, c, other, row, place)
            elif m == 4:
                expand4(states, k, coefficients, c, other, row, place)
            elif m == 5:
                expand5(states, k, coefficients, c, other, row, place)
            elif m == 6:
                expand6(states, k, coefficients, c, other, row, place)
            elif m == 7:
                expand7(states, k, coefficients, c, other, row, place)
            else:
                expand1(states, k, coefficients, c, other, row, place)


def _fill(three, state, along, across, start, every, lanes_asked, rows, out, status, missing, room):
    """States of n dimensions at the steps of rows begin to end, each `every` after the last.

    start         (1,): 0, the number of the given states.
    lanes_asked   the first trajectory wanted, and the one after the last.
    rows          begin, end, origin: row i goes to row i - origin of `out`, (rows, B, m).
    status        (B,), as in `equal_steps`.
    missing       (tasks, 2), counts what nobody reads.
    room          (tasks, `room_of(m)` and two numbers for each state of a part and VECTOR more), on
                  cache lines.
    """
    batch, m = along.shape
    begin, end, origin = rows
    lanes, whole = lanes_of(m), out.reshape(out.size)
    line, past_caches = to_cache_line(whole, 0), whole.size >= BEYOND_CACHES
    height = max(STATES // min(lanes, batch) // GROUP, 1) * GROUP
    chunks = (end + height - 1) // height - begin // height
    n_blocks = (lanes_asked[1] - lanes_asked[0] + lanes - 1) // lanes
    n_parts = n_blocks * chunks
    n_tasks = min(n_parts, room.shape[0])
    for task in prange(n_tasks):
        flat, own, filled = borrowed(whole), borrowed(room[task]), -1
        split_at = room_of(m) - length_of_row(m)
        coefficients, row = own[:split_at], own[split_at : room_of(m)]
        states = own[room_of(m) :]
        for k in range(task * n_parts // n_tasks, (task + 1) * n_parts // n_tasks):
            first = lanes_asked[0] + k // chunks * lanes
            width = min(lanes, lanes_asked[1] - first)
            last = first + width
            top = max((begin // height + k % chunks) * height, begin)
            bottom = min((begin // height + k % chunks + 1) * height, end)
            fill_run(
                False,
                1.0,
                three[0, first:last],
                three[1, first:last],
                three[2, first:last],
                three[3, first:last],
                three[4, first:last],
                state[first:last],
                start,
                (0.0, every),
                (0, width),
                (top, bottom, -top, 1),
                states[: 2 * width * (bottom - top)].reshape((bottom - top, width, 2)),
                status[first:last],
                missing[task : task + 1],
            )
            if first != filled:
                take_coefficients(along, across, first, width, coefficients)
                filled = first
            # Rows of all trajectories follow each other.
            abreast = max(ROW // (width * m), 1) if width == batch else 1
            for r in range(0, bottom - top, abreast):
                count = min(abreast, bottom - top - r)
                if m < VECTOR:
                    expand_few(states, 2 * width * r, count, width, m, coefficients, row)
                else:
                    expand(states, 2 * width * r, count, width, m, coefficients, row)
                target = ((top + r - origin) * batch + first) * m
                write_numbers(row, 0, flat, target, count * width * m, line, past_caches)
        fence()


reduce = Loop(_reduce)
fill = Loop(_fill)
