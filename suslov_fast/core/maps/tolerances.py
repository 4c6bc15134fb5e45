"""Numbers that decide about steps of maps: lost digits, and measured limits of programs."""

# ---------------------------------------------------------------------------------- kahan_step
# A step has lost digits if one component of the next state is below SMALL_BESIDE_INCREMENT times
# half of its increment, or if each component is below LARGE_BESIDE_INCREMENT times half of it.
SMALL_BESIDE_INCREMENT, LARGE_BESIDE_INCREMENT = 2.0**-10, 2.0**-4
# A change of sign to a smaller modulus does not count: it may be rounding.
LEAST_WITH_SIGN = 2.0**-1000
# The most instructions of straight-line code that LLVM optimises, in 0.3 to 0.5 ms each. Longer
# programs are split into blocks: an instruction compiles in 20 us, and takes twice the time to run.
MOST_OPTIMISED = 4000
# The most products of elimination that depend on the state: of dense fields, which have more than
# PART_OF_DENSE D**3 products, and of sparse fields. Fields with more products have no program.
PART_OF_DENSE, MOST_OF_DENSE, MOST_OF_SPARSE = 1 / 8, 4000, 40_000
# The most products of parameters alone, which NumPy computes once for each step size.
MOST_OF_PARAMETERS = 400_000
# Steps with columns of derivatives have a program if they have at most COMPONENTS_WITH_COLUMNS
# components, and if this number times the products of an elimination is at most WORK_WITH_COLUMNS.
# For more, LLVM would take seconds, so NumPy computes the derivatives.
COMPONENTS_WITH_COLUMNS, WORK_WITH_COLUMNS = 16, 4000

# -------------------------------------------------------------------------------------- kernel
TRAJECTORIES_IN_LINES = 2**13  # trajectories that are copied into lines at once
# Nanoseconds of `pivoting_step` steps, after which Python handles Ctrl-C.
TIME_OF_PIVOTING = 5 * 10**7
# Seconds in Python for an operation; a step with pivoting counts as D**2 of them.
TIME_OF_OPERATION_IN_PYTHON = 1e-5
# Lines times steps up to which `pivoting_step` is prepared only if lanes need it.
SHORT_RUN = 256

# ------------------------------------------------------------------------------------ map_step
# NumPy runs programs of more than LONGEST_MAP operations, which LLVM would compile for seconds, and
# computes derivatives with more than WORK_OF_DERIVATIVES products (measured on coupled lattices).
LONGEST_MAP, WORK_OF_DERIVATIVES = 10_000, 4000

# --------------------------------------------------------------------------------------- packs
FIELDS_IN_MEMORY = 32  # the most fields for which tables are kept from call to call

# --------------------------------------------------------------------------------- step_system
# The most operations of one call of machine code: Ctrl-C waits until it ends.
OPERATIONS_WITHOUT_PAUSE = 10**6

# ------------------------------------------------------------------------------------- superlu
MOST_REFINEMENTS = 4  # of a solution; two suffice but near poles
LEAST_REFINEMENT = 2.0**-85  # refinement ends when it changes each component by less, relatively
TIME_OF_ENTRY_IN_PYTHON = 3e-6  # seconds in Python for an entry of a residual
