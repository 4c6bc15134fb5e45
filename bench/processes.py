"""Times of whole processes: imports, calls with an empty cache, calls with cached kernels."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import suslov_fast

BODY_3D = "s.Suslov3D(4, 1, -0.5, -0.3)"
BODY_ND = "s.SuslovND(np.linspace(1, 2, 9), np.linspace(-0.3, 0.4, 9))"
IMPORT = "import numpy as np, suslov_fast as s; "
# Label, code, and the allowed time in multiples of `import numba`.
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
    """Run code in a process with the package of a folder; return the elapsed seconds."""
    environment = os.environ | {"PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": ""}
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)
    return time.perf_counter() - begin


def cases():
    """Yield cases of processes with cached kernels and with an empty cache."""
    from work import Case, Work

    tree = Path(suslov_fast.__path__[0]).parent

    def of(code, fresh=False):
        def call():
            with tempfile.TemporaryDirectory() as folder:
                run(code, tree, folder if fresh else None)

        # As a test, one trivial process is enough.
        return lambda size, threads: Work(
            call if size(1, 0) else lambda: run("pass", tree, None), 1
        )

    for key, (label, code, _) in IMPORTS.items():
        whose = "this package" if "suslov_fast" in code else "others"
        yield Case("processes", key, label, of(code), whose=whose, threads="one")
    for key, (label, call) in CALLS.items():
        code = IMPORT + call
        again, first = f"{label}, compiled before", f"{label}, nothing compiled"
        yield Case("processes", f"{key}-again", again, of(code), threads="one")
        yield Case("processes", f"{key}-first", first, of(code, True), threads="one", once=True)
