"""
Four dimensions
===============

For n = 4 a state has three components. Orbits leave one pole of the ellipsoid of constant energy,
cI with c > 0, and end close to the opposite one; those on its far side are faint. For this body no
first integral of the map is known: the modified energy drifts too, but its drift is of order 4 in
eps instead of 2.
"""

from suslov_fast import plot_four_dimensions

axes = plot_four_dimensions(letters="ab")
