"""The kernels of the maps in three dimensions."""

from . import lanes_canonical, lanes_full, lanes_gyrostat, lanes_printed
from .blocks import map_kernel

canonical = map_kernel("canonical", lanes_canonical)
printed = map_kernel("printed", lanes_printed)
full = map_kernel("full", lanes_full)
gyrostat = map_kernel("gyrostat", lanes_gyrostat)
