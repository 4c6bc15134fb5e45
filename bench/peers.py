"""Other ways to compute the same final states; each is a function (omega0, steps) -> states."""

import ctypes
import functools
import shutil
import subprocess
import tempfile
from pathlib import Path

import numba
import numpy as np
from problem import BODY, EPS

I1, I2, I13, I23 = BODY.parameters

_C_SOURCE = r"""
#include <math.h>
#define LANES 64
/* Equation (ds2) as printed. */
void as_printed(const double *from, double *to, long batch, long steps,
                double I1, double I2, double I13, double I23, double eps)
{
    const double k1 = eps * I13 / (2 * I1), k2 = eps * I23 / (2 * I2);
    const double k3 = eps * I23 / I1, k4 = eps * I13 / I2, k5 = eps * eps / (I1 * I2);
    #pragma omp parallel for schedule(static)
    for (long first = 0; first < batch; first += LANES) {
        double u[LANES], v[LANES];
        long width = batch - first < LANES ? batch - first : LANES;
        for (int l = 0; l < LANES; l++) {
            u[l] = l < width ? from[2 * (first + l)] : 0;
            v[l] = l < width ? from[2 * (first + l) + 1] : 0;
        }
        for (long n = 0; n < steps; n++)
            for (int l = 0; l < LANES; l++) {
                double p = u[l], q = v[l];
                double delta = (1 + k1 * q) * (1 - k2 * p)
                    + k5 * (I13 * p / 2 + I23 * q) * (I13 * p + I23 * q / 2);
                u[l] = (p - k2 * p * p - k1 * p * q - k3 * q * q) / delta;
                v[l] = (q + k1 * q * q + k2 * p * q + k4 * p * p) / delta;
            }
        for (int l = 0; l < width; l++) {
            to[2 * (first + l)] = u[l];
            to[2 * (first + l) + 1] = v[l];
        }
    }
}
/* The same map without parameters. */
void parameter_free(const double *from, double *to, long batch, long steps,
                    double I1, double I2, double I13, double I23, double eps)
{
    const double a = I1 * I2, D = I13 * I13 * I2 + I23 * I23 * I1;
    const double scale_x = eps / sqrt(2 * a), scale_y = eps / (2 * a);
    #pragma omp parallel for schedule(static)
    for (long first = 0; first < batch; first += LANES) {
        double X[LANES], Y[LANES];
        long width = batch - first < LANES ? batch - first : LANES;
        for (int l = 0; l < LANES; l++) {
            double p = l < width ? from[2 * (first + l)] : 0;
            double q = l < width ? from[2 * (first + l) + 1] : 0;
            X[l] = scale_x * (I13 * p + I23 * q);
            Y[l] = scale_y * (I23 * I1 * p - I13 * I2 * q);
        }
        for (long n = 0; n < steps; n++)
            for (int l = 0; l < LANES; l++) {
                double x = X[l] * (1 + Y[l]) / (1 - Y[l] + X[l] * X[l]);
                Y[l] -= X[l] * x;
                X[l] = x;
            }
        for (int l = 0; l < width; l++) {
            double x = X[l] / scale_x, y = Y[l] / scale_y;
            to[2 * (first + l)] = (I13 * I2 * x + I23 * y) / D;
            to[2 * (first + l) + 1] = (I23 * I1 * x - I13 * y) / D;
        }
    }
}
/* Equation (dsn): the matrix A, Gaussian elimination with partial pivoting, one trajectory. */
void eliminate(const double *from, double *to, long batch, long m, long steps,
               const double *J, const double *I, double eps)
{
    static double A[256][257], w[256];
    for (long b = 0; b < batch; b++) {
        for (long i = 0; i < m; i++) w[i] = from[b * m + i];
        for (long n = 0; n < steps; n++) {
            double p = 0;
            for (long i = 0; i < m; i++) p += I[i] * w[i];
            for (long i = 0; i < m; i++) {
                double h = eps / (2 * J[i]);
                for (long j = 0; j < m; j++) A[i][j] = h * (2 * I[i] * w[j] - I[j] * w[i]);
                A[i][i] += 1 - h * p;
                A[i][m] = w[i];
            }
            for (long k = 0; k < m; k++) {
                long row = k;
                for (long i = k + 1; i < m; i++) if (fabs(A[i][k]) > fabs(A[row][k])) row = i;
                if (row != k)
                    for (long j = k; j <= m; j++) {
                        double other = A[k][j];
                        A[k][j] = A[row][j];
                        A[row][j] = other;
                    }
                double r = 1 / A[k][k];
                for (long i = k + 1; i < m; i++) {
                    double f = A[i][k] * r;
                    for (long j = k + 1; j <= m; j++) A[i][j] -= f * A[k][j];
                }
            }
            for (long i = m - 1; i >= 0; i--) {
                double s = A[i][m];
                for (long j = i + 1; j < m; j++) s -= A[i][j] * w[j];
                w[i] = s / A[i][i];
            }
        }
        for (long i = 0; i < m; i++) to[b * m + i] = w[i];
    }
}
"""


