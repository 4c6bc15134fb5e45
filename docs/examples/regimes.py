"""
Three regimes
=============

The criticality t (:func:`~suslov_fast.criticality`) determines the regime of an orbit. For t < 1 it
follows the continuous motion. At t = 1 it reaches a steady state in one or two steps. For t > 1 it
jumps from one side of the line to the other. Numbers count steps.
"""

from suslov_fast import plot_regimes

axes = plot_regimes(letters="abc")
