"""
Three regimes
=============

The number t, which :func:`~suslov_fast.criticality` returns, decides how an orbit behaves. Below 1
it follows the continuous motion. At 1 it falls onto a steady state in one step or two. Beyond 1 it
jumps from one side of the line to the other.
"""

from suslov_fast import plot_regimes

axes = plot_regimes(letters="abc")
