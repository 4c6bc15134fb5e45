/* End values in 113 bits, by the linearly implicit rule of Euler, extrapolated to order 11.

`standard.py` puts `#define D ...` and `static void rates(const Q *x, Q *out)` in the place of RATES;
the last component is the time. Arguments: the end, and the components of the start. */
#include <quadmath.h>
#include <stdio.h>
#include <stdlib.h>
typedef __float128 Q;
#define sqrt sqrtq
#define sin sinq
#define cos cosq
#define exp expq
#define pow powq

RATES

#define K 11
static const int SUBSTEPS[K] = {2, 3, 4, 6, 8, 12, 16, 24, 32, 44, 60};
static const Q ALLOWED = 1e-17Q, SMALL = 1e-16Q; /* of a component, and of its largest modulus */

static void eliminate(Q A[D][D], int *pivots)
{
    for (int k = 0; k < D; k++) {
        int most = k;
        for (int i = k + 1; i < D; i++)
            if (fabsq(A[i][k]) > fabsq(A[most][k]))
                most = i;
        pivots[k] = most;
        for (int j = 0; j < D; j++) {
            Q kept = A[k][j];
            A[k][j] = A[most][j];
            A[most][j] = kept;
        }
        for (int i = k + 1; i < D; i++) {
            A[i][k] /= A[k][k];
            for (int j = k + 1; j < D; j++)
                A[i][j] -= A[i][k] * A[k][j];
        }
    }
}

static void solve(Q A[D][D], const int *pivots, Q *b)
{
    for (int k = 0; k < D; k++) {
        Q kept = b[k];
        b[k] = b[pivots[k]];
        b[pivots[k]] = kept;
    }
    for (int k = 0; k < D; k++)
        for (int i = k + 1; i < D; i++)
            b[i] -= A[i][k] * b[k];
    for (int k = D - 1; k >= 0; k--) {
        for (int j = k + 1; j < D; j++)
            b[k] -= A[k][j] * b[j];
        b[k] /= A[k][k];
    }
}

int main(int count, char **arguments)
{
    Q end = strtoflt128(arguments[1], 0), x[D], largest[D], weights[K], differences[K];
    for (int i = 0; i < D; i++) {
        x[i] = strtod(arguments[2 + i], 0);
        largest[i] = fabsq(x[i]);
    }
    for (int c = 0; c < K; c++) { /* the last weights, minus those without the first column */
        Q others = c ? 1 : 0;
        weights[c] = 1;
        for (int b = 0; b < K; b++)
            if (b != c) {
                Q factor = (Q)SUBSTEPS[c] / (SUBSTEPS[c] - SUBSTEPS[b]);
                weights[c] *= factor;
                others *= b ? factor : 1;
            }
        differences[c] = weights[c] - others;
    }
    Q h = end * 1e-8Q;
    while (x[D - 1] < end) {
        static Q slopes[D][D], A[D][D];
        Q f[D], now[D], changed[D], step[D], error[D], ratio = 0, left = end - x[D - 1];
        int is_last = h >= left, pivots[D];
        if (is_last)
            h = left;
        rates(x, f);
        for (int j = 0; j < D; j++) {
            Q change = 1e-16Q * (fabsq(x[j]) + 1e-6Q * largest[j] + 1e-30Q);
            for (int i = 0; i < D; i++)
                now[i] = x[i] + (i == j) * change;
            rates(now, changed);
            for (int i = 0; i < D; i++)
                slopes[i][j] = (changed[i] - f[i]) / change;
        }
        for (int i = 0; i < D; i++)
            step[i] = error[i] = 0;
        for (int c = 0; c < K; c++) {
            Q part = h / SUBSTEPS[c], moved[D];
            for (int i = 0; i < D; i++) {
                moved[i] = 0;
                for (int j = 0; j < D; j++)
                    A[i][j] = (i == j) - part * slopes[i][j];
            }
            eliminate(A, pivots);
            for (int m = 0; m < SUBSTEPS[c]; m++) {
                for (int i = 0; i < D; i++)
                    now[i] = x[i] + moved[i];
                rates(now, changed);
                for (int i = 0; i < D; i++)
                    changed[i] *= part;
                solve(A, pivots, changed);
                for (int i = 0; i < D; i++)
                    moved[i] += changed[i];
            }
            for (int i = 0; i < D; i++) {
                step[i] += weights[c] * moved[i];
                error[i] += differences[c] * moved[i];
            }
        }
        int is_finite = 1;
        for (int i = 0; i < D; i++) {
            Q allowed = ALLOWED * (fabsq(x[i] + step[i]) + SMALL * largest[i]) + 1e-40Q;
            Q own = fabsq(error[i]) / allowed;
            is_finite &= finiteq(own);
            ratio = own > ratio ? own : ratio;
        }
        Q factor = is_finite ? 0.8Q * powq(ratio + 1e-30Q, -1.0Q / K) : 0.2Q;
        if (is_finite && ratio <= 1) {
            for (int i = 0; i < D; i++) {
                x[i] += step[i];
                largest[i] = fabsq(x[i]) > largest[i] ? fabsq(x[i]) : largest[i];
            }
            if (is_last)
                x[D - 1] = end;
        } else if (factor > 0.9Q)
            factor = 0.9Q;
        h *= factor > 4 ? 4 : factor < 0.2Q ? 0.2Q : factor;
        if (!(h > end * 1e-30Q))
            return 1;
    }
    for (int i = 0; i < D - 1; i++)
        printf("%.17g\n", (double)x[i]);
    return 0;
}
