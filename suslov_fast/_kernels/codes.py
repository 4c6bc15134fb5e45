"""Statuses of trajectories written by kernels."""

OK, SUPERCRITICAL, SINGULAR, NONFINITE = 0, 1, -1, -2

# Internal: the initial status, and those of a trajectory whose next step needs elimination, and of
# one that the closed form leaves.
NOT_COMPUTED, NEEDS_ELIMINATION, NEEDS_STEPS = -128, -127, -126
