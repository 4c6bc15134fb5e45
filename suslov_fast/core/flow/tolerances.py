"""Numbers that decide about steps of a motion: tolerances, limits and factors that were measured.

t is the time, h the length of a step, and s = 0 a surface. Numbers of mathematics, such as weights
of the columns (`weights`), stand beside their formulas.
"""

# ------------------------------------------------------------------------------ allowed_errors
# By default errors up to this part of the largest component are allowed; of columns of derivatives
# up to the second one.
LEAST_SIZE, LEAST_SIZE_OF_COLUMNS = 2.0**-60, 2.0**-20
ROUNDING_OF_ENDS = 2.0**-52  # rounding of the sum over columns, as a part of its terms
# Errors up to ROUNDING_OF_CLOCKS times the change of clocks are allowed: 1 - cos(t) is rounding at
# small t.
ROUNDING_OF_CLOCKS = 2.0**-50
# The largest floors of allowed errors, relative to the largest value so far (`floors_of`): of
# explicit steps, and of components that keep their sign. Larger floors make relaxation oscillations
# jump at wrong times, because these times depend on components at 1e-4 to 1e-2 of their largest
# values. With smaller floors a pendulum takes more steps at an equal error of 1e-3. Of 2,337
# populations and oscillations at rtol = 1e-4, 21 are wrong unnoticed; with 1e-4 in place of 3e-5 27
# are, and with 1e-6 20 are.
FLOOR_OF_EXPLICIT, FLOOR_OF_ONE_SIGN = 3e-5, 1e-6
FLOOR_OF_IMPLICIT = 1e-4  # times the square root of rtol
# Below RTOL_OF_9 implicit steps have this times rtol, because the Oregonator jumps when components
# have decayed to 1e-3 of their largest values: its states at 120 times have errors of up to 44 rtol
# in the median of 23 rtol, at most 269 (explicit steps between jumps allow rtol); with 2**-5 up to
# 1,959. 29 stiff problems take 1.02 to 1.04 of the steps with 2**-5; 2**-12 takes up to 1.14.
FLOOR_OF_CLOSE_IMPLICIT = 2.0**-10
NOISE_OF_STEP = 2.0**-48  # an error may be noise if it is less than this of the largest component

# -------------------------------------------------------------------------------- batch_solver
# A step waits for results more than it computes. So if a register holds WIDTH lanes, lanes in two
# of them, or in four if f calls functions, take .75 to .9 of the time: with so few rows of the
# workspace that it stays in the fastest cache, and so many trajectories for each lane. LLVM takes
# .03 to .1 s more. So WIDTH lanes come first, until batches have spent so many budgets, in .1 to
# .6 s: about as long as it takes to gain what LLVM costs.
MOST_ROWS_OF_WIDE, ROUNDS_OF_WIDE, SPENT_BEFORE_WIDE = 384, 4, 96.0
TRAJECTORIES_OF_THREAD = 1024  # trajectories that one thread takes at a time
WORK_WITHOUT_PAUSE = 2**18  # operations of f in all lanes, after which Python handles Ctrl-C
LEAST_RTOL = 1e-13
LONGEST_PART = 1 / 32  # of the whole time: the longest step if f has clocks or jumps

# -------------------------------------------------------------------------------- dense_output
# The largest error of the polynomial p is ERROR_OF_DEFECT times its defect at TEST_OF_POLYNOMIAL
# parts from the ends of the step, with n = 4, and with n = 5 within 2 percent. In the last part
# EXACT_END of a step p is accurate. A part of the step may have an error of ERROR_OF_NODES allowed
# errors; it is estimated from that of the whole step with the same columns.
TEST_OF_POLYNOMIAL, ERROR_OF_DEFECT, EXACT_END, ERROR_OF_NODES = 0.2, 0.274, 2.0**-30, 0.125

