"""Numbers that decide about expression programs: tolerances, limits, and costs that were measured.

Numbers of mathematics, such as coefficients of `elementary`, stand beside their formulas.
"""

TINY = 2.0**-1000  # the least divisor, length or size, in place of 0
SMALLEST = 2.0**-1074  # the smallest positive number: in a sum with 0 or more it changes 0 alone
# The most operations of a basic block in a long program: LLVM's time is quadratic in its length.
OPERATIONS_OF_BLOCK = 64

# ------------------------------------------------------------------------------- dense_product
# A product with a matrix is a loop, not a written sum, if at least LEAST_ENTRIES of its entries,
# and the part LEAST_FILL of all, are not 0.
LEAST_ENTRIES = 24 * 24
LEAST_FILL = 0.25

# -------------------------------------------------------------------------------- linear_terms
MOST_TERMS, MOST_FACTORS = 4096, 8  # the most terms and factors of a product that is expanded
# Rounding error of a coefficient, relative to the sum of the moduli of its parts.
ROUNDING_OF_COEFFICIENTS = 1e-14

# --------------------------------------------------------------------------------- partitioned
WORK_OF_FUNCTION = 40  # how many operations take the time of an elementary function

# ---------------------------------------------------------------------------------- projection
# A pivot of at most this part of its diagonal entry is 0.
ZERO_PIVOT = 2.0**-40
MOST_MOVE_TO_LEVELS = 64.0  # a longer move to levels of integrals, in allowed errors, is left out
# To constraints components move with weights w_j of at least LEAST_WEIGHT times the largest weight:
# the allowed error of a component that is 0 but for rounding is next to nothing. Such errors may
# move other components, in small oscillations by up to 1 / LEAST_WEIGHT**2 times their own size.
LEAST_WEIGHT = 2.0**-10
# States are on the constraints if residuals are at most OFF_CONSTRAINTS times the sums of moduli of
# their terms, or ROUNDING_OF_RESIDUALS times the largest of these sums.
OFF_CONSTRAINTS, ROUNDING_OF_RESIDUALS = 1e-7, 1e-13
# Components that constraints keep at 0 are 0, not what rounding leaves.
CANCELLED_BY_PROJECTION = 2.0**-40
# In a step A may fall to a part 1 / (1 + FALL_OF_RANK), and the distance to a state where it loses
# rank must stay above NEAR_LOSS_OF_RANK allowed errors.
FALL_OF_RANK, NEAR_LOSS_OF_RANK = 2.0, 8.0
ROUNDING_OF_PIVOTS = 2.0**-46  # rounding errors of pivots, as a part of their diagonal entries
ROUNDING_OF_INTEGRALS = 2.0**-51  # rounding errors of integrals, as a part of the moduli of I_j x_j
# A function I changes along f if dI/dt is larger than CHANGE_OF_INTEGRALS times the moduli of its
# terms, and ROUNDING_OF_CHANGES times its size before cancellation. In a step of the length h, I
# then changes by more than PART_OF_CHANGE of h dI/dt, and ROUNDING_OF_CHANGES times its size.
CHANGE_OF_INTEGRALS, ROUNDING_OF_CHANGES, PART_OF_CHANGE = 1e-11, 2.0**-40, 0.125

# -------------------------------------------------------------------------------------- pulses
# Steps are at most REACH_OF_PULSE widths of a pulse exp(-d a**2 / 2). Wide ones, d <= NARROW_PULSE,
# set no limit.
REACH_OF_PULSE, NARROW_PULSE = 24.0, 16.0

# -------------------------------------------------------------------------- sparse_elimination
# Gaps of less than JOINED_GAP rows join spans. 8 is faster on lattices of 144 variables, not of
# 784.
JOINED_GAP = 4

# ------------------------------------------------------------------------ symbolic_elimination
# The least pivot, as a part of the largest, with which elimination without exchanges is accurate.
LEAST_PIVOT = 2.0**-6
