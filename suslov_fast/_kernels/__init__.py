"""Loops over trajectories, steps and states: plain njit, numbers only."""
