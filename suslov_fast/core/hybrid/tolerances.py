"""Numbers that decide about hybrid systems: tolerances and limits of surfaces, rests and sliding.

s = 0 is a surface, and t the time.
"""

# ------------------------------------------------------------------------------------ contacts
# A body may rest if its next bounce would last less than SHORT_BOUNCE times the time t, or would be
# lower than LOW_BOUNCE times the moduli of the terms of s and of t ds/dt.
SHORT_BOUNCE, LOW_BOUNCE = 2.0**-35, 2.0**-42
# A rest ends if |s| is above END_OF_REST t**2 times the size of the terms of d2s/dt2.
END_OF_REST = 2.0**-16
# At rest errors of s decay as exp(-PULL_TO_REST t / T), where T is the last requested time.
PULL_TO_REST = 64.0

# ---------------------------------------------------------------------------- double_crossings
ROUNDING_BETWEEN_POINTS, MOST_HIDDEN = 2.0**-40, 1e4
# The error e of s is at least LEAST_OF_THIRD times the third divided difference, because the fourth
# may be 0 by chance.
LEAST_OF_THIRD = 2.0**-7
# A hump of s between two points is narrow if the straight line through the rates ds/du there misses
# the rate at a neighbouring point by over STRAIGHT times the difference of both. A rate counts as
# 0 up to ZERO_RATE_OF_TERMS times its terms, plus the change of s if x has relative errors
# ERROR_OF_POINTS + rtol, and errors of ROUNDING_OF_STEPS times their largest moduli: a solution at
# rest on several surfaces has components of 1e-17 that change by rounding alone.
STRAIGHT, ZERO_RATE_OF_TERMS, ERROR_OF_POINTS = 0.25, 2.0**-10, 2.0**-38
ROUNDING_OF_STEPS = 2.0**-48

# ------------------------------------------------------------------------------ event_formulas
# Errors of s, relative to its terms: by rounding in s, and by rounding of the state after a step.
ROUNDING_OF_SURFACE, NOISE_OF_SURFACE = 2.0**-50, 2.0**-47

# ------------------------------------------------------------------------------- explicit_time
LARGE_PHASE = 2.0**20  # whole turns are removed from larger phases

# ------------------------------------------------------------------------------------- sliding
# A state is on a surface s = 0 if |s| <= ON_SURFACE times the moduli of the terms of s.
ON_SURFACE = 2.0**-44
# Solutions may slide along all surfaces with |s| up to NEAR_SURFACE times the terms of s, or
# SHORT_BOUNCE times the time t times the terms of ds/dt.
NEAR_SURFACE = 2.0**-32
# ds/dt on one side of a surface counts as 0 up to ZERO_BESIDE times that on the other.
ZERO_BESIDE = 2.0**-24
# The most surfaces (also kinks) and contacts of one f; the most pairs (a, b), also a = b, where
# mode b changes the rate of mode a, times the number of modes. So 5 modes may change all rates, or
# 12 their own rates alone. The time to compile grows with this product.
MOST_MODES, MOST_PAIRS_OF_MODES = 24, 150

# ----------------------------------------------------------------------------- step_to_surface
SOONER = 2.0**-22  # factor of the time to s = 0 where rounding makes the sign of s uncertain
