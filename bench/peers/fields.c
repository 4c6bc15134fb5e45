/* Kahan's map of quadratic fields: x~ = x + eps A(x)^-1 f(x), A = 1 - (eps/2) f'(x). Last states. */
#include <math.h>

/* The Lorenz system, written out for it, 64 trajectories at once, without pivoting. */
#define WIDE 64
void lorenz(const double *from, double *to, long batch, long steps, double eps, long threads)
{
    double h = eps / 2;
#pragma omp parallel for schedule(static) num_threads(threads)
    for (long b = 0; b < batch; b += WIDE) {
        double x[WIDE], y[WIDE], z[WIDE];
        long width = batch - b < WIDE ? batch - b : WIDE;
        for (int l = 0; l < WIDE; l++) {
            const double *start = from + 3 * (b + (l < width ? l : width - 1));
            x[l] = start[0], y[l] = start[1], z[l] = start[2];
        }
        for (long n = 0; n < steps; n++)
#pragma omp simd
            for (int l = 0; l < WIDE; l++) {
                double u = x[l], v = y[l], t = z[l];
                double f0 = 10 * (v - u), f1 = 28 * u - v - u * t, f2 = u * v - 8. / 3 * t;
                double a00 = 1 + h * 10, a01 = -h * 10, a10 = -h * (28 - t), a11 = 1 + h;
                double a12 = h * u, a20 = -h * v, a21 = -h * u, a22 = 1 + h * 8. / 3;
                double r0 = 1 / a00, m1 = a10 * r0, m2 = a20 * r0;
                double b11 = a11 - m1 * a01, g1 = f1 - m1 * f0;
                double b21 = a21 - m2 * a01, g2 = f2 - m2 * f0;
                double r1 = 1 / b11, m3 = b21 * r1;
                double d2 = (g2 - m3 * g1) / (a22 - m3 * a12), d1 = (g1 - a12 * d2) * r1;
                x[l] = u + eps * (f0 - a01 * d1) * r0, y[l] = v + eps * d1, z[l] = t + eps * d2;
            }
        for (int l = 0; l < width; l++)
            to[3 * (b + l)] = x[l], to[3 * (b + l) + 1] = y[l], to[3 * (b + l) + 2] = z[l];
    }
}

/* The Volterra chain x_i' = x_i (x_(i+1) - x_(i-1)), by elimination with partial pivoting, one
   trajectory at a time. */
#define MOST 64
void volterra(const double *from, double *to, long batch, long m, long steps, double eps,
              long threads)
{
#pragma omp parallel for schedule(static) num_threads(threads)
    for (long b = 0; b < batch; b++) {
        double A[MOST][MOST + 1], x[MOST], d[MOST], h = eps / 2;
        for (long i = 0; i < m; i++) x[i] = from[b * m + i];
        for (long n = 0; n < steps; n++) {
            for (long i = 0; i < m; i++) {
                long after = (i + 1) % m, before = (i + m - 1) % m;
                double slope = x[after] - x[before];
                for (long j = 0; j < m; j++) A[i][j] = 0;
                A[i][i] = 1 - h * slope;
                A[i][after] -= h * x[i];
                A[i][before] += h * x[i];
                A[i][m] = x[i] * slope;
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
                for (long j = i + 1; j < m; j++) s -= A[i][j] * d[j];
                d[i] = s / A[i][i];
            }
            for (long i = 0; i < m; i++) x[i] += eps * d[i];
        }
        for (long i = 0; i < m; i++) to[b * m + i] = x[i];
    }
}
