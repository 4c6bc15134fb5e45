"""Run the benchmarks in a process of their own, once or several times."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from results import load, merge

BENCH = Path(__file__).parent
# Each test takes about 0.1 s: passes are short and follow each other, because a shared machine is
# slow for seconds at a time, and what is measured once may have been measured then.
SETTINGS = ("--benchmark-min-rounds=3", "--benchmark-max-time=0.1", "--benchmark-columns=min")


def run_pytest(target, tests, *options, env=None, **keywords):
    """Run benchmarks once; their JSON is written to `target`. Keywords are those of `run`."""
    command = [
        *(sys.executable, "-m", "pytest", *tests, "--benchmark-enable", "--benchmark-only"),
        *(*SETTINGS, f"--benchmark-json={target}", "--benchmark-quiet"),
        *("--rootdir", str(BENCH.parent), "-c", str(BENCH.parent / "pyproject.toml"), *options),
    ]
    # The peers that solve linear systems are measured on one thread, like the others beside them.
    threads = {"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    return subprocess.run(command, env=os.environ | threads | (env or {}), **keywords)


def measure(passes, select=None):
    """The results of several passes over all benchmarks; what takes long is in the first alone."""
    several = []
    chosen = ["-k", select] if select else []
    with tempfile.TemporaryDirectory() as folder:
        for k in range(passes):
            print(f"pass {k + 1} of {passes}", flush=True)
            target = Path(folder) / f"{k}.json"
            marked = ["-m", "not once"] if k else []
            run_pytest(target, [str(BENCH)], "-q", *chosen, *marked, check=True)
            several.append(load(target))
    return merge(several)
