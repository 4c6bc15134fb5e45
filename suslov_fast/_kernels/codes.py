"""Statuses of trajectories written by kernels."""

OK, SUPERCRITICAL, SINGULAR, NONFINITE = 0, 1, -1, -2

# Internal: the initial status, and that of a trajectory whose next step needs elimination.
NOT_COMPUTED, NEEDS_ELIMINATION = -128, -127
