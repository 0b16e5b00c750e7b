/* What rowwise.c and its kernels, compiled once per SIMD level, share. */
#ifndef RSDEBLUR_ROWWISE_H
#define RSDEBLUR_ROWWISE_H

#include "rsdeblur_kernels.h"

typedef struct {
    void (*forward)(const rsd_rowwise_model *, const float *table, const float *latent, float *data, size_t channels,
                    float *workspace);
    void (*adjoint)(const rsd_rowwise_model *, const float *table, const float *data, float *latent, size_t channels,
                    float *workspace);
    void (*solve)(const rsd_rowwise_model *, const float *table, const float *ridge, float smooth, const float *data,
                  float *latent, size_t channels, float *workspace);
} rsd_rowwise_kernels;

extern const rsd_rowwise_kernels rsd_rowwise_baseline;
#ifdef RSD_MULTIVERSIONING
extern const rsd_rowwise_kernels rsd_rowwise_avx2, rsd_rowwise_avx512;
#endif

/* Most picture rows that see one block, and most blocks from the first that one is coupled to up to itself. */
size_t rsd_rowwise_reach(const rsd_rowwise_model *model);
size_t rsd_rowwise_window(const rsd_rowwise_model *model);

#endif
