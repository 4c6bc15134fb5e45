r"""
Order of convergence
====================

At a fixed time the error of the map falls by four where the step is halved, and so does that of the
orientation of the body. The map is compared with the exact flow, the orientation with a step of
2\ :sup:`-15` of the time.
"""

from suslov_fast import plot_convergence

axes = plot_convergence()
