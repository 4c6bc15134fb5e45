"""DOP853 in 8 lanes in C, with steps of its own in each lane, written for a system.

The text of C is made of the coefficients that SciPy has, and of the right-hand side. Lanes are
vectors of gcc; sines are those of glibc's vector library. Lengths change by err**(-1/8), as three
square roots in lanes, and a line of 8 orbits ends with its last one.
"""

import ctypes
import functools
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from motions import SYSTEMS
from native import FLAGS
from scipy.integrate._ivp import dop853_coefficients as method

from peers.motions import program

STAGES = method.N_STAGES

_TEXT = """
#include <math.h>
#define D %(D)d
typedef double v8 __attribute__((vector_size(64), aligned(64)));
typedef long m8 __attribute__((vector_size(64), aligned(64)));
static inline v8 choose(m8 mask, v8 a, v8 b)
{
    return (v8)((mask & (m8)a) | (~mask & (m8)b));
}
static inline v8 sqrt8(v8 a)
{
    v8 b;
    for (int l = 0; l < 8; l++) b[l] = __builtin_sqrt(a[l]);
    return b;
}
static inline v8 abs8(v8 a) { return choose(a < 0, -a, a); }
static inline v8 max8(v8 a, v8 b) { return choose(a > b, a, b); }
static inline v8 min8(v8 a, v8 b) { return choose(a < b, a, b); }
#ifdef HAS_SIN
typedef double v4 __attribute__((vector_size(32), aligned(32)));
v4 _ZGVdN4v_sin(v4);
static inline v8 sin8(v8 a)
{
    union { v8 all; v4 parts[2]; } u = {a};
    u.parts[0] = _ZGVdN4v_sin(u.parts[0]), u.parts[1] = _ZGVdN4v_sin(u.parts[1]);
    return u.all;
}
#endif
static inline void rates(const v8 *x, v8 *out)
{
%(rates)s
}

void orbits(double *states, long lines, double time, double rtol, double atol)
{
    for (long line = 0; line < lines; line++, states += 8 * D) {
        v8 y[D], z[D], k[%(stages)d + 1][D], t = {0}, size = {0}, rate = {0}, longer;
        for (int i = 0; i < D; i++)
            for (int l = 0; l < 8; l++) y[i][l] = states[D * l + i];
        rates(y, k[0]);
        for (int i = 0; i < D; i++) {
            v8 scale = atol + rtol * abs8(y[i]);
            size += y[i] / scale * y[i] / scale, rate += k[0][i] / scale * k[0][i] / scale;
        }
        v8 h = min8(0.01 * sqrt8(size / rate), time - t);
        longer = t + 10;
        for (;;) {
            v8 fifth = {0}, third = {0};
            m8 runs = t < time;
            h = choose(runs, min8(h, time - t), t * 0);
%(stages_text)s
            for (int i = 0; i < D; i++) {
                v8 scale = 1 / (atol + rtol * max8(abs8(y[i]), abs8(z[i])));
                v8 e5 = (%(e5)s) * scale, e3 = (%(e3)s) * scale;
                fifth += e5 * e5, third += e3 * e3;
            }
            v8 err = abs8(h) * fifth / sqrt8((fifth + 0.01 * third + 1e-300) * D);
            v8 root = sqrt8(sqrt8(sqrt8(max8(err, t * 0 + 1e-20))));
            m8 good = (err < 1) & runs;
            v8 factor = max8(min8(0.9 / root, longer), t * 0 + 0.2);
            t = choose(good, choose(t + h >= time * (1 - 1e-15), t * 0 + time, t + h), t);
            for (int i = 0; i < D; i++) {
                y[i] = choose(good, z[i], y[i]), k[0][i] = choose(good, k[%(stages)d][i], k[0][i]);
            }
            h = choose(runs, h * choose(good, factor, min8(factor, t * 0 + 0.9)), h);
            longer = choose(good, t * 0 + 10, t * 0 + 1);
            int more = 0;
            for (int l = 0; l < 8; l++) more |= t[l] < time;
            if (!more) break;
        }
        for (int i = 0; i < D; i++)
            for (int l = 0; l < 8; l++) states[D * l + i] = y[i][l];
    }
}
"""


def _sum(factors):
    return " + ".join(f"{a!r} * k[{s}][i]" for s, a in enumerate(factors.tolist()) if a)


@functools.cache
def _library(name):
    lines, results = program(name)
    rates = [f"v8 x{i} = x[{i}];" for i in range(len(results))]
    for result, value in lines:
        rates.append(f"v8 {result} = {value.replace('sqrt(', 'sqrt8(').replace('sin(', 'sin8(')};")
    rates += [f"out[{i}] = {result};" for i, result in enumerate(results)]
    stages = []
    for s in range(1, STAGES + 1):
        total = _sum(method.A[s, :s] if s < STAGES else method.B)
        stages.append(f"for (int i = 0; i < D; i++) z[i] = y[i] + h * ({total});")
        stages.append(f"rates(z, k[{s}]);")
    values = {"D": len(results), "rates": "\n".join(rates), "stages": STAGES}
    values |= {"stages_text": "\n".join(stages), "e5": _sum(method.E5), "e3": _sum(method.E3)}
    has_sin = any("sin8(" in line for line in rates)
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "orbits.c"), Path(folder, "orbits.so")
        source.write_text(_TEXT % values)
        command = ["gcc", *FLAGS, *["-DHAS_SIN"] * has_sin, source, "-o", target, "-lm"]
        done = subprocess.run([*command, *["-lmvec"] * has_sin], capture_output=True, text=True)
        if done.returncode:
            raise ImportError(f"gcc could not compile {name}: {done.stderr.splitlines()[0]}")
        orbits = ctypes.CDLL(str(target)).orbits
    orbits.argtypes = [ctypes.c_void_p, ctypes.c_long, *[ctypes.c_double] * 3]
    return orbits


def in_lanes(name, tolerance):
    """A function of starts (batch, D), which returns the states at the last time."""
    orbits, time = _library(name), SYSTEMS[name].time

    def run(x):
        states = np.resize(x, (-(-len(x) // 8) * 8, x.shape[1]))
        orbits(states.ctypes.data, len(states) // 8, time, tolerance, 1e-3 * tolerance)
        return states[: len(x)]

    return run
