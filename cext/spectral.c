#include <float.h>
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
        return "a table is inconsistent: positions outside an array, or in a wrong order";
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

/* Values of each channel that are worked on together: those of several arrays stay in the first-level cache. */
#define CHUNK 256

RSD_CLONES
static void add_power(const float *restrict otf, float share, const bool first, float *restrict power, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const float re = otf[2 * i], im = otf[2 * i + 1], here = share * (re * re + im * im);
        power[i] = first ? here : power[i] + here;
    }
}

RSD_CLONES
static void add_signal(const float *restrict otf, const float *restrict spectrum, float share, const bool first,
                       float *restrict signal, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const float h_re = otf[2 * i], h_im = otf[2 * i + 1], g_re = spectrum[2 * i], g_im = spectrum[2 * i + 1];
        const float re = share * (h_re * g_re + h_im * g_im), im = share * (h_re * g_im - h_im * g_re);
        signal[2 * i] = first ? re : signal[2 * i] + re;
        signal[2 * i + 1] = first ? im : signal[2 * i + 1] + im;
    }
}

rsd_status rsd_add_normal(const float *spectra, const float *otf, float share, int first, float *signal, float *power,
                          size_t channels, size_t n)
{
    if (channels == 0 || n == 0)
        return RSD_OK;
    if (spectra == NULL || otf == NULL || signal == NULL || power == NULL)
        return RSD_NULL;
    if (n > PTRDIFF_MAX / 2 || !rsd_addressable(channels, 2 * n))
        return RSD_SIZE;
    for (size_t i = 0; i < n; i += CHUNK) {
        const size_t count = n - i < CHUNK ? n - i : CHUNK;
        add_power(otf + 2 * i, share, first, power + i, count);
        for (size_t c = 0; c < channels; c++)
            add_signal(otf + 2 * i, spectra + 2 * (c * n + i), share, first, signal + 2 * (c * n + i), count);
    }
    return RSD_OK;
}

/* Compute scale / (power + ridge + c1 d + c2 d^2), d = across + down. */
RSD_CLONES
static void find_gains(const float *restrict power, const float *restrict down, float across, float ridge,
                       const float *restrict coupling, float scale, float *restrict gains, size_t n)
{
    const float gradient = coupling[1], bend = coupling[2];
    for (size_t i = 0; i < n; i++) {
        const float squared = across + down[i];
        const float normal = power[i] + ridge + squared * (gradient + squared * bend);
        /* Frequencies that no PSF passes and no prior restores contain no signal. */
        gains[i] = scale / (normal < FLT_MIN ? FLT_MIN : normal);
    }
}

/* spectrum = gains (norm signal + pull spectrum) */
RSD_CLONES
static void combine(const float *restrict signal, const float *restrict gains, float norm, float pull,
                    float *restrict spectrum, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        spectrum[2 * i] = gains[i] * (norm * signal[2 * i] + pull * spectrum[2 * i]);
        spectrum[2 * i + 1] = gains[i] * (norm * signal[2 * i + 1] + pull * spectrum[2 * i + 1]);
    }
}

rsd_status rsd_solve_normal(const float *signal, const float *power, rsd_prior prior, float scale, float *spectra,
                            size_t channels, size_t columns, size_t length)
{
    if (channels == 0 || columns == 0 || length == 0)
        return RSD_OK;
    if (signal == NULL || power == NULL || prior.coupling == NULL || prior.across == NULL || prior.down == NULL ||
        spectra == NULL)
        return RSD_NULL;
    if (!rsd_addressable(columns, length) || columns * length > PTRDIFF_MAX / 2 ||
        !rsd_addressable(channels, 2 * columns * length))
        return RSD_SIZE;
    const float ridge = prior.nsr + prior.coupling[0];
    float gains[CHUNK];
    for (size_t k = 0; k < columns; k++)
        for (size_t i = 0; i < length; i += CHUNK) {
            const size_t count = length - i < CHUNK ? length - i : CHUNK;
            find_gains(power + k * length + i, prior.down + i, prior.across[k], ridge, prior.coupling, scale, gains,
                       count);
            for (size_t c = 0; c < channels; c++) {
                const size_t at = 2 * ((c * columns + k) * length + i);
                combine(signal + at, gains, 1.0f + prior.nsr, prior.pull, spectra + at, count);
            }
        }
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
