"""Numba's options, the cache, LLVM, threads, and helpers of compiled functions."""
