"""Which size of a list takes which way to carry it out: thresholds, with what was measured.

Times are of one thread of a Zen 3.
"""

# Instructions of straight-line code; a longer list is carried out by runs. LLVM takes 0.3 to 0.5 ms
# for each. Runs take 24 times as long as code for the Lorenz system, 3 times for a chain of 32, and
# 1.4 times for one of 128.
CODE = 4000
# Instructions of a step and of one column, above which derivatives are those of one trajectory with
# columns side by side, by runs. For a chain of 16 code takes 0.74 of the time of runs, for one of
# 40, with 3 times as many instructions, 0.77; but 3 s and 31 s to compile on a busy machine.
CODE_OF_TANGENT = 4000
# A field has a list unless more terms and products of elimination depend on the state than
# PRODUCTS, and than PART_OF_DENSE D**3: then loops over a dense matrix are faster. They are 3 to 25
# times faster than LAPACK from D = 28 on.
PRODUCTS, PART_OF_DENSE = 36_000, 1 / 24
# Products of elimination that a list may have: that of a lattice of 32 x 32 has a million, and
# takes 4 s to make; its runs take 2 s.
LONGEST = 1_500_000
# Those of parameters alone, which NumPy carries out for each step size. A dense linear field of 120
# variables has 574,000: its list takes 4.4 s to make, and 4.2 s for each step size, where loops
# take 0.4 s for 100 steps of 16 orbits.
LONGEST_ONCE = 400_000
