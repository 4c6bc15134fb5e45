"""Numbers that decide about formulas and their tests: tolerances, limits and sizes."""

# ---------------------------------------------------------------------------------------- branching
MOST_PATHS = 64  # the most paths, and the most decisions on one of them

# ------------------------------------------------------------------------------------ equation_text
# The most nested operations in a written text; deeper parts become definitions.
DEEPEST_WRITTEN = 40
DEEPEST_READ = 100  # the most nested operations in a text that is read; more raise an error
LONGEST_EQUATION = 2_000_000  # the most characters of an equation, such as a table of 50,000 knots
LONGEST_EQUATIONS = 20_000_000  # the most characters of all equations together
# A constant of more than LONGEST_DECIMAL characters is written as a ratio if a ratio with a
# denominator up to LARGEST_DENOMINATOR equals the constant.
LONGEST_DECIMAL, LARGEST_DENOMINATOR = 14, 999

# ---------------------------------------------------------------------------------------- equations
LONGEST_SHORTENED = 300  # the most characters of a shortened formula, as in `repr`

# ------------------------------------------------------------------------------------ exact_numbers
# The most characters of a number in a text, and the largest exponent of 10 in a decimal: it would
# take minutes to make the fraction 1e99999999.
LONGEST_NUMBER, LARGEST_DECIMAL_EXPONENT = 10_000, 400

# --------------------------------------------------------------------------------------- identities
MOST_PRODUCTS_OF_TERMS = 200_000  # the most products of terms, which take about half a second
LARGEST_POWER = 12  # the largest exponent of a power that is multiplied out

# --------------------------------------------------------------------------------------- invariants
# Random states for each member, and of all members.
SAMPLES_OF_MEMBER, SAMPLES_OF_FAMILY = 24, 2**18

# --------------------------------------------------------------------------------------- lagrangian
LEAST_EIGENVALUE_OF_MASS = 1e-13  # least eigenvalue of a positive definite M with 1 on its diagonal
ENTRIES_OF_ROW = 12  # in rows of constraints with more entries, sines and cosines are not sought

# -------------------------------------------------------------------------------------------- latex
LONGEST_LATEX = 4000  # the most characters of equations that are shown in LaTeX

# ----------------------------------------------------------------------------------- linear_algebra
MOST_ROWS = 12  # rows of matrices; of determinants 6, as there are 2**n minors

# --------------------------------------------------------------------------------------------- mass
LEAST_CONDITION = 1e-14  # a matrix of numbers is singular if 1 / condition number is below this
# A difference counts as 0 if it is below ROUNDING_OF_DIFFERENCE times its terms' moduli in a
# fraction PART_OF_CANCELLED_SAMPLES or more of SAMPLES_OF_DIFFERENCE random states. At the others
# rounding errors may be larger, by elimination.
PART_OF_CANCELLED_SAMPLES, SAMPLES_OF_DIFFERENCE, ROUNDING_OF_DIFFERENCE = 0.8, 32, 1e-11
# The most equations that Cramer's rule solves: for n equations it needs 2**n minors.
MOST_EQUATIONS_OF_CRAMER = 4

# ---------------------------------------------------------------------------------------- mechanics
NEWTON_STEPS_TO_CONSTRAINTS = 64  # the most steps of Newton's method to constraints
# A step that moves a state by this part of its size is the last one.
LAST_STEP_TO_CONSTRAINTS = 2.0**-50

# -------------------------------------------------------------------------------------------- names
# Limits of files: the characters of a name, and the number of variables.
LONGEST_NAME, MOST_VARIABLES = 200, 2**20

# --------------------------------------------------------------------------------------- namespaces
MOST_ENTRIES = 100  # longer lists hold data

# --------------------------------------------------------------------------------- right_hand_sides
MOST_LISTS_OF_EVENTS = 16  # the most lists of events for which a field keeps its right-hand sides
# A program of up to MOST_OPERATIONS_COMPILED operations is compiled after CALLS_BEFORE_COMPILING
# calls in NumPy, or BATCHES_BEFORE_COMPILING with batches, because compiling it takes no longer
# than these calls took.
CALLS_BEFORE_COMPILING, BATCHES_BEFORE_COMPILING, MOST_OPERATIONS_COMPILED = 500, 50, 3000
# Number of terms above which loops, not a list, compute f if few coefficients are 0.
TERMS_OF_FULL_FIELD = 4000

# ------------------------------------------------------------------------------------- trigonometry
MOST_MONOMIALS = 200  # the most monomials of an expansion; formulas with more stay as they are
# A sum of coefficients is 0 if it is below this part of their moduli.
ROUNDING_OF_COEFFICIENT = 2.0**-44
