/* The map in C optimised for speed: blocks of 64 trajectories, one per lane. */
#include <math.h>
#include <string.h>
#if defined(__x86_64__)
#include <immintrin.h>
#endif
#define LANES 64
#define ARGUMENTS const double *from, double *to, long batch, long steps, double I1, double I2, \
                  double I13, double I23, double eps, long threads
#define FOR_LANES for (int l = 0; l < LANES; l++)
#define FOR_BLOCKS _Pragma("omp parallel for schedule(static) num_threads(threads)") \
                   for (long first = 0; first < batch; first += LANES)

/* Conversion between (batch, 2) and the two arrays of a block; lanes beyond the batch are 0. */
static long load(const double *from, long batch, long first, double *u, double *v)
{
    long width = batch - first < LANES ? batch - first : LANES;
    FOR_LANES {
        u[l] = l < width ? from[2 * (first + l)] : 0;
        v[l] = l < width ? from[2 * (first + l) + 1] : 0;
    }
    return width;
}

static void unload(double *to, long first, long width, const double *u, const double *v)
{
    for (int l = 0; l < width; l++) {
        to[2 * (first + l)] = u[l];
        to[2 * (first + l) + 1] = v[l];
    }
}

/* The map as Section 4 prints it: QUOTIENTS divides the numerators u[l] and v[l] by delta. */
#define PRINTED(QUOTIENTS) \
    const double k1 = eps * I13 / (2 * I1), k2 = eps * I23 / (2 * I2); \
    const double k3 = eps * I23 / I1, k4 = eps * I13 / I2, k5 = eps * eps / (I1 * I2); \
    FOR_BLOCKS { \
        double u[LANES], v[LANES]; \
        long width = load(from, batch, first, u, v); \
        for (long n = 0; n < steps; n++) \
            FOR_LANES { \
                double p = u[l], q = v[l]; \
                double delta = (1 + k1 * q) * (1 - k2 * p) \
                    + k5 * (I13 * p / 2 + I23 * q) * (I13 * p + I23 * q / 2); \
                u[l] = p - k2 * p * p - k1 * p * q - k3 * q * q; \
                v[l] = q + k1 * q * q + k2 * p * q + k4 * p * p; \
                QUOTIENTS \
            } \
        unload(to, first, width, u, v); \
    }

void as_printed(ARGUMENTS) { PRINTED(u[l] /= delta; v[l] /= delta;) }
void as_printed_once(ARGUMENTS) { PRINTED(double r = 1 / delta; u[l] *= r; v[l] *= r;) }

/* X = eps x / sqrt(2a), Y = eps y / (2a): the parameter-free map. */
typedef struct { double x1, x2, y1, y2, w1x, w1y, w2x, w2y; } Frame;

static Frame frame(double I1, double I2, double I13, double I23, double eps)
{
    const double a = I1 * I2, D = I13 * I13 * I2 + I23 * I23 * I1;
    const double sx = eps / sqrt(2 * a), sy = eps / (2 * a);
    return (Frame){sx * I13, sx * I23, sy * I23 * I1, -sy * I13 * I2,
                   I13 * I2 / D / sx, I23 / D / sy, I23 * I1 / D / sx, -I13 / D / sy};
}

static void enter(Frame f, double *X, double *Y)
{
    FOR_LANES {
        double p = X[l], q = Y[l];
        X[l] = f.x1 * p + f.x2 * q;
        Y[l] = f.y1 * p + f.y2 * q;
    }
}

static inline void leave(Frame f, const double *X, const double *Y, double *u, double *v)
{
    FOR_LANES {
        u[l] = f.w1x * X[l] + f.w1y * Y[l];
        v[l] = f.w2x * X[l] + f.w2y * Y[l];
    }
}

static inline void advance(double *X, double *Y)
{
    FOR_LANES {
        double x = X[l] * (1 + Y[l]) / (1 - Y[l] + X[l] * X[l]);
        Y[l] -= X[l] * x;
        X[l] = x;
    }
}

