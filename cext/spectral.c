#include "rsdeblur_kernels.h"

#include <stdbool.h>
#include <stdint.h>

/* The build sets RSD_MULTIVERSIONING where the compiler and the C library support it (see meson.build). */
#ifdef RSD_MULTIVERSIONING
#define RSD_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define RSD_CLONES
#endif

const char *rsd_status_message(rsd_status status)
{
    switch (status) {
    case RSD_OK:
        return "success";
    case RSD_NULL:
        return "null pointer for an array that is not empty";
    case RSD_SIZE:
        return "a size overflows, or a stride is shorter than the rows it spans";
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

/* Whether an array of a x b floats can be addressed. */
static bool addressable(size_t a, size_t b)
{
    return b == 0 || a <= PTRDIFF_MAX / sizeof(float) / b;
}

RSD_CLONES
static void multiply(float *restrict spectrum, const float *restrict filter, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const float re = spectrum[2 * i], im = spectrum[2 * i + 1];
        const float filter_re = filter[2 * i], filter_im = filter[2 * i + 1];
        spectrum[2 * i] = re * filter_re - im * filter_im;
        spectrum[2 * i + 1] = re * filter_im + im * filter_re;
    }
}

rsd_status rsd_spectral_multiply(float *spectra, const float *filter, size_t channels, size_t n)
{
    if (channels == 0 || n == 0)
        return RSD_OK;
    if (spectra == NULL || filter == NULL)
        return RSD_NULL;
    if (n > PTRDIFF_MAX / 2 || !addressable(channels, 2 * n))
        return RSD_SIZE;
    for (size_t c = 0; c < channels; c++)
        multiply(spectra + c * 2 * n, filter, n);
    return RSD_OK;
}

RSD_CLONES
static void add_scaled(float *restrict accumulator, const float *restrict row, float weight, size_t n)
{
    for (size_t i = 0; i < n; i++)
        accumulator[i] += weight * row[i];
}

rsd_status rsd_blend_rows(float *accumulator, const float *slab, const float *weights, size_t channels, size_t rows,
                          size_t row_floats, size_t accumulator_stride, size_t slab_stride)
{
    if (channels == 0 || rows == 0 || row_floats == 0)
        return RSD_OK;
    if (accumulator == NULL || slab == NULL || weights == NULL)
        return RSD_NULL;
    if (!addressable(rows, row_floats) || !addressable(channels, accumulator_stride) ||
        !addressable(channels, slab_stride))
        return RSD_SIZE;
    if (channels > 1 && (accumulator_stride < rows * row_floats || slab_stride < rows * row_floats))
        return RSD_SIZE;
    for (size_t c = 0; c < channels; c++)
        for (size_t i = 0; i < rows; i++)
            add_scaled(accumulator + c * accumulator_stride + i * row_floats, slab + c * slab_stride + i * row_floats,
                       weights[i], row_floats);
    return RSD_OK;
}
