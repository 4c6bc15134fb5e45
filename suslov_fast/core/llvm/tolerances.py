"""Numbers that decide about machine code: how loops are written, and how much of it is kept."""

WIDTH = 8  # trajectories side by side in SIMD lanes; a single one is computed alone

# ------------------------------------------------------------------------------------ compiler
# Codes that need not last are dropped when their texts reach MOST_TEXT in all: some 250 MB
# of memory. Each counts as LEAST_TEXT at least, because it takes two memory mappings; Linux grants
# 65,530 to a process, and LLVM ends the process if it gets none.
MOST_TEXT, LEAST_TEXT = 2**28, 2**16

# ------------------------------------------------------------------------------- sparse_solver
# Rows of a span (`_along`) taken at once if W = 1. Singly, lattices take 1.15 times as long.
ROWS_OF_SPAN = 4

# ---------------------------------------------------------------------------------------- text
WRITTEN_OUT = 4  # the most rounds of a loop that is unrolled where it takes much of the time
# Rows that `Code.fill` takes at once, if there are MANY_ROWS.
ROWS_OF_FILL, MANY_ROWS = 8, 100
