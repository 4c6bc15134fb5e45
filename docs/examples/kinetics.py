"""Stiff kinetics over time, and a batch of them.

The Oregonator of Field and Noyes, whose three concentrations differ by up to six powers of ten.
Left, all of them over time. Right, the period of the oscillation over the factor f, for 100 values
at once: times between maxima.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Field, crossings, flow


def oregonator(x, f):
    A, B, C = x
    s, w, q = 77.27, 0.161, 8.375e-6
    return s * (B + A * (1 - q * A - B)), (f * C - (1 + A) * B) / s, w * (A - C)


figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.8), layout="constrained")
field = Field(oregonator, "A B C", f=1)
motion = flow(field, [1, 2, 3], time=np.linspace(0, 900, 3000), rtol=1e-8, atol=0)
looks = zip("ABC", ("black", "tab:blue", "tab:orange"), ("--", "-", "-"), (3, 2, 1), strict=True)
for name, colour, style, order in looks:
    left.plot(motion.time, motion[name], style, color=colour, zorder=order, linewidth=1, label=name)
left.set(xlabel="$t$", yscale="log", ylabel="concentration")
left.legend(loc="upper right")

f = np.linspace(0.6, 1.5, 100)
family = Field(oregonator, "A B C", f=f)


def falling(x, f):
    return -oregonator(x, f)[0]


peaks = crossings(family, [1, 2, 3], surface=falling, time=2000, transient=1000, atol=0)
period = [np.diff(peaks.time[peaks.trajectory == k]).mean() for k in range(100)]
right.plot(f, period, color="steelblue")
right.set(xlabel="$f$", ylabel="period")
