"""Hashes of results that must be identical on all types of CPU, compiled and interpreted.

    python hashes.py            print the hashes
    python hashes.py --write    store them in hashes.json

Results of LAPACK are left out, since their last bits depend on its build. The positions of NaN
count, but not its sign and payload, which differ between processors.
"""

import hashlib
import json
import sys
import warnings
from pathlib import Path

import numpy as np

import suslov_fast as sf

KEPT = Path(__file__).with_name("hashes.json")


def digest(value):
    array = np.array(value)
    if array.dtype.kind == "f":
        array[np.isnan(array)] = np.nan
    return hashlib.sha256(f"{array.shape} {array.dtype.str}".encode() + array.tobytes()).hexdigest()


def numbers(seed, low, high, *shape):
    """Pseudorandom numbers that are the same on all machines: integers over a power of two."""
    # No library guarantees its stream of floats; a multiplicative generator takes one line.
    count = int(np.prod(shape))
    values, state = np.empty(count), 2 * seed + 1
    for k in range(count):
        state = state * 6364136223846793005 % 2**64
        values[k] = low + (high - low) * ((state >> 40) / 2.0**24)
    return values.reshape(shape)


def bodies_3d():
    yield "picture", sf.Suslov3D(4, 1, -0.5, -0.3), 0.2
    yield "at rest", sf.Suslov3D(2, 3, 0, 0), 0.1
    yield "backwards", sf.Suslov3D(1, 2, 0.3, -0.1), -0.4
    scale = numbers(1, 0.5, 2, 41)
    yield "several", sf.Suslov3D(scale, 1 / scale, scale - 1, 0.25), numbers(2, -1, 1, 41)


def bodies_nd():
    for m in (2, 3, 5, 8):
        body = sf.SuslovND(numbers(m, 1, 2, m), numbers(m + 9, -0.5, 0.5, m))
        yield f"n = {m + 1}", body, 0.1
    yield "n = 4, integrable", sf.SuslovND([2, 2, 2], [0.1, 0.2, 0.3]), 0.1
    yield "n = 4, several", sf.SuslovND(numbers(3, 1, 2, 41, 3), numbers(4, -1, 1, 41, 3)), 0.2


def results_3d(body, eps):
    for scale in (1.0, 40.0, 2.0**-400):
        omega, step = scale * numbers(5, -2, 2, 41, 2), np.asarray(eps) / min(scale, 1.0)
        for method in ("canonical", "ds2"):
            yield method, *run(body, omega, step, 300, method=method)
        yield "last states", *run(body, omega, step, 1000, save_every=None)
        times = np.array([-1e9, -50, -1, 0, 1, 2, 3.5, 700, 1e9])
        yield "exact", sf.exact(body, omega, step, times)
        yield "flow", sf.flow(body, omega, times / min(scale, 1.0))
        yield "limits", *sf.limits(body, omega, step)
        yield from of((sf.criticality, sf.first_integral, sf.jacobian), body, omega, step)
        yield "to_xy", sf.to_xy(body, omega)
        if np.any(body.I13) or np.any(body.I23):  # else (x, y) is 0
            yield "from_xy", sf.from_xy(body, omega)
        yield from of((sf.energy, sf.vector_field, sf.reaction), body, omega)
        yield from of((sf.modified_energy, attitude), body, omega, step)
        yield "step_full", sf.step_full(body, np.insert(omega, 2, 0.5, -1), step, 5.0)


def results_nd(body, eps):
    for scale in (1.0, 40.0):
        omega = scale * numbers(6, -2, 2, 41, body.dimension)
        for method in ("auto", "gauss", "rank2"):
            yield method, *run(body, omega, eps, 100, method=method)
        yield from of((sf.energy, sf.vector_field, sf.reaction), body, omega)
        yield from of((sf.modified_energy, attitude), body, omega, eps)


def bodies_gyrostat():
    yield "gyrostat", sf.SuslovGyrostat(2.3, 1.4, 0.5, -0.7, 0.9), 0.35
    scale = numbers(7, 0.5, 2, 41)
    yield "gyrostat, several", sf.SuslovGyrostat(scale, 1 / scale, scale - 1, 0.25, -scale), 0.2


def results_gyrostat(body, eps):
    quantities = sf.first_integral, sf.invariant_density, sf.jacobian, attitude
    for scale in (1.0, 40.0, 2.0**-400):
        omega = scale * numbers(8, -2, 2, 41, 2)
        yield "auto", *run(body, omega, eps, 300)
        yield from of(quantities, body, omega, eps)
        yield from of((sf.energy, sf.vector_field), body, omega)


def of(functions, *arguments):
    for function in functions:
        yield function.__name__, function(*arguments)


def attitude(body, omega, eps):
    states = sf.iterate(body, omega, eps, 40, on_singular="ignore").omega
    return sf.attitude(body, states, eps)


def run(body, omega, eps, steps, **options):
    result = sf.iterate(body, omega, eps, steps, on_singular="ignore", **options)
    return result.omega, result.final, result.status, result.failed_at


def all_hashes():
    found = {}
    for bodies, results in (
        (bodies_3d, results_3d), (bodies_nd, results_nd), (bodies_gyrostat, results_gyrostat)
    ):  # fmt: skip
        for name, body, eps in bodies():
            for what, *values in results(body, eps):
                digests = found.setdefault(f"{name}: {what}", hashlib.sha256())
                digests.update("".join(map(digest, values)).encode())
    return {name: each.hexdigest()[:16] for name, each in found.items()}


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    text = json.dumps(all_hashes(), indent=1) + "\n"
    if "--write" in sys.argv:
        KEPT.write_text(text, encoding="utf-8")
    else:
        print(text, end="")
