"""Lifted fields have the same bits where Numba computes loops with Intel's vector library.

Its exp and sin differ from those of the C library in the last place. Not every llvmlite can use it:
wheels of 0.44 do, those of 0.50 do not. pip installs it, as `intel-cmplr-lib-rt`, in a folder that
the loader does not search.
"""

import os
import sys
from pathlib import Path

import children
import pytest
from llvmlite import binding

CODE = """
import hashlib, math, numba, numpy as np
from numba import njit
from suslov_fast import flow, iterate, jacobian
from test_lifted import FIELDS, field_of

@njit
def sines(x, out):
    for i in range(len(x)):
        out[i] = math.sin(x[i])

found, x, out = hashlib.sha256(), np.linspace(-5, 5, 4096), np.empty(4096)
sines(x, out)
print(numba.config.USING_SVML, out.tolist() != [math.sin(number) for number in x])
for name in ("arrhenius", "hyperbolic", "logarithm", "tangent", "roots", "powers", "pendulum"):
    field, start = field_of(name), np.array(FIELDS[name][1])
    starts, eps = start + np.arange(8)[:, np.newaxis] / 64, 1 / 32
    whole = None
    for W in (8, 4, 2, 1):  # batches of these sizes are lines of as many lanes
        results = (
            *(iterate(field, starts[:W], eps, 20, method=m, save_every=None).final
              for m in ("auto", "order8", "extrapolated")),
            flow(field, starts[:W], 1.0, rtol=1e-10),
            jacobian(field, starts[:W], eps),
        )
        whole = whole or results
        for a, b in zip(results, whole):
            assert np.isfinite(a).all()
            np.testing.assert_array_equal(a, b[:W])
            found.update(a.tobytes())
print(found.hexdigest())
"""


@pytest.mark.compiled
def test_lifted_fields(tmp_path):
    if not binding.targets.has_svml():
        pytest.skip("this llvmlite cannot use the library")
    folder = Path(sys.prefix) / "lib"
    if not (folder / "libsvml.so").exists():
        pytest.skip("Intel's vector library is not installed")
    settings = {"LD_LIBRARY_PATH": os.pathsep.join([str(folder), os.getenv("LD_LIBRARY_PATH", "")])}
    # A cache does not tell code that was compiled with the library from other code.
    with_it, without = (
        children.run(CODE, timeout=1800, NUMBA_CACHE_DIR=str(tmp_path / disabled), **settings,
                     NUMBA_DISABLE_INTEL_SVML=disabled).splitlines()
        for disabled in "01"
    )  # fmt: skip
    assert with_it[0] == "True True"  # Numba uses it, and a loop shows it
    assert without[0] == "False False"
    assert with_it[1] == without[1]
