"""Run the suite as on other machines, in another order, and each file by itself.

`python tests/machines.py` runs all, `python tests/machines.py haswell one-thread -k steps` two of
them, with options of pytest. Processors differ in the last digits of NumPy, LAPACK and libm, and in
what Numba compiles for. Needs Linux and pytest-random-order.

OpenBLAS runs only kernels that this processor has, so "other-digits" changes the last digits of
what LAPACK returns, on any processor. Of OpenBLAS's kernels SkylakeX's alone, which need AVX-512,
have other last digits than the rest. Numba compiles for the instructions of this processor, unless
NUMBA_CPU_FEATURES says otherwise; the number of lanes follows from them. Each run begins with a
line of what it found: Numba's processor and lanes, NumPy's instructions, OpenBLAS's kernels.
"""

import ctypes
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
OF_AVX2 = {"NPY_DISABLE_CPU_FEATURES": NO_AVX512, "NUMBA_CPU_FEATURES": AVX2}
SKYLAKE = {"OPENBLAS_CORETYPE": "SkylakeX", "OPENBLAS_L2_SIZE": "1024"}
# The variables of the environment.
MACHINES = {
    "numpy-avx2": {"NPY_DISABLE_CPU_FEATURES": NO_AVX512},
    "numpy-sse": {"NPY_DISABLE_CPU_FEATURES": f"X86_V3,{NO_AVX512}"},
    "blas-nehalem": {"OPENBLAS_CORETYPE": "Nehalem"},
    "blas-haswell": {"OPENBLAS_CORETYPE": "Haswell"},
    "blas-skylake": SKYLAKE,
    "libm-sse": {"GLIBC_TUNABLES": NO_FMA},
    "generic": {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""},
    "haswell": {"OPENBLAS_CORETYPE": "Haswell", "NUMBA_CPU_NAME": "haswell", **OF_AVX2},
    "znver3": {"OPENBLAS_CORETYPE": "Zen", "NUMBA_CPU_NAME": "znver3", **OF_AVX2},
    "skylake": {
        "NUMBA_CPU_NAME": "skylake-avx512",
        "NUMBA_CPU_FEATURES": features("amx", "avx10"),
        **SKYLAKE,
    },
    "no-fma": {
        "OPENBLAS_CORETYPE": "Sandybridge",
        "NUMBA_CPU_NAME": "sandybridge",
        "NUMBA_CPU_FEATURES": features("fma", "avx2", "avx512", "avx10", "amx", "evex512", "bmi"),
        "NPY_DISABLE_CPU_FEATURES": f"X86_V3,{NO_AVX512}",
    },
    "one-thread": {"NUMBA_NUM_THREADS": "1"},
    "kathmandu": {"PYTHONHASHSEED": "12345", "TZ": "Asia/Kathmandu", "LC_ALL": "C"},
    "avx2-haswell": {"NPY_DISABLE_CPU_FEATURES": NO_AVX512, "OPENBLAS_CORETYPE": "Haswell"},
    "sse-generic": {
        "GLIBC_TUNABLES": NO_FMA,
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CPU_FEATURES": "",
    },
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


def facts():
    """Return what this process finds: Numba's processor, NumPy's instructions, OpenBLAS's name."""
    import numpy as np
    from numba.core.registry import cpu_target
    from numpy._core._multiarray_umath import __cpu_features__ as found

    from suslov_fast.core.llvm.compiler import numbers_in_register

    codegen = cpu_target.target_context.codegen()
    processor = f"Numba {codegen._get_host_cpu_name()}, {numbers_in_register()} lanes"
    levels = [name for name in ("X86_V2", "X86_V3", "X86_V4", "AVX512_ICL") if found.get(name)]
    kernels = "unknown"
    for path in Path(np.__file__).parents[1].glob("numpy.libs/*openblas*"):
        name = ctypes.CDLL(str(path)).scipy_openblas_get_corename64_
        name.restype = ctypes.c_char_p
        kernels = name().decode()
    return f"{processor}; NumPy {' '.join(levels) or 'baseline'}; OpenBLAS {kernels}"


def main():
    """Run the machines that are named first, or all; return those that fail."""
    if sys.argv[1:] == ["facts"]:
        print(facts())
        return None
    names, options = [], sys.argv[1:]
    while options and options[0] in WAYS:
        names.append(options.pop(0))
    if options and not options[0].startswith("-"):
        return f"no machine {options[0]!r}: {', '.join(WAYS)}"
    if not names:
        names = [*WAYS]
        if not HERE.get("avx512f"):
            names = [name for name in names if "skylake" not in name]  # it lacks the instructions
    failed = {}
    for name in names:
        print(f"==== {name}", flush=True)
        environment = os.environ | MACHINES.get(name, {})
        subprocess.run([sys.executable, __file__, "facts"], env=environment, check=False)
        for command in WAYS[name]:
            if subprocess.run([*command, *options], env=environment, check=False).returncode:
                failed[name] = True
    return f"failed: {', '.join(failed)}" if failed else None


if __name__ == "__main__":
    sys.exit(main())
