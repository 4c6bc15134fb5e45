"""Run the suite as on other machines, in another order, and each file by itself.

`python tests/machines.py` runs all, `python tests/machines.py haswell one-thread -k steps` two of
them, with options of pytest. Processors differ in the last digits of NumPy, LAPACK and libm, and in
what Numba compiles for. Needs Linux and pytest-random-order.

OpenBLAS runs only kernels that this processor has, so "other-digits" changes the last digits of
what LAPACK returns, on any processor. Numba compiles for the instructions of this processor, unless
NUMBA_CPU_FEATURES says otherwise; the number of lanes follows from them.
"""

import os
import subprocess
import sys
from pathlib import Path

from llvmlite import binding

TESTS = Path(__file__).parent
ALONE = [sys.executable, "-m", "pytest"]
SUITE = [*ALONE, "-n", "2", "--dist", "loadfile"]
NO_AVX512 = "X86_V4,AVX512_ICL,AVX512_SPR"
NO_FMA = "glibc.cpu.hwcaps=-AVX2,-FMA"
HERE = binding.get_host_cpu_features()


def features(*without):
    """Return the features of this processor but those that begin with a word of `without`."""
    on = {name: found and not name.startswith(without) for name, found in HERE.items()}
    return ",".join(f"{'+' if found else '-'}{name}" for name, found in on.items())


AVX2 = features("avx512", "avx10", "amx", "evex512", "sse4a", "xop", "fma4")
# The variables of the environment.
MACHINES = {
    "numpy-avx2": {"NPY_DISABLE_CPU_FEATURES": NO_AVX512},
    "numpy-sse": {"NPY_DISABLE_CPU_FEATURES": f"X86_V3,{NO_AVX512}"},
    "blas-nehalem": {"OPENBLAS_CORETYPE": "Nehalem"},
    "blas-haswell": {"OPENBLAS_CORETYPE": "Haswell"},
    "libm-sse": {"GLIBC_TUNABLES": NO_FMA},
    "generic": {"NUMBA_CPU_NAME": "generic"},
    "haswell": {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": AVX2},
    "znver3": {
        "OPENBLAS_CORETYPE": "Zen",
        "NUMBA_CPU_NAME": "znver3",
        "NUMBA_CPU_FEATURES": AVX2,
    },
    "skylake": {
        "OPENBLAS_CORETYPE": "SkylakeX",
        "NUMBA_CPU_NAME": "skylake-avx512",
        "NUMBA_CPU_FEATURES": features("amx", "avx10"),
    },
    "no-fma": {"OPENBLAS_CORETYPE": "Sandybridge", "NUMBA_CPU_FEATURES": features("fma")},
    "one-thread": {"NUMBA_NUM_THREADS": "1"},
    "kathmandu": {"PYTHONHASHSEED": "12345", "TZ": "Asia/Kathmandu", "LC_ALL": "C"},
    "avx2-haswell": {"NPY_DISABLE_CPU_FEATURES": NO_AVX512, "OPENBLAS_CORETYPE": "Haswell"},
    "sse-generic": {"GLIBC_TUNABLES": NO_FMA, "NUMBA_CPU_NAME": "generic"},
    "one-nehalem": {"NUMBA_NUM_THREADS": "1", "OPENBLAS_CORETYPE": "Nehalem"},
}
# The commands. The head of the report has the seed: `--random-order-seed` repeats the order.
WAYS = {name: [SUITE] for name in MACHINES} | {
    "other-digits": [[*SUITE, "--last-digits", seed] for seed in "12"],
    "one-processor": [["taskset", "-c", "0", *ALONE]],
    "random-order": [[*ALONE, "--random-order-bucket=global"]],
    "each-file": [
        [*ALONE, "-q", path] for path in TESTS.rglob("test_*.py") if path.parent.name != "slow"
    ],
}


def main():
    """Run the machines that are named first, or all; return those that fail."""
    names, options = [], sys.argv[1:]
    while options and options[0] in WAYS:
        names.append(options.pop(0))
    if options and not options[0].startswith("-"):
        return f"no machine {options[0]!r}: {', '.join(WAYS)}"
    if not names:
        names = [*WAYS]
        if not HERE.get("avx512f"):
            names.remove("skylake")  # this processor lacks the instructions
    failed = {}
    for name in names:
        print(f"==== {name}", flush=True)
        environment = os.environ | MACHINES.get(name, {})
        for command in WAYS[name]:
            if subprocess.run([*command, *options], env=environment, check=False).returncode:
                failed[name] = True
    return f"failed: {', '.join(failed)}" if failed else None


if __name__ == "__main__":
    sys.exit(main())