# ------------------------------------------------------------------------------ events.actions
# A trajectory ends if an event acts again at once this often in a row, or if this many events act
# at one instant in addition to one on each surface.
ACTIONS_AT_ONCE, ACTIONS_AT_ONE_INSTANT = 4.0, 64.0
LOW_AFTER_ACTION = 2.0**-44  # a sum below this part of the sum of its moduli is rounding
# ds/dt decides no side if s changes only by rounding in SLOW_AT_SURFACE * last time.
SLOW_AT_SURFACE = 2.0**-20
# At a pole |s| grows by more than GROWTH_TO_POLE from the start to the end of a step, which is as
# near as ACCURACY_OF_CROSSING.
GROWTH_TO_POLE = 2.0**10
# If |s| is more than FAR_FROM_SURFACE times the sum of the moduli of its terms, s does not become 0
# at once, however large ds/dt is.
FAR_FROM_SURFACE = 2.0**-10
# ds/dt after events is compared with ds/dt a moment later: MOMENT times the last step, or if this
# step was cut to less than 1 / GROWTH_AFTER_SURFACE times the next one, of that length. After a
# step of 4e-15 the change of ds/dt was rounding, and a hop was not seen.
MOMENT = 2.0**-16
# The next step may be cut if an action makes f more than FASTER_AFTER_ACTION times as large.
FASTER_AFTER_ACTION = 4.0

# ------------------------------------------------------------------------ events.branch_choice
BACK_AND_FORTH = 12.0  # so many changes of branches in a row, each at once, count as sliding
# A change is at once if it follows another one within AT_ONCE times the largest of three: the time
# t, the length of the next step, and EARLY times the last requested time.
EARLY = 2.0**-12
# If a solution ends just before a surface at the time t, other branches are sought NEAREST_AHEAD
# * t to FARTHEST_AHEAD * t later. If branches were last changed within CHANGED_AGAIN * t, it counts
# to BACK_AND_FORTH.
NEAREST_AHEAD, FARTHEST_AHEAD, CHANGED_AGAIN = 2.0**-44, 2.0**-38, 2.0**-28

# ----------------------------------------------------------------------------- events.location
# Accuracy of a crossing: parts of t and of the last time.
ACCURACY_OF_CROSSING, ACCURACY_AT_0 = 2.0**-51, 2.0**-90
# Part of the last time: only longer steps are searched for double crossings.
HIDDEN_FROM = 2.0**-20
LEAST_CUT, MOST_CUT, MOST_WEIGHT = 2.0**-40, 1.0 - 2.0**-10, 2.0**60
ROUNDS_OF_SEARCH = 14.0
# The next surface may be as near as this one. So the step after a step to a surface is at most
# the longer of GROWTH_AFTER_SURFACE times that step and PART_AFTER_SURFACE times its own length
# without this limit. x" = -sign(x) to t = 1e5 takes 9 steps, also refused ones, from jump to jump;
# without a limit it takes 12. But a table of 6,000 random knots takes 1 % more time with 64, and
# 8 % with 8.
GROWTH_AFTER_SURFACE, PART_AFTER_SURFACE = 64.0, 2.0**-8
PART_OF_WAVE = 0.9  # next length, as a part of the longest that phases of sin and cos in s allow
BESIDE_POINT = 2.0**-12  # difference of two fractions u of a step, whose states give dx/du
# Part of a step: a crossing within it may be the surface on which the step begins.
BEGINS_ON = 2.0**-8

# --------------------------------------------------------------------------------------- gragg
# Operations of f, plus three for each component, up to which all sub-steps are unrolled: that
# saves branches, but longer code would not fit the instruction cache.
MOST_UNROLLED = 25

