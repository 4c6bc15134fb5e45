"""Numba's options, the cache, LLVM, threads, and what compiled functions share."""
