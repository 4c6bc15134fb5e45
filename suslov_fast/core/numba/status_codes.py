"""Statuses of trajectories: negative after a failure, positive if they finish with a caveat."""

OK = 0
SUPERCRITICAL = 1  # finished; |criticality| >= 1: the step is too long to follow the motion
PASSED_POLE = 2  # finished; a step passed a pole: det A < 0, or it changed a sign that motions keep
SINGULAR = -1  # there is no next state, because the state is on a pole
NONFINITE = -2  # the next state is out of the range of float64, or state 0 is NaN
# Along a motion:
ENDED = -3  # the solution ends: a pole or an escape
SLIDING = -4  # the solution slides along a surface at which f switches
TOO_MANY_STEPS = -5  # the motion takes too many steps from one time to the next
ACCUMULATES = -6  # events accumulate: actions follow one another without end
STOPPED = 3  # finished; an event ended the motion
NOT_KEPT = 5  # finished; steps changed a first integral that they should keep
# Of equilibria:
DEGENERATE = 4  # found, but f' is singular, as at a fold
NOT_FOUND = -7

# In integers `signs` of up to 8 lanes, bits below bit CHANGED mark lanes with det A < 0. Bits from
# bit CHANGED on mark lanes in which a component changed its sign.
CHANGED = 8
