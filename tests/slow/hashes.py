"""Hashes of results that must be identical on all types of CPU, compiled and interpreted.

    PYTHONPATH=tests python tests/slow/hashes.py            print the hashes
    PYTHONPATH=tests python tests/slow/hashes.py --write    store them in hashes.json

These are the functions and the hard problems of test_promises.py. Results of LAPACK are left out,
since their last bits depend on its build. The positions of NaN count, but not its sign and payload,
which differ between processors.
"""

import hashlib
import json
import sys
import warnings
from pathlib import Path

import numpy as np
from test_promises import HARD, ROUNDED, ROWS, run, sample

KEPT = Path(__file__).with_name("hashes.json")


def digest(values):
    found = hashlib.sha256()
    for array in map(np.array, values):
        if array.dtype.kind == "f":
            array[np.isnan(array)] = np.nan
        found.update(f"{array.shape} {array.dtype.str}".encode() + array.tobytes())
    return found.hexdigest()[:16]


def short(numbers):
    """Round to 24 bits: the last bits of powers and random numbers depend on the processor, too."""
    mantissa, exponent = np.frexp(numbers)
    return np.ldexp(np.round(np.ldexp(mantissa, 24)), exponent - 24) + 0.0  # no -0.0


def problem(body, omega, eps):
    values = {name: short(value) for name, value in body._values.items()}
    return type(body)(**values), short(omega), short(eps)


def all_hashes():
    found = {}
    for name, row in ROWS.items():
        for kind in row.kinds:
            if (name, kind) not in ROUNDED and name != "lyapunov_exponents":
                values = row.values(*problem(*sample(np.random.default_rng(1), kind)))
                found[f"{name}, {kind}"] = digest(values)
    for make, method, m in HARD:
        given = problem(*make(np.random.default_rng(1), 70, m))
        result = run(*given, 100, method=method)
        values = result.omega, result.final, result.status, result.failed_at
        found[f"{make.__name__}, {method}, {m}"] = digest(values)
    return found


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    text = json.dumps(all_hashes(), indent=1) + "\n"
    if "--write" in sys.argv:
        KEPT.write_text(text, encoding="utf-8")
    else:
        print(text, end="")
