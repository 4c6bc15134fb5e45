"""Numbers only: the maps, their closed form and the motion, as Numba and LLVM compile them.

Nothing here checks an argument or imports another part of the package.
"""
