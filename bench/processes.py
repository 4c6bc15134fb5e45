"""Processes from their start to their end: imports, the first use ever, a second process."""

import os
import subprocess
import sys
import time

BODY_3D = "s.Suslov3D(4, 1, -0.5, -0.3)"
BODY_ND = "s.SuslovND(np.linspace(1, 2, 9), np.linspace(-0.3, 0.4, 9))"
IMPORT = "import numpy as np, suslov_fast as s; "
# What to say of it, and how many times `import numba` it may take.
IMPORTS = {
    "python": ("Python alone", "pass", None),
    "import-numba": ("`import numba`", "import numba", None),
    "import": ("`import suslov_fast`", "import suslov_fast", 1.4),
}
CALLS = {
    "iterate": (
        "`iterate` of 10,000 orbits",
        f"s.iterate({BODY_3D}, np.ones((10_000, 2)), .2, 200)",
    ),
    "iterate-nd": ("`iterate`, 9 components", f"s.iterate({BODY_ND}, np.ones((100, 9)), .1, 20)"),
    "exact": ("`exact` of one state", f"s.exact({BODY_3D}, [1.0, 0.5], 0.2, 25)"),
}
FIRST, SECOND = 20, 2.2


def run(code, tree, cache):
    """Run code in a process with the package of that folder; return the seconds it took."""
    environment = os.environ | {"PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": ""}
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)
    return time.perf_counter() - begin
