/* What the machine can do at most: divisions, and stores. */
#include <stddef.h>
#include <string.h>
#if defined(__x86_64__)
#include <immintrin.h>
#endif

/* Independent divisions, 64 side by side: nothing to wait for but the divider. Each quotient is
   divided again, so that none can be left out; a denominator of 1 + 2^-40 keeps them in range. */
double divide(long blocks, long rounds, int threads)
{
    double sum = 0;
    #pragma omp parallel for schedule(static) num_threads(threads) reduction(+ : sum)
    for (long block = 0; block < blocks; block++) {
        double q[64];
        const double d = 1 + 0x1p-40 * (block + 1);
        for (int l = 0; l < 64; l++) q[l] = 1 + l;
        for (long n = 0; n < rounds; n++)
            for (int l = 0; l < 64; l++) q[l] = q[l] / d;
        for (int l = 0; l < 64; l++) sum += q[l];
    }
    return sum;
}

void store(double *to, long size, double value, int threads)
{
    #pragma omp parallel for schedule(static) num_threads(threads)
    for (long i = 0; i < size; i++) to[i] = value;
}

/* The same past the caches. `to` is at a multiple of 64 bytes, `size` a multiple of 8. */
#if defined(__AVX512F__)
void store_streaming(double *to, long size, double value, int threads)
{
    #pragma omp parallel for schedule(static) num_threads(threads)
    for (long i = 0; i < size; i += 8) _mm512_stream_pd(to + i, _mm512_set1_pd(value));
}
#elif defined(__x86_64__)
void store_streaming(double *to, long size, double value, int threads)
{
    #pragma omp parallel for schedule(static) num_threads(threads)
    for (long i = 0; i < size; i += 2) _mm_stream_pd(to + i, _mm_set1_pd(value));
}
#endif

/* Memory to memory, a part on each thread. */
void copy(const double *from, double *to, long size, int threads)
{
    #pragma omp parallel for schedule(static) num_threads(threads)
    for (int part = 0; part < threads; part++) {
        long begin = size * part / threads, end = size * (part + 1) / threads;
        memcpy(to + begin, from + begin, sizeof(double) * (end - begin));
    }
}
