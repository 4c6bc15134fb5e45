"""How a trajectory ends, as loops write it."""

OK, SUPERCRITICAL, SINGULAR, NONFINITE = 0, 1, -1, -2
