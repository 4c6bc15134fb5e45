"""Kernels: plain loops over formulas; they never validate, raise or allocate."""
