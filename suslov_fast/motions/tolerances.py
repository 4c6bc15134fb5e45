"""Numbers that decide about motions and their orbits: tolerances, limits and measured factors."""

# --------------------------------------------------------------------------- actions_on_constraints
# The least part of the change of ds/dt at a bounce that reactions may leave; below it a bounce is
# none, because constraints hold the body on the surface.
LEAST_BOUNCE = 2.0**-20
# Newton's steps to constraints that are not linear in velocities.
NEWTON_STEPS_TO_CONSTRAINTS_OF_ACTIONS = 6
SAMPLES_OF_ACTION = 16  # random states that tell bounces from other actions

# -------------------------------------------------------------------------------- equations_at_rest
# The most Newton steps, and the most damped Newton steps.
MOST_NEWTON_STEPS, MOST_DAMPED_STEPS = 30, 60
# The largest ratio of a step to the step before; above it Newton's method ends.
SHRINKING_OF_STEPS = 0.25
LONGEST_NEWTON_STEP = 2.0  # the largest ratio of a step to the state; above it Newton's method ends
# Steps of Newton's method, divided by the state. A step below LAST_NEWTON_STEP is the last one; so
# is a step that does not shrink by the factor SHRINKING_OF_STEPS after a step below
# SHORT_NEWTON_STEP.
LAST_NEWTON_STEP, SHORT_NEWTON_STEP = 1e-14, 1e-8
# `sizes` in `EquationsAtRest` are at least this part of the largest component.
LEAST_SIZE_OF_COMPONENT = 1e-6
ZERO_OF_RANK = 1e-12  # singular values up to this part of the largest one count as 0
# f' is singular up to this ratio of its smallest to its largest singular value.
SINGULAR_SLOPES = 1e-8
# Newton's method leads back to a regular equilibrium from this relative displacement.
DISPLACEMENT_OF_PROBE = 1e-6
# The steps to a member of a family: their number, the displacement from a member, relative, from
# which they lead back, and the largest residual at their end, in units of the states.
MOST_STEPS_TO_FAMILY, DISPLACEMENT_FROM_FAMILY, RESIDUAL_ON_FAMILY = 12, 2.0**-10, 2.0**-46
# Singular values of a projection are 0 or 1, up to the curvature of the family.
ZERO_OF_PROJECTION = 2.0**-5
ZERO_AT_MULTIPLE_ROOT = 1e-15  # largest |f| at a multiple root, divided by `EquationsAtRest.terms`

# --------------------------------------------------------------------------------------- equilibria
# The most starts for which the text of the result counts different states.
MOST_STARTS_COUNTED = 10_000
NEUTRAL_RATE = 2.0**-48  # rates of growth up to this part of the largest entry of f' count as 0
# The same where f' is singular: double eigenvalues 0 have half of the digits.
NEUTRAL_RATE_IF_SINGULAR = 2.0**-20

# ------------------------------------------------------------------------------------------- events
# `starts_at_rest` evaluates a surface function s before and after x0, at DISTANCE_FROM_START times
# the size of x0 from it. x0 rests (ds/dt = 0) if both values differ by at most CHANGE_AT_REST times
# their size.
DISTANCE_FROM_START, CHANGE_AT_REST = 2.0**-16, 2.0**-8

# --------------------------------------------------------------------------------------------- flow
FEW_MOTIONS = 64  # up to so many motions share arrays of the same values from call to call

# -------------------------------------------------------------------------------------- integration
# Up to so many trajectories share one thread, unless the user passes `threads`.
TRAJECTORIES_OF_ONE_THREAD = 64
# With more operations of f, which take over 3 s to compile, a warning says so.
OPERATIONS_OF_LONG_F = 30_000
# With more equations and a dense f', LSODA is faster: measured on rate networks.
EQUATIONS_OF_LARGE_F = 50
# Numbers in the states of a batch up to which memory is kept for the next call.
NUMBERS_OF_SMALL_BATCH = 4096

# --------------------------------------------------------------------------------- motion_arguments
LARGEST_RTOL = 1e-2  # the largest rtol
FEW_TIMES = 64  # the most times of which Python finds the largest faster than NumPy

# ---------------------------------------------------------------------------------- periodic_orbits
# A state at rest changes in a period by at most this part of its size.
CHANGE_OF_STATE_AT_REST = 1e-6
# A multiplier with a modulus this near to 1 does not decide about stability.
NEUTRAL_MULTIPLIER = 1e-6
MOST_TURNS = 12  # the most turns of an orbit that are recognized in a period
FARTHEST_RETURN = 2.0**-4  # the largest distance, in ranges of components, of a return after a turn
# Starts of equal turns differ by at most this part of the range of each component.
DISTANCE_OF_EQUAL_TURNS = 1e-6
# If the orbit is further from x0, in ranges of its components, a warning says so.
DISTANCE_FROM_X0 = 0.5
LEAST_RTOL_OF_SEARCH = 1e-8  # the least rtol of the motion that is searched for a near return to x0