/* Last states; ADVANCE takes steps of a block from step n on, and increases n. */
#define LAST(ADVANCE) { \
    const Frame f = frame(I1, I2, I13, I23, eps); \
    FOR_BLOCKS { \
        double X[LANES], Y[LANES], u[LANES], v[LANES]; \
        long width = load(from, batch, first, X, Y), n = 0; \
        enter(f, X, Y); \
        ADVANCE \
        for (; n < steps; n++) advance(X, Y); \
        leave(f, X, Y, u, v); \
        unload(to, first, width, u, v); \
    } \
}

void parameter_free(ARGUMENTS) LAST()

/* X = p/q, Y = s/q: steps without division, and one division after four steps. Half blocks keep
   p, s, q in registers. */
#define HALF (LANES / 2)
#define FOR_HALF for (int l = 0; l < HALF; l++)
static inline void four_steps(double *X, double *Y)
{
    double p[HALF], s[HALF], q[HALF];
    FOR_HALF p[l] = X[l], s[l] = Y[l], q[l] = 1;
    for (int k = 0; k < 4; k++)
        FOR_HALF {
            double t = q[l] - s[l], p2 = p[l] * p[l];
            p[l] = p[l] * (q[l] + s[l]);
            s[l] = s[l] * t - p2;
            q[l] = q[l] * t + p2;
        }
    FOR_HALF {
        double r = 1 / q[l];
        X[l] = p[l] * r;
        Y[l] = s[l] * r;
    }
}

void projective(ARGUMENTS) LAST(
    for (; n + 4 <= steps; n += 4) {
        four_steps(X, Y);
        four_steps(X + HALF, Y + HALF);
    })

/* All states, to[n][trajectory][component]; the batch is a multiple of 64. */
#define STORED(COPY) \
    const Frame f = frame(I1, I2, I13, I23, eps); \
    FOR_BLOCKS { \
        double X[LANES], Y[LANES], u[LANES], v[LANES], pairs[2 * LANES]; \
        load(from, batch, first, X, Y); \
        enter(f, X, Y); \
        for (long n = 0;; n++) { \
            double *row = to + 2 * (n * batch + first); \
            leave(f, X, Y, u, v); \
            FOR_LANES { \
                pairs[2 * l] = u[l]; \
                pairs[2 * l + 1] = v[l]; \
            } \
            COPY(row, pairs); \
            if (n == steps) break; \
            advance(X, Y); \
        } \
    }

#define PLAIN(to, from) memcpy(to, from, 2 * sizeof(double) * LANES)

void stored(ARGUMENTS) { STORED(PLAIN) }

/* `to` is at a multiple of 64 bytes. */
#if defined(__AVX512F__)
#define STREAM(to, from) for (int l = 0; l < 2 * LANES; l += 8) \
    _mm512_stream_pd(to + l, _mm512_loadu_pd(from + l))
#elif defined(__x86_64__)
#define STREAM(to, from) for (int l = 0; l < 2 * LANES; l += 2) \
    _mm_stream_pd(to + l, _mm_loadu_pd(from + l))
#endif
#if defined(STREAM)
void stored_streaming(ARGUMENTS) { STORED(STREAM) }
#endif

/* The map in n dimensions: the matrix A, Gaussian elimination with partial pivoting, one trajectory
   at a time. */
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

#define WIDE 32
#define FOR_WIDE for (int l = 0; l < WIDE; l++)

