"""How a trajectory ends, as kernels write it."""

OK, SUPERCRITICAL, SINGULAR, NONFINITE = 0, 1, -1, -2
# The status of a trajectory that no kernel has reached yet.
NOT_COMPUTED = -128
