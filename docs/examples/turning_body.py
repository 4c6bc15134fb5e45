"""A turning body.

The ellipsoid of inertia in space, and the path of the axis about which the body cannot turn; its
hidden half is faint. The motion begins close to one steady rotation and ends close to the other.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Suslov3D, animate_body, iterate

body = Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3, I3=3)
x, y = np.array([-0.3, 0.5]) / np.hypot(0.3, 0.5)  # a repelling steady rotation
start = [2 * x - 0.3 * y, 2 * y + 0.3 * x]
plt.rcParams["animation.html"] = "jshtml"
animation = animate_body(iterate(body, start, eps=0.05, steps=440, attitude=True), every=8)
animation
