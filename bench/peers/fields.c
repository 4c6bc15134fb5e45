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

/* The system of Henon and Heiles, where two of four unknowns remain. */
void henon_heiles(const double *from, double *to, long batch, long steps, double eps, long threads)
{
    double h = eps / 2;
#pragma omp parallel for schedule(static) num_threads(threads)
    for (long b = 0; b < batch; b += WIDE) {
        double x[WIDE], y[WIDE], u[WIDE], v[WIDE];
        long width = batch - b < WIDE ? batch - b : WIDE;
        for (int l = 0; l < WIDE; l++) {
            const double *start = from + 4 * (b + (l < width ? l : width - 1));
            x[l] = start[0], y[l] = start[1], u[l] = start[2], v[l] = start[3];
        }
        for (long n = 0; n < steps; n++)
#pragma omp simd
            for (int l = 0; l < WIDE; l++) {
                double m00 = -1 - 2 * y[l], m01 = -2 * x[l], m11 = 2 * y[l] - 1;
                double f2 = -x[l] - 2 * x[l] * y[l], f3 = -y[l] - x[l] * x[l] + y[l] * y[l];
                double g2 = f2 + h * (m00 * u[l] + m01 * v[l]);
                double g3 = f3 + h * (m01 * u[l] + m11 * v[l]);
                double b00 = 1 - h * h * m00, b01 = -h * h * m01, b11 = 1 - h * h * m11;
                double r = 1 / (b00 * b11 - b01 * b01);
                double d2 = (g2 * b11 - g3 * b01) * r, d3 = (g3 * b00 - g2 * b01) * r;
                x[l] += eps * (u[l] + h * d2), y[l] += eps * (v[l] + h * d3);
                u[l] += eps * d2, v[l] += eps * d3;
            }
        for (int l = 0; l < width; l++) {
            double *end = to + 4 * (b + l);
            end[0] = x[l], end[1] = y[l], end[2] = u[l], end[3] = v[l];
        }
    }
}

/* d of A d = right, the last column, by elimination with partial pivoting. */
#define MOST 64
static void eliminate(long m, double A[MOST][MOST + 1], double *d)
{
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
}

/* The Volterra chain x_i' = x_i (x_(i+1) - x_(i-1)), one trajectory at a time. */
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
            eliminate(m, A, d);
            for (long i = 0; i < m; i++) x[i] += eps * d[i];
        }
        for (long i = 0; i < m; i++) to[b * m + i] = x[i];
    }
}

/* Any field x_i' = sum of q_ijk x_j x_k + l_ij x_j, q symmetric in j and k. */
void dense(const double *from, double *to, long batch, long m, long steps, double eps,
           const double *q, const double *l, long threads)
{
#pragma omp parallel for schedule(static) num_threads(threads)
    for (long b = 0; b < batch; b++) {
        double A[MOST][MOST + 1], x[MOST], d[MOST], h = eps / 2;
        for (long i = 0; i < m; i++) x[i] = from[b * m + i];
        for (long n = 0; n < steps; n++) {
            for (long i = 0; i < m; i++) {
                A[i][m] = 0;
                for (long j = 0; j < m; j++) {
                    double half = 0;
                    for (long k = 0; k < m; k++) half += q[(i * m + j) * m + k] * x[k];
                    A[i][m] += (half + l[i * m + j]) * x[j];
                    A[i][j] = (i == j) - h * (2 * half + l[i * m + j]);
                }
            }
            eliminate(m, A, d);
            for (long i = 0; i < m; i++) x[i] += eps * d[i];
        }
        for (long i = 0; i < m; i++) to[b * m + i] = x[i];
    }
}
