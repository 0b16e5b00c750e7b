/* Interface between rowwise.c and its kernels, which are compiled once per SIMD level. */
#ifndef RSDEBLUR_ROWWISE_H
#define RSDEBLUR_ROWWISE_H

#include "rsdeblur_kernels.h"

/* Records of one tile of the normal matrix. */
#define RSD_TILE (RSD_BLOCK * RSD_BLOCK)

typedef struct {
    void (*forward)(const rsd_rowwise_model *, const float *table, const float *latent, float *data, size_t channels,
                    float *workspace);
    void (*adjoint)(const rsd_rowwise_model *, const float *table, const float *data, float *latent, size_t channels,
                    float *workspace);
    void (*assemble)(const rsd_rowwise_model *, const float *table, float *normal, float *workspace);
    /* Either with `table` and `data`, or with `normal`; the others are NULL. */
    void (*solve)(const rsd_rowwise_model *, const float *table, const float *normal, const float *penalty,
                  const float *data, float *latent, size_t channels, float *workspace);
} rsd_rowwise_kernels;

extern const rsd_rowwise_kernels rsd_rowwise_baseline;
#ifdef RSD_MULTIVERSIONING
extern const rsd_rowwise_kernels rsd_rowwise_avx2, rsd_rowwise_avx512;
#endif

/* Pairs of a row of a block and a picture row that sees it. */
static inline size_t rsd_rowwise_pairs(const rsd_rowwise_model *model, size_t block)
{
    return RSD_BLOCK * (size_t)(model->row_end[block] - model->row_first[block]);
}

/* Largest number of picture rows that see one block. */
size_t rsd_rowwise_reach(const rsd_rowwise_model *model);
/* Largest number of blocks from the first one that a block is coupled to up to the block itself. */
size_t rsd_rowwise_window(const rsd_rowwise_model *model);

#endif
