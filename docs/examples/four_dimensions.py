"""
Four dimensions
===============

For n = 4 a state has three components. Orbits leave one pole of the ellipsoid of constant energy,
c I with c > 0, and end next to the opposite one. For this body no first integral of the map is
known: its modified energy drifts too, but less, by one order of eps squared more.
"""

from suslov_fast import plot_four_dimensions

axes = plot_four_dimensions(letters="ab")
