"""A turning body.

The ellipsoid of inertia in space, and the path of the axis about which the body cannot turn; its
hidden half is faint. The motion begins close to one steady rotation and ends close to the other.
"""

import matplotlib.pyplot as plt

from suslov_fast import animate_body

plt.rcParams["animation.html"] = "jshtml"
animation = animate_body(every=8)
animation
