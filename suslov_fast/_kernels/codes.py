"""How a trajectory ends, as kernels write it."""

OK, SUPERCRITICAL, SINGULAR, NONFINITE = 0, 1, -1, -2
