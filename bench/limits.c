/* The limits of the machine: divisions and stores, a part on each thread. */
#if defined(__x86_64__)
#include <immintrin.h>
#endif
#define PARTS _Pragma("omp parallel for schedule(static) num_threads(threads)")

/* Independent divisions, 64 side by side: nothing to wait for but the divider. Each quotient is
   divided again, so that none can be left out; a denominator of 1 + 2^-40 keeps them in range. */
void divide(double *to, long blocks, long rounds, long threads)
{
    PARTS for (long block = 0; block < blocks; block++) {
        double q[64], sum = 0;
        const double d = 1 + 0x1p-40 * (block + 1);
        for (int l = 0; l < 64; l++) q[l] = 1 + l;
        for (long n = 0; n < rounds; n++)
            for (int l = 0; l < 64; l++) q[l] = q[l] / d;
        for (int l = 0; l < 64; l++) sum += q[l];
        to[block] = sum;
    }
}

void plain(double *to, long size, long threads)
{
    PARTS for (long i = 0; i < size; i++) to[i] = 1.0;
}

/* The same past the caches. `to` is at a multiple of 64 bytes, `size` a multiple of 8. */
#if defined(__AVX512F__)
void streaming(double *to, long size, long threads)
{
    PARTS for (long i = 0; i < size; i += 8) _mm512_stream_pd(to + i, _mm512_set1_pd(1.0));
}
#elif defined(__x86_64__)
void streaming(double *to, long size, long threads)
{
    PARTS for (long i = 0; i < size; i += 2) _mm_stream_pd(to + i, _mm_set1_pd(1.0));
}
#endif