# -------------------------------------------------------------------------- growing_components
# Two computations may end at one pole if their end times have at most this ratio.
SAME_END = 1.001
# The least exponents a h of growth exp(a h) in a step of length h that count. GROWTH_OF_IMPLICIT:
# the next step may be four times as long. GROWTH_OF_EXPLICIT: at this exponent explicit steps of
# order 10 lose (a h / 8)**10 = 1e-6 of the growth. `Rule.loses` has the numbers of other orders.
GROWTH_OF_IMPLICIT, GROWTH_OF_EXPLICIT = 0.25, 2.0
# In each round, trial values u_i of components that do not grow are multiplied by LESS_OF_TRIAL, in
# the second half of the ROUNDS_OF_TRIAL by LITTLE_LESS_OF_TRIAL, to stop near values with which all
# components grow.
LESS_OF_TRIAL, LITTLE_LESS_OF_TRIAL, ROUNDS_OF_TRIAL = 0.25, 0.75, 24.0
# Measured on 1,558 problems with rtol 1e-4, 1e-6 and 1e-9. An error of ALARMING rtol**(-1/3)
# allowed errors is alarming; LOOKED_AT of it is a reason to evaluate f. A component is small below
# SMALL_COMPONENT of its largest value. Errors of a component that may change its sign count
# LOOSE_SIGN times less, because errors are large where it passes 0: with LOOSE_SIGN = 1, 58 of 256
# orbits of Van der Pol's equation (mu = 1000) are computed again in vain at 1e-4, and nearly all of
# Lorenz's at 1e-6.
ALARMING, LOOKED_AT, SMALL_COMPONENT, LOOSE_SIGN = 0.25, 0.1, 0.1, 2.5
# Factors of the least error that costs digits, see `growing_components.some_of`.
COSTS_DIGITS, COSTS_IN_IMPLICIT = 1.6e-3, 0.125
# With a relative error above this, and above WITHOUT_DIGITS_OF_RTOL times rtol, a component of one
# sign has no digits.
WITHOUT_DIGITS, WITHOUT_DIGITS_OF_RTOL = 5e-4, 100.0
UNDERFLOW = 2.0**-990

# --------------------------------------------------------------------------- linearly_implicit
SMALLEST_SCALE = 2.0**-60
# Factor of errors found with f' of a step's end: they are too small, as f' still decreases there.
# In 300 layers of friction at rtol 1e-4, 17 solutions stick too long with 1, 3 with 16.
ERRORS_OF_END = 16.0

# ------------------------------------------------------------------------------ scalar_kernels
# Parts of the time t: events that are closer than AT_ONCE count as simultaneous; an event less than
# NEARLY after a requested time is at it; a solution that ends less than EDGE before a surface is on
# it.
AT_ONCE, NEARLY, EDGE = 2.0**-36, 2.0**-42, 2.0**-38

# -------------------------------------------------------------------------------- second_trial
BESIDE_SIZE = 2.0**-48  # half of it is the largest relative displacement of a state
# The trial allows `Rule.grows` times a change of h f at an end of the step, or NOISE_OF_TRIAL times
# one at any point: weights of columns enlarge noise of f, implicit ones 16 times as much.
NOISE_OF_TRIAL = 8.0
# An error above this part of the allowed error may make the next step shorter.
SHORTENS = 0.05
# Part of the time: in a step up to this length, sub-steps are mostly rounding.
STEP_OF_ROUNDING = 2.0**-40

# ------------------------------------------------------------------------------- small_batches
STATES_IN_MEMORY = 4096  # the most numbers in requested states for which memory is kept

