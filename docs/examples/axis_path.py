"""
The path of the forbidden axis
==============================

The axis about which the body must not turn, seen from space, while the body passes from one steady
rotation to the other: at both ends it runs on a great circle, orthogonal to the axis of the
rotation. Between them it turns from the one to the other.
"""

import matplotlib.pyplot as plt

from suslov_fast import Suslov3D, iterate

body = Suslov3D(I1=4, I2=3, I13=-0.4, I23=-1.2)
run = iterate(body, [-2.0, 0.5], eps=0.02, steps=900, attitude=True)
axis = run.attitude[..., 2]

figure = plt.figure(figsize=(5, 5), layout="constrained")
axes = figure.add_subplot(projection="3d")
axes.scatter(*axis.T, c=run.t, s=4, cmap="viridis")
axes.set_box_aspect((1, 1, 1))
axes.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1), xticks=[], yticks=[], zticks=[])
