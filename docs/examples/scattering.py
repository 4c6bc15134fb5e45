"""
Scattering angle
================

At time minus infinity and at plus infinity the body turns steadily, about two axes in space. The
angle between them depends on the body alone. The picture shows it as a function of the products of
inertia, for all realizable bodies with two ratios of I1 and I2.
"""

from suslov_fast import plot_scattering

axes = plot_scattering(letters="ab")
