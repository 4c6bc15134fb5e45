"""Plain Python, and NumPy over whole batches, step by step."""

import numpy as np
from formulas import EPS, Formulas, matrix_nd, step_as_printed

MAP = Formulas()


def final_python(omega0, steps, threads):
    """Last states by the map as printed, without NumPy."""
    result = []
    for p, q in omega0.tolist():
        for _ in range(steps):
            p, q = step_as_printed(p, q)
        result.append((p, q))
    return np.array(result)


def final(omega0, steps, threads):
    """Last states by the map as printed."""
    p, q = omega0.T.copy()
    for _ in range(steps):
        p, q = step_as_printed(p, q)
    return np.stack([p, q], axis=-1)


def stored(omega0, steps, threads, out):
    """All states into (steps + 1, batch, 2)."""
    out[0] = omega0
    p, q = omega0.T.copy()
    for n in range(steps):
        p, q = step_as_printed(p, q)
        out[n + 1, :, 0], out[n + 1, :, 1] = p, q
    return out


def jump(omega0, n):
    """State n by the corrected theorem of Section 4, for x != 0 and t < 1."""
    x, y = MAP.to_xy(*omega0.T)
    h = (MAP.a * x * x + y * y) / (4 * MAP.a + EPS**2 * x * x)
    q = np.sqrt(MAP.a - h * EPS**2)
    s = -2 * np.arctanh(EPS * np.sqrt(h / MAP.a)) * n + np.arcsinh(y / (np.abs(x) * q))
    scale = 2 * np.sqrt(h * MAP.a)
    with np.errstate(over="ignore"):  # 1 / cosh(s) is 0 if cosh overflows
        return np.stack(MAP.from_xy(np.sign(x) * scale / (q * np.cosh(s)), scale * np.tanh(s)), -1)


def flow(omega0, time, threads):
    """State of the continuous motion by Suslov's solution, for x != 0."""
    x, y = MAP.to_xy(*omega0.T)
    R = np.sqrt(MAP.a * x * x + y * y)
    angle = np.arcsinh(y / (np.sqrt(MAP.a) * np.abs(x))) - R * time / MAP.a
    with np.errstate(over="ignore"):  # 1 / cosh(angle) is 0 if cosh overflows
        x = np.sign(x) * R / np.sqrt(MAP.a) / np.cosh(angle)
    return np.stack(MAP.from_xy(x, R * np.tanh(angle)), axis=-1)


def solve(body, omega0, eps, steps):
    """Last states in n dimensions by NumPy's batched solver."""
    omega = omega0
    for _ in range(steps):
        A = matrix_nd(body.J, body.I, eps, omega)
        omega = np.linalg.solve(A, omega[..., None])[..., 0]
    return omega
