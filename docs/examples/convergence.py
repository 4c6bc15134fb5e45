"""
Order of convergence
====================

At a fixed time the error of the map falls by four where the step is halved, and so does that of the
orientation of the body.
"""

from suslov_fast import plot_convergence

axes = plot_convergence()