/* The same of 32 trajectories at once: an entry of A is a row of lanes. */
void eliminate_lanes(const double *from, double *to, long batch, long m, long steps,
                     const double *J, const double *I, double eps)
{
    static double A[128][129][WIDE], w[128][WIDE];
    for (long first = 0; first < batch; first += WIDE) {
        long width = batch - first < WIDE ? batch - first : WIDE;
        for (long i = 0; i < m; i++)
            FOR_WIDE w[i][l] = l < width ? from[(first + l) * m + i] : 0;
        for (long n = 0; n < steps; n++) {
            double p[WIDE] = {0}, r[WIDE], f[WIDE];
            for (long i = 0; i < m; i++)
                FOR_WIDE p[l] += I[i] * w[i][l];
            for (long i = 0; i < m; i++) {
                double h = eps / (2 * J[i]);
                for (long j = 0; j < m; j++)
                    FOR_WIDE A[i][j][l] = h * (2 * I[i] * w[j][l] - I[j] * w[i][l]);
                FOR_WIDE A[i][i][l] += 1 - h * p[l];
                FOR_WIDE A[i][m][l] = w[i][l];
            }
            for (long k = 0; k < m; k++) {
                FOR_WIDE {
                    long row = k;
                    for (long i = k + 1; i < m; i++)
                        if (fabs(A[i][k][l]) > fabs(A[row][k][l])) row = i;
                    if (row != k)
                        for (long j = k; j <= m; j++) {
                            double other = A[k][j][l];
                            A[k][j][l] = A[row][j][l];
                            A[row][j][l] = other;
                        }
                }
                FOR_WIDE r[l] = 1 / A[k][k][l];
                for (long i = k + 1; i < m; i++) {
                    FOR_WIDE f[l] = A[i][k][l] * r[l];
                    for (long j = k + 1; j <= m; j++)
                        FOR_WIDE A[i][j][l] -= f[l] * A[k][j][l];
                }
            }
            for (long i = m - 1; i >= 0; i--) {
                double s[WIDE];
                FOR_WIDE s[l] = A[i][m][l];
                for (long j = i + 1; j < m; j++)
                    FOR_WIDE s[l] -= A[i][j][l] * w[j][l];
                FOR_WIDE w[i][l] = s[l] / A[i][i][l];
            }
        }
        for (long i = 0; i < m; i++)
            for (int l = 0; l < width; l++) to[(first + l) * m + i] = w[i][l];
    }
}

/* The map in n dimensions in O(n), 32 trajectories at once: A is diagonal plus rank two, so that
   alpha = Omega.Omega~ and beta = I.Omega~ solve two equations. */
void rank2(const double *from, double *to, long batch, long m, long steps,
           const double *J, const double *I, double eps)
{
    static double w[256][WIDE], g[256][WIDE];
    for (long first = 0; first < batch; first += WIDE) {
        long width = batch - first < WIDE ? batch - first : WIDE;
        for (long i = 0; i < m; i++)
            FOR_WIDE w[i][l] = l < width ? from[(first + l) * m + i] : 0;
        for (long n = 0; n < steps; n++) {
            double p[WIDE] = {0}, ww[WIDE] = {0}, wwh[WIDE] = {0}, wI[WIDE] = {0};
            double wIh[WIDE] = {0}, IIh[WIDE] = {0}, alpha[WIDE], beta[WIDE];
            for (long i = 0; i < m; i++)
                FOR_WIDE p[l] += I[i] * w[i][l];
            for (long i = 0; i < m; i++) {
                double h = eps / (2 * J[i]), Ii = I[i];
                FOR_WIDE {
                    double x = w[i][l], r = 1 / (1 - h * p[l]), rx = r * x, rI = r * Ii;
                    g[i][l] = r;
                    ww[l] += rx * x;
                    wwh[l] += h * (rx * x);
                    wI[l] += rx * Ii;
                    wIh[l] += h * (rx * Ii);
                    IIh[l] += h * (rI * Ii);
                }
            }
            FOR_WIDE {
                double a = 1 + 2 * wIh[l], b = 1 - wIh[l];
                double r = 1 / (a * b + 2 * IIh[l] * wwh[l]);
                alpha[l] = (ww[l] * b + wwh[l] * wI[l]) * r;
                beta[l] = (a * wI[l] - 2 * IIh[l] * ww[l]) * r;
            }
            for (long i = 0; i < m; i++) {
                double h = eps / (2 * J[i]), h2I = 2 * h * I[i];
                FOR_WIDE w[i][l] = (w[i][l] * (1 + h * beta[l]) - h2I * alpha[l]) * g[i][l];
            }
        }
        for (long i = 0; i < m; i++)
            for (int l = 0; l < width; l++) to[(first + l) * m + i] = w[i][l];
    }
}
