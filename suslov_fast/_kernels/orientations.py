"""Orientations along given states, and the test that states are consecutive.

omega   (N + 1, B, m), the states
eps     (B,), the step size
"""

from .._formulas.implicit import distance_to_pole, mismatch, rotor_term, strays, unit_of
from .._formulas.rotation import mean
from .._jit import formula, kernel, share
from .lanes import LANES
from .turning_3d import enter_turns, turn_on, turns_block, write_turns
from .turning_nd import CLEAN_EVERY, clean_up, turn


@kernel
def reconstruct(part, parts, omega, eps, R0, quaternions, turns):
    """Fill the orientations after the first, with the arrays of `turning_3d`."""
    batch, states, r = omega.shape[1], omega.reshape(omega.size), turns_block()
    turning = eps, R0, quaternions, turns
    first_block, last_block = share((batch + LANES - 1) // LANES, part, parts)
    for block in range(first_block, last_block):
        first = block * LANES
        width = min(LANES, batch - first)
        enter_turns(turning, omega[0], first, width, width, r)
        for n in range(len(turns)):
            begin = (n + 1) * batch + first
            turn_on(states[2 * begin : 2 * (begin + width)], r, width)
            write_turns(turning, r, n, first, width)


@kernel
def reconstruct_nd(part, parts, omega, eps, turns, scratch):
    """Fill orientations (N + 1, B, n, n) after the first; scratch (tasks, 3 n + 2, n)."""
    batch, m, tasks = omega.shape[1], omega.shape[2], len(scratch)
    n = m + 1
    first_task, last_task = share(tasks, part, parts)
    for task in range(first_task, last_task):
        memory = scratch[task]
        columns, gram, cleaned = memory[:n], memory[n : 2 * n], memory[2 * n : 3 * n]
        image, b = memory[3 * n], memory[3 * n + 1, :m]
        for i in range(task * batch // tasks, (task + 1) * batch // tasks):
            for r in range(n):
                for c in range(n):
                    columns[c, r] = turns[0, i, r, c]
            for k in range(1, len(turns)):
                for j in range(m):
                    b[j] = mean(omega[k - 1, i, j], omega[k, i, j])
                turn(columns, b, eps[i], image)
                if k % CLEAN_EVERY == 0:
                    clean_up(columns, gram, cleaned)
                for r in range(n):
                    for c in range(n):
                        turns[k, i, r, c] = columns[c, r]


@formula
def follows(equations, row, omega, k, i):
    """Test by the implicit equations that state k + 1 of trajectory i is the image of state k."""
    # Indices instead of slices, which would count references.
    root, h, I, rotor = equations
    m, largest = omega.shape[2], 0.0
    for j in range(m):
        largest = max(largest, max(abs(omega[k, i, j]), abs(omega[k + 1, i, j])))
    unit = unit_of(largest)
    p, p_next, product = 0.0, 0.0, 0.0
    size_p, size_next, size_product = 0.0, 0.0, 0.0
    for j in range(m):
        w, v = omega[k, i, j] * unit, omega[k + 1, i, j] * unit
        p += I[row, j] * w
        p_next += I[row, j] * v
        product += w * v
        size_p += abs(I[row, j] * w)
        size_next += abs(I[row, j] * v)
        size_product += abs(w * v)
    left, step, size, momentum = 0.0, 0.0, 0.0, rotor[row] * unit
    for j in range(m):
        w, v, driven, of_rotor = omega[k, i, j] * unit, omega[k + 1, i, j] * unit, 0.0, 0.0
        if momentum != 0.0:
            other, after = omega[k, i, 1 - j] * unit, omega[k + 1, i, 1 - j] * unit
            driven = rotor_term(j, momentum, other, after)
            of_rotor = abs(rotor_term(j, momentum, abs(other), abs(after)))
        sums, sizes = (p, p_next, product, driven), (size_p, size_next, size_product, of_rotor)
        difference, terms = mismatch(h[row, j] / unit, I[row, j], w, v, sums, sizes)
        left += root[row, j] * abs(difference)
        size += root[row, j] * terms
        step += root[row, j] * abs(v - w)
    distance = 1.0
    if m == 2:
        h1, h2, w1, w2 = h[row, 0], h[row, 1], omega[k, i, 0], omega[k, i, 1]
        distance = distance_to_pole(
            h1 / unit, h2 / unit, I[row, 0], I[row, 1], momentum, w1 * unit, w2 * unit
        )
    return not strays(left, step, size, distance)


@kernel
def follow(part, parts, root, h, I, rotor, omega, stray):
    """Find states that are not the image of the previous state.

    root     (B, m) or (1, m), the weights of the components: the roots of J
    h, I     (B, m) or (1, m): eps / J, and I, which is of the order of 1
    rotor    (B,) or (1,), the momentum of a rotor in the unit of I; 0 unless m = 2
    stray    (B,), the index of the first such state, or -1
    """
    equations, (first, last) = (root, h, I, rotor), share(omega.shape[1], part, parts)
    for i in range(first, last):
        row, k, end = min(i, len(h) - 1), 0, len(omega) - 1
        while k < end and follows(equations, row, omega, k, i):
            k += 1
        stray[i] = k + 1 if k < end else -1
