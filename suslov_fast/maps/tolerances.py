"""Numbers that decide about runs of maps: sizes of chunks, limits and measured times."""

# -------------------------------------------------------------------------------------------- batch
# Work of a thread in a chunk, and cost of saving a state; the unit is one step of the map in 3D.
WORK_OF_CHUNK, COST_OF_SAVING = 2**26, 8.0
# Seconds: after a chunk below TIME_OF_SHORT_CHUNK the next has twice as many steps, after one above
# TIME_OF_LONG_CHUNK half.
TIME_OF_SHORT_CHUNK, TIME_OF_LONG_CHUNK = 0.02, 0.1
# Seconds for a step of one trajectory if Python interprets the kernel, per unit of cost. The 3D map
# computes up to FEW_TRAJECTORIES trajectories one by one; larger batches fill whole blocks of
# lanes.
TIME_OF_STEP_IN_PYTHON, FEW_TRAJECTORIES = 1e-5, 6
# The most work of a chunk with orientations, n x n matrices: the number of states times n**2.
WORK_OF_CHUNK_WITH_TURNS = 2**24
# The least number of steps from one report of progress to the next, for the 3D map; a fourth of it
# for slower maps. After each report the states of a large batch are read from memory again.
STEPS_BETWEEN_REPORTS = 256

# -------------------------------------------------------------------------------------- derivatives
# Operations of one call of a kernel, some tenths of a second; between calls Ctrl-C is handled.
WORK_OF_CALL = 2**28

# --------------------------------------------------------------------------------------- evaluation
# The largest number of states times D**2 in a part of a batch: it fits into the caches.
NUMBERS_OF_PART = 2**16

# ------------------------------------------------------------------------------------- kernel_calls
# A call of fewer steps, of all trajectories together, is serial. Measured on two cores: threads
# that are awake gain from about 10,000 on, but less than 0.1 ms up to this number, and a sleeping
# thread may take 8 ms to wake.
STEPS_OF_SERIAL_CALL = 1_000_000

# ---------------------------------------------------------------------------------- ordered_algebra
# Before `decompose_each` is compiled, NumPy takes TIME_OF_FRAME_IN_NUMPY n**3 (K + ENTRIES_OF_CALL)
# seconds.
TIME_OF_FRAME_IN_NUMPY, ENTRIES_OF_CALL = 4e-9, 500
# The most sweeps of Jacobi's method, which needs 5 to 10; entries that are rounding, as parts of
# the root of the product of both diagonal entries.
MOST_SWEEPS, ROUNDING_OF_JACOBI = 30, 2.0**-56
