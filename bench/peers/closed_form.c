/* State n by the theorem of Section 4, for x != 0 and t < 1. Compiled with -ffast-math, without
   which gcc calls exp and log for one number at a time. */
#include <math.h>

void jump(const double *restrict from, double *restrict to, long batch, double n, double I1,
          double I2, double I13, double I23, double eps, int threads)
{
    const double a = I1 * I2, D = I13 * I13 * I2 + I23 * I23 * I1;
    #pragma omp parallel for simd schedule(static) num_threads(threads)
    for (long i = 0; i < batch; i++) {
        double w1 = from[2 * i], w2 = from[2 * i + 1];
        double x = I13 * w1 + I23 * w2, y = I23 * I1 * w1 - I13 * I2 * w2;
        double h = (a * x * x + y * y) / (4 * a + eps * eps * x * x);
        double t = eps * sqrt(h / a), q = sqrt(a - h * eps * eps), z = y / (fabs(x) * q);
        double turn = log(fabs(z) + sqrt(z * z + 1));
        double s = (z < 0 ? -turn : turn) - n * log((1 + t) / (1 - t));
        double root = exp(-fabs(s)), e = root * root, scale = 2 * sqrt(h * a) / D;
        double tanh = (s < 0 ? e - 1 : 1 - e) / (1 + e);
        double X = (x < 0 ? -2 : 2) * scale * root / (q * (1 + e)), Y = scale * tanh;
        to[2 * i] = I13 * I2 * X + I23 * Y;
        to[2 * i + 1] = I23 * I1 * X - I13 * Y;
    }
}
