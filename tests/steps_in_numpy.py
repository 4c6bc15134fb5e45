"""A step of the motion by its formulas, in NumPy: the ends of columns, and their weighted sum."""

import numpy as np

from suslov_fast.core.flow.batch_solver import BatchSolver, SolverRequest
from suslov_fast.core.flow.code_arguments import NUMBER
from suslov_fast.core.flow.memory import LaneState
from suslov_fast.core.flow.weights import EXPLICIT, IMPLICIT, weights


def attempts(f, table, x, last, settings):
    """Yield t and x (D,): at first, and after each attempted step of `BatchSolver` to `last`."""
    request = SolverRequest([last], 1, settings)
    motion = BatchSolver(f, table, x[np.newaxis], request, np.empty((1, 1, f.D)))
    motion.numbers[NUMBER.most], places = 0.0, motion.rows  # the code returns after each attempt
    rows, mode = motion._rows(slice(0, 1)), int(bool(settings.stiff))
    take = motion._runner(motion.integrator(mode), rows, np.zeros(1, np.int64), 1).take
    while True:
        own = rows[0, : f.D].copy()
        if motion.starts is not None:
            own[[*f.offsets]] += motion.starts[0]
        yield rows[0, places.t], own
        if rows[0, places.state] > LaneState.IMPLICIT:
            return
        while not take():
            pass
        if rows[0, places.state] == LaneState.TOO_MANY:  # it has made its one attempt
            rows[0, places.state] = mode


def explicit_end(f, x, s, N, sets):
    """Return y_N after N sub-steps s by Gragg's rule; by Störmer's if variables fall into sets."""
    a, b = x, x + s * f(x)
    for m in range(1, N // 2 + 1):
        a = a + 2 * s * f(b)
        b = b + (s if m == N // 2 else 2 * s) * f(a)
    if sets is None:
        return (a + b) / 2
    a[sets[1]] = b[sets[1]]
    return a


def implicit_end(f, x, s, N, jacobian):
    """Return y_N after N linearly implicit sub-steps s of Euler's method, f' from the start."""
    matrix, y = np.eye(len(x)) - s * jacobian(x), x
    for _ in range(N):
        y = y + np.linalg.solve(matrix, s * f(y))
    return y


def step(f, x, h, end, columns, p, *given):
    """Return x(t + h) from the ends y_c of all columns: x + sum_c w_c (y_c - x)."""
    ends = [end(f, x, h / N, N, *given) - x for N in columns]
    return x + sum(w * y for w, y in zip(weights(columns, p), ends, strict=True))


def explicit_step(f, x, h, sets):
    return step(f, x, h, explicit_end, EXPLICIT, 2, sets)


def implicit_step(f, x, h, jacobian):
    return step(f, x, h, implicit_end, IMPLICIT, 1, jacobian)
