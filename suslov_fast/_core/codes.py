"""How a trajectory ends, as loops write it."""

OK, SUPERCRITICAL, SINGULAR, NONFINITE = 0, 1, -1, -2

# Never seen outside: what a status is before a loop writes it, and that of a trajectory that a loop
# has left because the step needs an elimination that it has no room for.
NOT_COMPUTED, NEEDS_ELIMINATION = -128, -127
