"""The kernels of the maps in three dimensions."""

from . import canonical as _canonical
from . import full as _full
from . import gyrostat as _gyrostat
from . import printed as _printed
from .iterate import map_kernel

canonical = map_kernel("canonical", _canonical)
printed = map_kernel("printed", _printed)
full = map_kernel("full", _full)
gyrostat = map_kernel("gyrostat", _gyrostat)