# ----------------------------------------------------------------------------------------- shooting
MOST_ROUNDS_OF_NEWTON = 60  # the most steps of Newton's method
MOST_HALVINGS = 10  # the most halvings of a step
# In Newton's equations, directions with singular values below this part of the largest one, or
# below the residual, count as directions along a family of orbits.
ZERO_OF_NEWTON = 1e-8
LONGEST_STEP_OF_PERIOD = 0.3  # the longest step of log T
MOST_CORRECTIONS_OF_PERIOD = 5  # the most corrections of T alone, before Newton's steps
LEAST_CORRECTION_OF_PERIOD = 1e-6  # the smallest relative correction of T
GROWTH_OF_ARC = 1e3  # growth of derivatives along an arc, above which more arcs are tried
# The allowed residual is NOISE_OF_RESIDUAL * rtol times the growth of derivatives along an arc, but
# at most LARGEST_RESIDUAL, or NOISE_OF_RESIDUAL * rtol if that is larger.
NOISE_OF_RESIDUAL, LARGEST_RESIDUAL = 10.0, 1e-9
LEAST_UNIT = 2.0**-20  # least unit of components and residuals, as a part of the largest range
# Relative rounding error of T, which matters where states change fast.
ROUNDING_OF_PERIOD = 2.0**-49
# The longest way, in ranges of components, of steps from arcs that close.
FARTHEST_FROM_CLOSED_ARCS = 2.0**-4
WEIGHT_OF_PHASE = 1e3  # weight of the equation that keeps the phase, see `keeps_phase`
STATES_OF_ORBIT = 512  # number of states from which ranges of components and returns are found
# f has the period T if motions that start T apart differ by at most this, relatively.
CHANGE_OF_PERIODIC_FORCE = 1e-6
# The longest time until a near return, in units of |x / f(x)|. The first search ends at this time
# divided by 2**DOUBLINGS_OF_SEARCH, each further search at twice the time of the one before.
LONGEST_SEARCH, DOUBLINGS_OF_SEARCH = 2.0**16, 28
# Distances from the start, in units of the extent of the orbit: the largest at which a return is
# refined, the largest of a near return, and the least after which the motion has left the start.
FARTHEST_REFINED_RETURN, NEAR_RETURN, LEFT_START = 1.0, 0.1, 0.5
# The search for a nearer return ends at this multiple of the time of the first one.
LATEST_NEARER_RETURN = 4.0

# ----------------------------------------------------------------------------------------- tangents
HALVINGS_OF_SEGMENTS = 40  # m of the shortest segment, which has 2**-m of the time
# The largest product of the length of the first segment and the size of f'.
LONGEST_FIRST_SEGMENT = 8.0
# A segment is short enough if the diagonal of R is below LARGEST_DIAGONAL, above LEAST_DIAGONAL,
# and above LEAST_DIAGONAL times its largest entry, because allowed errors are relative to the
# longest tangent vectors.
LEAST_DIAGONAL, LARGEST_DIAGONAL = 2.0**-10, 2.0**300
# Each column at time 0: a slow direction plus this part of all directions.
PART_OF_ALL_DIRECTIONS = 2.0**-6
POWERS_OF_SLOPES = 8  # how often f' is applied to columns to find these directions
# Smaller rates of growth, as parts of the largest entry of f', count as none.
LEAST_GROWTH = 2.0**-10
# After the shortest segment, a diagonal entry of R has no digits if it is at most DEAD_DIAGONAL
# times the largest one, or DIAGONAL_WITHOUT_DIGITS: what rounding may leave of a column of length 1
# that an event makes 0.
DEAD_DIAGONAL, DIAGONAL_WITHOUT_DIGITS = 2.0**-40, 2.0**-48
PARTS_OF_PROGRESS = 1000  # `progress` counts so many equal parts of the time
# If FEW_SEGMENTS segments end before PART_OF_FEW_SEGMENTS of the time, an orthonormal frame V of up
# to LARGEST_FRAME columns replaces the tangent vectors. Segments then end before V^T V - 1 exceeds
# SKEWNESS_OF_FRAME times rtol, and before the tangent space of constraints has turned by an angle
# with the tangent TURN_OF_TANGENT_SPACE.
FEW_SEGMENTS = 64
PART_OF_FEW_SEGMENTS = 2.0**-5
LARGEST_FRAME = 12
SKEWNESS_OF_FRAME = 32.0
TURN_OF_TANGENT_SPACE = 1.0
