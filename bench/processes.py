"""Times of whole processes: imports, calls with an empty cache, calls with cached kernels."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from work import Case, Work

import suslov_fast

TREE = Path(suslov_fast.__path__[0]).parent
IMPORT = "import numpy as np, suslov_fast as s; "
BODY_3D = "s.Suslov3D(4, 1, -0.5, -0.3)"
BODY_ND = "s.SuslovND(np.linspace(1, 2, 9), np.linspace(-0.3, 0.4, 9))"
IMPORTS = {
    "python": ("Python alone", "pass"),
    "import-numba": ("`import numba`", "import numba"),
    "import": ("`import suslov_fast`", "import suslov_fast"),
}
CALLS = {
    "iterate": (
        "`iterate` of 10,000 orbits",
        f"s.iterate({BODY_3D}, np.ones((10_000, 2)), .2, 200)",
    ),
    "iterate-nd": ("`iterate`, 9 components", f"s.iterate({BODY_ND}, np.ones((100, 9)), .1, 20)"),
    "exact": ("`exact` of one state", f"s.exact({BODY_3D}, [1.0, 0.5], 0.2, 25)"),
}


def process(code, fresh=False):
    """A process with this package, and with an empty cache of kernels if `fresh`."""

    def make(size, threads):
        chosen = code if size(1, 0) else "pass"  # as a test, a trivial process is enough

        def call():
            with tempfile.TemporaryDirectory() as folder:
                settings = {"PYTHONPATH": str(TREE), "PYTHONDONTWRITEBYTECODE": ""}
                settings |= {"NUMBA_CACHE_DIR": folder} if fresh else {}
                environment = os.environ | settings
                subprocess.run([sys.executable, "-c", chosen], env=environment, check=True)

        return Work(call, 1)

    return make


def cases():
    """Yield cases of processes with cached kernels and with an empty cache."""
    for key, (label, call) in CALLS.items():
        again, first = f"{label}, compiled before", f"{label}, nothing compiled"
        yield Case("processes", f"{key}-again", again, process(IMPORT + call), threads="one")
        make = process(IMPORT + call, fresh=True)
        yield Case("processes", f"{key}-first", first, make, threads="one", once=True)
    for key, (label, code) in IMPORTS.items():
        whose = "this package" if "suslov_fast" in code else "others"
        yield Case("processes", key, label, process(code), whose=whose, threads="one")
