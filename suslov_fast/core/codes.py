"""Statuses of trajectories: negative if one failed, positive if it finished with a caveat."""

OK = 0
SUPERCRITICAL = 1  # finished; T = e A >= 1 in modulus: the step is too long to follow the motion
PASSED_POLE = 2  # finished; a step was from a state with det A < 0
SINGULAR = -1  # the next state does not exist: the state lies on a pole
NONFINITE = -2  # the next state is beyond the range of float64, or state 0 is NaN
