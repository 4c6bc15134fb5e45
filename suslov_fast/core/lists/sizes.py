"""Thresholds: the sizes of lists from which each way to carry them out is taken, as measured.

Times are of one thread of a Zen 3; those of runs beside code, and of elimination by columns, of an
Intel with AVX-512.
"""

# Instructions of straight-line code; a longer list is carried out by runs. LLVM takes 0.3 to 0.5 ms
# for each. Runs take some 3 times as long as code for the Lorenz system and a chain of 32, and 2
# times for one of 128.
CODE = 4000
# Instructions of a step and of one column, above which derivatives are those of one trajectory with
# columns side by side, by runs. For a chain of 16 code takes 0.74 of the time of runs, for one of
# 40, with 3 times as many instructions, 0.77; but 3 s and 31 s to compile on a busy machine.
CODE_OF_TANGENT = 4000
# Part of D**3 below which products of elimination by columns take less time than dense loops, which
# are 3 to 25 times faster than LAPACK from D = 28 on.
BY_COLUMNS = 1 / 8
# Products of elimination, and of terms, that depend on the state and that a list may have: of dense
# fields; of others; and OF_CHAIN D, if that is more. For one orbit runs take as long as columns, in
# batches .7 and .8 of it on grids of 16 x 16 (65,000 products) and 16 x 32 (240,000),
# and 1.0 on one of 22 x 44, whose list takes 10 s to make in place of 2 s. For chains columns take
# 2.1 to 3.7 times as long as runs.
PRODUCTS, OF_LATTICE, OF_CHAIN = 36_000, 100_000, 32
# Products of parameters alone that a list may have, which NumPy carries out for each step size. A
# dense linear field of 120 variables has 574,000: its list takes 4.4 s to make, and 4.2 s for each
# step size, where loops take 0.4 s for 100 steps of 16 orbits.
LONGEST_ONCE = 400_000
# Derivatives have lists up to PART_OF_DENSE D**3 products of the state, and LONGEST in all.
PART_OF_DENSE, LONGEST = 1 / 24, 1_500_000
