#include <string.h>

#include "internal.h"
#include "rsdeblur_kernels.h"

const char *rsd_status_message(rsd_status status)
{
    switch (status) {
    case RSD_OK:
        return "success";
    case RSD_NULL:
        return "null pointer for an array that is not empty";
    case RSD_SIZE:
        return "a size overflows, or a stride is shorter than the line it spans";
    case RSD_MODEL:
        return "the tables of the rowwise model are inconsistent";
    }
    return "unknown status";
}

const char *rsd_simd_level(void)
{
#ifdef RSD_MULTIVERSIONING
    if (__builtin_cpu_supports("avx512f"))
        return "avx512f";
    if (__builtin_cpu_supports("avx2"))
        return "avx2";
#endif
    return "baseline";
}

RSD_CLONES
static void multiply(float *restrict spectrum, const float *restrict response, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const float re = spectrum[2 * i], im = spectrum[2 * i + 1];
        const float response_re = response[2 * i], response_im = response[2 * i + 1];
        spectrum[2 * i] = re * response_re - im * response_im;
        spectrum[2 * i + 1] = re * response_im + im * response_re;
    }
}

rsd_status rsd_spectral_multiply(float *spectra, const float *response, size_t channels, size_t n)
{
    if (channels == 0 || n == 0)
        return RSD_OK;
    if (spectra == NULL || response == NULL)
        return RSD_NULL;
    if (n > PTRDIFF_MAX / 2 || !rsd_addressable(channels, 2 * n))
        return RSD_SIZE;
    for (size_t c = 0; c < channels; c++)
        multiply(spectra + c * 2 * n, response, n);
    return RSD_OK;
}

RSD_CLONES
static void add_weighted(float *restrict accumulator, const float *restrict line, const float *restrict weights,
                         size_t n)
{
    for (size_t i = 0; i < n; i++) {
        accumulator[2 * i] += weights[i] * line[2 * i];
        accumulator[2 * i + 1] += weights[i] * line[2 * i + 1];
    }
}

rsd_status rsd_blend_lines(float *accumulator, const float *slab, const float *weights, size_t lines, size_t n,
                           size_t accumulator_stride, size_t slab_stride)
{
    if (lines == 0 || n == 0)
        return RSD_OK;
    if (accumulator == NULL || slab == NULL || weights == NULL)
        return RSD_NULL;
    if (n > PTRDIFF_MAX / 2 || accumulator_stride > PTRDIFF_MAX / 2 || slab_stride > PTRDIFF_MAX / 2 ||
        !rsd_addressable(lines, 2 * accumulator_stride) || !rsd_addressable(lines, 2 * slab_stride))
        return RSD_SIZE;
    if (lines > 1 && (accumulator_stride < n || slab_stride < n))
        return RSD_SIZE;
    for (size_t l = 0; l < lines; l++)
        add_weighted(accumulator + 2 * l * accumulator_stride, slab + 2 * l * slab_stride, weights, n);
    return RSD_OK;
}

/* Copy complex values in reverse order. */
RSD_CLONES
static void reverse(const float *restrict from, float *restrict to, size_t n)
{
    for (size_t k = 0; k < n; k++) {
        uint64_t value;
        memcpy(&value, from + 2 * (n - 1 - k), sizeof value);
        memcpy(to + 2 * k, &value, sizeof value);
    }
}

/* out[k] = ((z[k] + conj r[k]) - i turns[k] (z[k] - conj r[k])) / 2, where `out` holds r. */
RSD_CLONES
static void unpair_inner(const float *restrict z, const float *restrict turns, float *restrict out, size_t n)
{
    for (size_t k = 0; k < n; k++) {
        const float even_re = z[2 * k] + out[2 * k], even_im = z[2 * k + 1] - out[2 * k + 1];
        const float odd_re = z[2 * k + 1] + out[2 * k + 1], odd_im = out[2 * k] - z[2 * k];
        const float re = turns[2 * k], im = turns[2 * k + 1];
        out[2 * k] = 0.5f * (even_re + (re * odd_re - im * odd_im));
        out[2 * k + 1] = 0.5f * (even_im + (re * odd_im + im * odd_re));
    }
}

/* out[k] = (x[k] + conj r[k]) + i conj turns[k] (x[k] - conj r[k]), where `out` holds r. */
RSD_CLONES
static void pair_inner(const float *restrict x, const float *restrict turns, float *restrict out, size_t n)
{
    for (size_t k = 0; k < n; k++) {
        const float even_re = x[2 * k] + out[2 * k], even_im = x[2 * k + 1] - out[2 * k + 1];
        const float odd_re = x[2 * k] - out[2 * k], odd_im = x[2 * k + 1] + out[2 * k + 1];
        const float re = turns[2 * k], im = turns[2 * k + 1];
        out[2 * k] = even_re - (re * odd_im - im * odd_re);
        out[2 * k + 1] = even_im + (re * odd_re + im * odd_im);
    }
}

/* Check `lines` lines of n pairs, and of `stride` values, which hold their spectra. */
static rsd_status check_pairs(const float *pairs, const float *turns, const float *spectra, size_t lines, size_t n,
                              size_t stride)
{
    if (pairs == NULL || turns == NULL || spectra == NULL)
        return RSD_NULL;
    if (stride <= n || stride > PTRDIFF_MAX / 2 || !rsd_addressable(lines, 2 * stride))
        return RSD_SIZE;
    return RSD_OK;
}

rsd_status rsd_unpair(const float *pairs, const float *turns, float *spectra, size_t lines, size_t n, size_t stride)
{
    if (lines == 0 || n == 0)
        return RSD_OK;
    const rsd_status status = check_pairs(pairs, turns, spectra, lines, n, stride);
    for (size_t l = 0; status == RSD_OK && l < lines; l++) {
        const float *z = pairs + 2 * l * n;
        float *out = spectra + 2 * l * stride;
        reverse(z + 2, out + 2, n - 1);
        unpair_inner(z + 2, turns + 2, out + 2, n - 1);
        out[0] = z[0] + z[1];
        out[2 * n] = z[0] - z[1];
        out[1] = out[2 * n + 1] = 0.0f;
        memset(out + 2 * (n + 1), 0, 2 * (stride - n - 1) * sizeof *out);
    }
    return status;
}

rsd_status rsd_pair(const float *spectra, const float *turns, float *pairs, size_t lines, size_t n, size_t stride)
{
    if (lines == 0 || n == 0)
        return RSD_OK;
    const rsd_status status = check_pairs(pairs, turns, spectra, lines, n, stride);
    for (size_t l = 0; status == RSD_OK && l < lines; l++) {
        const float *x = spectra + 2 * l * stride;
        float *out = pairs + 2 * l * n;
        reverse(x + 2, out + 2, n - 1);
        pair_inner(x + 2, turns + 2, out + 2, n - 1);
        out[0] = x[0] + x[2 * n];
        out[1] = x[0] - x[2 * n];
    }
    return status;
}
