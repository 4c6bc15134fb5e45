"""Numba loops over trajectories, steps and states."""
