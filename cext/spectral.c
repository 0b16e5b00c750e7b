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
