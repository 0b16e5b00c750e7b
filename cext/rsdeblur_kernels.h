/*
 * Numeric kernels of rsdeblur, free of Python.
 *
 * Arrays are dense, row before column, in the machine's own float32. A complex value is two floats, real part first.
 * Sizes count the elements named in each comment. The caller owns all memory, before and after; nothing is allocated,
 * kept or freed here. Arrays of one call must not overlap. Functions are thread-safe on distinct outputs. A zero size
 * is allowed and does nothing. Unless RSD_OK is returned, nothing was written.
 *
 * Every SIMD level gives the same bits: no operation is reordered or contracted.
 */
#ifndef RSDEBLUR_KERNELS_H
#define RSDEBLUR_KERNELS_H

#include <stddef.h>

typedef enum {
    RSD_OK = 0,
    RSD_NULL = 1, /* a pointer is null although its array is not empty */
    RSD_SIZE = 2  /* a size overflows, or a stride is shorter than the line it spans */
} rsd_status;

/* One line of English for a status; never null, static memory. */
const char *rsd_status_message(rsd_status status);

/* Instruction set in use on this machine: "avx512f", "avx2" or "baseline" (what the compiler targets by default). */
const char *rsd_simd_level(void);

/*
 * Multiply every channel of a spectrum by one filter, in place: spectra[c, i] *= filter[i].
 *
 * spectra   channels x n complex
 * filter    n complex
 */
rsd_status rsd_spectral_multiply(float *spectra, const float *filter, size_t channels, size_t n);

/*
 * Add weighted lines of a slab to an accumulator: accumulator[l, i] += weights[i] * slab[l, i].
 *
 * accumulator  the first complex value to change in line 0; line l starts l * accumulator_stride complex values further
 * slab         the first complex value to read in line 0; line l starts l * slab_stride complex values further
 * weights      n floats
 */
rsd_status rsd_blend_lines(float *accumulator, const float *slab, const float *weights, size_t lines, size_t n,
                           size_t accumulator_stride, size_t slab_stride);

#endif
