"""How a trajectory ends, as loops write it."""

OK, SUPERCRITICAL, SINGULAR, NONFINITE = 0, 1, -1, -2

# What a status is before a loop has written it.
NOT_COMPUTED = -128