# --------------------------------------------------------------------------------- step_length
# Factors from a length to the next: SAFETY ratio**(-1 / power), at least LEAST_FACTOR, at most
# MOST_FACTOR, FACTOR_AT_FIRST, FACTOR_AFTER_REFUSED, or FACTOR_AFTER_TRIAL, which also marks a step
# after a second trial. FACTOR_OF_NAN is the factor if f has no value, or a sign is lost; with many
# digits no step meets a time twice.
SAFETY, LEAST_FACTOR, MOST_FACTOR, FACTOR_AT_FIRST = 0.75, 0.2, 4.0, 10.0
FACTOR_AFTER_REFUSED, FACTOR_AFTER_TRIAL, FACTOR_OF_NAN = 1.0, 3.875, 0.2371
# Without prediction 20 % of the steps in Kepler's problem with rtol 1e-6 are refused, with it 9 %.
# In 19 problems f is evaluated .84 to 1.05 times as often at equal errors; with STEADY_TREND = 1 up
# to 1.07 times. The prediction makes no length less than LEAST_PREDICTED times as long.
STEADY_TREND, LEAST_PREDICTED = 1.15, 0.5
FACTOR_OF_REFUSED = 0.9  # a refused step becomes shorter at least by this factor
# If the next step would take this part of the time that is left, it takes all of it.
REACH_OF_STEP = 0.92
# The shortest step, as a part of the time; a shorter step ends the solution.
SHORTEST_STEP = 2.0**-44
# A step is false if the sum that shows it is above MOST_APART allowed errors: 30 would refuse some
# true steps, 100 would accept more false ones. FACTOR_OF_FALSE is the factor to the next, shorter,
# length.
MOST_APART, FACTOR_OF_FALSE = 50.0, 0.5
# The first step, relative to rtol**(1 / (order - 2)) |x| / |f|, and to the last time; at rest.
FIRST_CHANGE, FIRST_OF_TIME, FIRST_AT_REST = 5.0, 2.0**-40, 1e-6
PROBE_OF_BEND = 2.0**-7  # part of |x| / |f|: f there, beside f at the start, shows |f' f|
# A trajectory ends if MOST_TRIES tries, actions and records move it on by less than LEAST_ADVANCE
# of the last time.
MOST_TRIES, LEAST_ADVANCE = 250_000, 1e-3
# The h |mu| above which a step looks stiff: this times rtol**(1 / (order - 2)), within two limits.
# Gragg's rule is stable up to about 6.
LIMIT_OF_ROOT, LEAST_LIMIT, MOST_LIMIT = 17.0, 1.4, 4.8
# An implicit step is easy if h |mu| is below this times the limit; in a trial, below the second.
EASY_LIMIT, EASY_IN_TRIAL = 2.0, 0.6
# A lane becomes implicit after STIFF_STEPS steps that look stiff; STEPS_TO_FORGET other steps clear
# this count. It becomes explicit after EASY_STEPS steps that explicit ones could do as well; if
# this happens within less than TRIAL_STEPS implicit steps, its patience becomes MORE_PATIENCE times
# as large, at most MOST_STIFF_STEPS.
STIFF_STEPS, STEPS_TO_FORGET, TRIAL_STEPS = 5.0, 6.0, 8.0
EASY_STEPS, MORE_PATIENCE, MOST_STIFF_STEPS = 3.0, 4.0, 100.0
# A false step counts as COUNT_OF_FALSE steps that look stiff. An accepted step with `apart` above
# APART_OF_BOUNCE counts as COUNT_OF_BOUNCE: it may bounce between both sides of a layer, where f
# looks flat.
COUNT_OF_FALSE, COUNT_OF_BOUNCE, APART_OF_BOUNCE = 2.0, 0.25, 10.0

# ------------------------------------------------------------------------------------- stormer
CAUTION_OF_STORMER = 4.0  # factor of the error estimate

# ---------------------------------------------------------------------------- vector_functions
MOST_INLINED = 160  # operations of an f that is written into the loop of sub-steps, not called
# The most operations of an elimination in straight-line code: LLVM takes 20 us for each, 80 with
# optimization. Longer eliminations are loops over arrays: steps take 2 to 4 times as long.
MOST_IN_LINE = 20_000

# ------------------------------------------------------------------------------------- weights
# The largest rtol with order 12; implicit steps have order 9, or 11, if rtol is smaller than these.
RTOL_OF_12, RTOL_OF_9, RTOL_OF_11 = 1e-10, 5e-10, 2e-12
