"""
Scattering angle
================

At time minus infinity and at plus infinity the body turns steadily, about two axes in space. The
angle between them depends on the body alone. Here it is over the products of inertia.
"""

from suslov_fast import plot_scattering

axes = plot_scattering(letters="ab")
