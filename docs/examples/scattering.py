"""
Scattering angle
================

At time minus infinity and at plus infinity the body turns steadily, about two axes in space. The
angle between them depends on the body alone. Here it is drawn over the products of inertia of all
bodies of matter with two ratios of I1 and I2.
"""

from suslov_fast import plot_scattering

axes = plot_scattering(letters="ab")
