/* Functions of the C test programs. Every array is allocated with its exact size, so that sanitizers and valgrind
 * detect any access beyond it. */
#ifndef RSDEBLUR_CHECK_H
#define RSDEBLUR_CHECK_H

#include "rsdeblur_kernels.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int failures = 0;

#define CHECK(condition)                                                                                               \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            fprintf(stderr, "%s:%d: failed: %s\n", __FILE__, __LINE__, #condition);                                    \
            failures++;                                                                                                \
        }                                                                                                              \
    } while (0)

/* `n` deterministic floats in [-1, 1). */
static float *noise(size_t n, unsigned seed)
{
    float *values = malloc((n ? n : 1) * sizeof *values);
    if (values == NULL)
        abort();
    for (size_t i = 0; i < n; i++) {
        seed = seed * 1664525u + 1013904223u;
        values[i] = (float)(seed >> 8) / 8388608.0f - 1.0f;
    }
    return values;
}

#endif
