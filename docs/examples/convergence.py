"""
Order of convergence
====================

At a fixed time, halving the step size divides the error of the map by four, and likewise that of
the orientation of the body. The map is compared with the exact flow, the orientation with a step of
2**-15 of the time.
"""

from suslov_fast import plot_convergence

axes = plot_convergence()
