"""Statuses of trajectories, as kernels write them."""

OK, SUPERCRITICAL, SINGULAR, NONFINITE = 0, 1, -1, -2

# Internal: the status before a kernel writes it, and that of a trajectory whose next step takes an
# elimination.
NOT_COMPUTED, NEEDS_ELIMINATION = -128, -127