@functools.cache
def _library():
    """The C functions, or None without gcc."""
    if shutil.which("gcc") is None:
        return None
    folder = Path(tempfile.mkdtemp())
    source = folder / "peers.c"
    source.write_text(_C_SOURCE)
    flags = ["-O3", "-march=native", "-fopenmp", "-shared", "-fPIC"]
    subprocess.run(["gcc", *flags, source, "-o", folder / "peers.so", "-lm"], check=True)
    library = ctypes.CDLL(str(folder / "peers.so"))
    shutil.rmtree(folder)
    return library


def c_functions():
    """Both C functions of the 3D map, or none without gcc."""
    library = _library()
    if library is None:
        return {}
    double_p = ctypes.POINTER(ctypes.c_double)

    def wrap(function):
        function.argtypes = [double_p, double_p, *[ctypes.c_long] * 2, *[ctypes.c_double] * 5]

        def call(omega0, steps):
            final = np.empty_like(omega0)
            function(
                omega0.ctypes.data_as(double_p),
                final.ctypes.data_as(double_p),
                len(omega0), steps, I1, I2, I13, I23, EPS,
            )  # fmt: skip
            return final

        return call

    return {
        "C, the parameter-free form": wrap(library.parameter_free),
        "C, (ds2) as printed": wrap(library.as_printed),
    }


def c_elimination(body, omega0, eps, steps):
    """Final states in n dimensions, by C, on one core."""
    double_p = ctypes.POINTER(ctypes.c_double)
    final = np.empty_like(omega0)
    arrays = [
        array.ctypes.data_as(double_p) for array in (omega0, final, body.J.copy(), body.I.copy())
    ]
    sizes = map(ctypes.c_long, (*omega0.shape, steps))
    _library().eliminate(*arrays[:2], *sizes, *arrays[2:], ctypes.c_double(eps))
    return final


def numpy_solve(body, omega0, eps, steps):
    """Final states in n dimensions, by NumPy's batched solver."""
    J, I, omega = body.J, body.I, omega0
    for _ in range(steps):
        p = (omega @ I)[:, None, None]
        A = eps / (2 * J[:, None]) * (2 * I[:, None] * omega[:, None] - I * omega[..., None])
        A = A + np.eye(len(J)) * (1 - eps * p / (2 * J))
        omega = np.linalg.solve(A, omega[..., None])[..., 0]
    return omega


K1, K2, K3, K4 = EPS * I13 / (2 * I1), EPS * I23 / (2 * I2), EPS * I23 / I1, EPS * I13 / I2


def as_printed(p, q):
    """Equation (ds2), for numbers and arrays."""
    delta = (1 + K1 * q) * (1 - K2 * p) + (K1 * p + K3 * q) * (K4 * p + K2 * q)
    return (
        (p - K2 * p * p - K1 * p * q - K3 * q * q) / delta,
        (q + K1 * q * q + K2 * p * q + K4 * p * p) / delta,
    )


def numpy_batch(omega0, steps):
    """(ds2) over the batch by NumPy."""
    p, q = omega0.T.copy()
    for _ in range(steps):
        p, q = as_printed(p, q)
    return np.stack([p, q], axis=-1)


def python_loop(omega0, steps):
    """(ds2), one number at a time."""
    final = []
    for p, q in omega0.tolist():
        for _ in range(steps):
            p, q = as_printed(p, q)
        final.append((p, q))
    return np.array(final)


_compiled = numba.njit(as_printed)


@numba.njit(parallel=True)
def numba_prange(omega0, steps):
    """(ds2) as one writes it first in Numba: `prange` over trajectories."""
    final = np.empty_like(omega0)
    for i in numba.prange(len(omega0)):
        p, q = omega0[i]
        for _ in range(steps):
            p, q = _compiled(p, q)
        final[i] = p, q
    return final
