"""Thresholds: the sizes of lists from which each way to carry them out is taken, as measured."""

# Instructions of straight-line code that LLVM optimises, in 0.3 to 0.5 ms for each; longer lists
# take it 20 us each, in blocks, and twice the time to run.
CODE = 4000
# Products of elimination that depend on the state, and that a list may have: of dense fields, whose
# products are more than SPARSE D**3, and of others. Fields with more have no list.
SPARSE, OF_DENSE, OF_LATTICE = 1 / 8, 4000, 40_000
# Products of parameters alone, which NumPy carries out for each step size.
LONGEST_ONCE = 400_000
