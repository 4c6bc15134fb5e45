"""The kernels of the maps in three dimensions."""

from . import map_canonical, map_full, map_gyrostat, map_printed
from .blocks import map_kernel

canonical = map_kernel("canonical", map_canonical)
printed = map_kernel("printed", map_printed)
full = map_kernel("full", map_full)
gyrostat = map_kernel("gyrostat", map_gyrostat)
