/* Definitions shared by the kernels; not part of their interface. */
#ifndef RSDEBLUR_INTERNAL_H
#define RSDEBLUR_INTERNAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* The build sets RSD_MULTIVERSIONING where the compiler and the C library support it (see meson.build). */
#ifdef RSD_MULTIVERSIONING
#define RSD_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define RSD_CLONES
#endif

/* Whether an array of a x b floats can be addressed. */
static inline bool rsd_addressable(size_t a, size_t b)
{
    return b == 0 || a <= PTRDIFF_MAX / sizeof(float) / b;
}

#endif
