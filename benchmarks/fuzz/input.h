/* Numbers and arrays made of the bytes of a fuzzed input. */
#ifndef RSDEBLUR_FUZZ_INPUT_H
#define RSDEBLUR_FUZZ_INPUT_H

#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    const uint8_t *data;
    size_t size;
} rsd_input;

/* Return the next byte; 0 at the end. */
static inline uint8_t next(rsd_input *input)
{
    if (input->size == 0)
        return 0;
    input->size--;
    return *input->data++;
}

/* Return 0 to most - 1. */
static inline size_t below(rsd_input *input, size_t most)
{
    return next(input) % most;
}

/* Return `usual`, or rarely a number of floats that no memory can contain. */
static inline size_t or_huge(rsd_input *input, size_t usual)
{
    const size_t huge[] = {SIZE_MAX, SIZE_MAX / 2, SIZE_MAX / 4 + 1, PTRDIFF_MAX, (size_t)1 << 62, (size_t)1 << 61};
    const uint8_t choice = next(input);
    return choice >= 250 ? huge[choice - 250] : usual;
}

/* Return an array of exactly `n` floats, so that a sanitizer sees each access beyond it; any bits may occur. */
static inline float *floats(rsd_input *input, size_t n)
{
    /* Few inputs are as long as their arrays, so the bytes are repeated. */
    uint8_t pattern[64];
    for (size_t i = 0; i < sizeof pattern; i++)
        pattern[i] = next(input);
    float *values = malloc(n * sizeof *values);
    if (values == NULL)
        abort();
    uint8_t *bytes = (uint8_t *)values;
    for (size_t i = 0; i < n * sizeof *values; i++)
        bytes[i] = pattern[i % sizeof pattern];
    return values;
}

/* Return a copy of an array. */
static inline float *copied(const float *values, size_t n)
{
    float *copy = malloc(n * sizeof *copy);
    if (copy == NULL)
        abort();
    if (n > 0)
        memcpy(copy, values, n * sizeof *copy);
    return copy;
}

/* A refused call must have written nothing. Frees the copy. */
static inline void check_refused(int refused, const float *values, float *copy, size_t n)
{
    if (refused && n > 0 && memcmp(values, copy, n * sizeof *copy) != 0)
        abort();
    free(copy);
}

#endif
