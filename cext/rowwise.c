/* Entry points of the rowwise kernels: checks, and the choice of the SIMD level. */
#include "rowwise.h"

#include <stdbool.h>

#include "internal.h"

size_t rsd_rowwise_reach(const rsd_rowwise_model *model)
{
    size_t reach = 0;
    for (size_t b = 0; b < model->blocks; b++) {
        const size_t rows = (size_t)(model->row_end[b] - model->row_first[b]);
        reach = rows > reach ? rows : reach;
    }
    return reach;
}

size_t rsd_rowwise_window(const rsd_rowwise_model *model)
{
    size_t window = 0;
    for (size_t b = 0; b < model->blocks; b++) {
        const size_t coupled = b - (size_t)model->coupled[b] + 1;
        window = coupled > window ? coupled : window;
    }
    return window;
}

/* Whether every index that the kernels use is within its table. */
static bool valid(const rsd_rowwise_model *model)
{
    size_t pairs = 0;
    for (size_t b = 0; b < model->blocks; b++) {
        const int32_t first = model->row_first[b], end = model->row_end[b], coupled = model->coupled[b];
        if (first < 0 || end < first || (size_t)end > model->rows || coupled < 0 || (size_t)coupled > b)
            return false;
        pairs += rsd_rowwise_pairs(model, b);
    }
    if (model->tap_start[0] != 0 || (size_t)model->tap_start[pairs] != model->taps)
        return false;
    for (size_t p = 0; p < pairs; p++)
        if (model->tap_start[p] > model->tap_start[p + 1])
            return false;
    for (size_t t = 0; t < model->taps; t++)
        if (model->tap_shift[t] < 0 || (size_t)model->tap_shift[t] >= model->phases)
            return false;
    return true;
}

size_t rsd_rowwise_workspace(const rsd_rowwise_model *model, int solve)
{
    if (model->blocks == 0 || !valid(model))
        return 0;
    const size_t reach = rsd_rowwise_reach(model);
    if (!rsd_addressable(reach, RSD_BLOCK * RSD_RECORD) || !rsd_addressable(model->blocks, RSD_TILE * RSD_RECORD))
        return 0;
    const size_t columns = reach * RSD_BLOCK * RSD_RECORD;
    if (!solve)
        return columns;
    /* The columns of A for a window of blocks, and the factor, whose rows are as long as the window. */
    const size_t window = rsd_rowwise_window(model), each = columns + model->blocks * RSD_TILE * RSD_RECORD;
    return rsd_addressable(window, each) ? window * each : 0;
}

size_t rsd_rowwise_assembled_size(const rsd_rowwise_model *model)
{
    size_t tiles = 0;
    if (!valid(model))
        return 0;
    for (size_t b = 0; b < model->blocks; b++) {
        tiles += b - (size_t)model->coupled[b] + 1;
        if (!rsd_addressable(tiles, RSD_TILE * RSD_RECORD))
            return 0;
    }
    return tiles * RSD_TILE * RSD_RECORD;
}

static const rsd_rowwise_kernels *kernels(void)
{
#ifdef RSD_MULTIVERSIONING
    if (__builtin_cpu_supports("avx512f"))
        return &rsd_rowwise_avx512;
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        return &rsd_rowwise_avx2;
#endif
    return &rsd_rowwise_baseline;
}

static rsd_status check(const rsd_rowwise_model *model, const void *a, const void *b, const void *c, size_t channels,
                        const void *workspace)
{
    if (a == NULL || b == NULL || c == NULL || workspace == NULL)
        return RSD_NULL;
    if (model->rows > PTRDIFF_MAX / sizeof(float) / RSD_RECORD / channels ||
        model->blocks > PTRDIFF_MAX / sizeof(float) / RSD_RECORD / RSD_BLOCK / channels)
        return RSD_SIZE;
    return valid(model) ? RSD_OK : RSD_MODEL;
}

rsd_status rsd_rowwise_forward(const rsd_rowwise_model *model, const float *table, const float *latent, float *data,
                               size_t channels, float *workspace)
{
    if (channels == 0 || model->rows == 0 || model->blocks == 0)
        return RSD_OK;
    const rsd_status status = check(model, table, data, latent, channels, workspace);
    if (status == RSD_OK)
        kernels()->forward(model, table, latent, data, channels, workspace);
    return status;
}

rsd_status rsd_rowwise_adjoint(const rsd_rowwise_model *model, const float *table, const float *data, float *latent,
                               size_t channels, float *workspace)
{
    if (channels == 0 || model->rows == 0 || model->blocks == 0)
        return RSD_OK;
    const rsd_status status = check(model, table, data, latent, channels, workspace);
    if (status == RSD_OK)
        kernels()->adjoint(model, table, data, latent, channels, workspace);
    return status;
}

/* Whether the differences of `penalty` couple only blocks that the model couples. */
static bool holds_differences(const rsd_rowwise_model *model, const float *penalty)
{
    bool couples = false;
    for (size_t i = RSD_LANES; i < RSD_PENALTY; i++)
        couples = couples || penalty[i] != 0.0f;
    for (size_t b = 1; b < model->blocks; b++)
        if (couples && (size_t)model->coupled[b] == b)
            return false;
    return true;
}

rsd_status rsd_rowwise_solve(const rsd_rowwise_model *model, const float *table, const float *penalty,
                             const float *data, float *latent, size_t channels, float *workspace)
{
    if (channels == 0 || model->rows == 0 || model->blocks == 0)
        return RSD_OK;
    if (penalty == NULL)
        return RSD_NULL;
    const rsd_status status = check(model, table, data, latent, channels, workspace);
    if (status != RSD_OK)
        return status;
    if (!holds_differences(model, penalty))
        return RSD_MODEL;
    kernels()->solve(model, table, NULL, penalty, data, latent, channels, workspace);
    return RSD_OK;
}

rsd_status rsd_rowwise_assemble(const rsd_rowwise_model *model, const float *table, float *normal, float *workspace)
{
    if (model->rows == 0 || model->blocks == 0)
        return RSD_OK;
    const rsd_status status = check(model, table, normal, normal, 1, workspace);
    if (status == RSD_OK)
        kernels()->assemble(model, table, normal, workspace);
    return status;
}

rsd_status rsd_rowwise_solve_assembled(const rsd_rowwise_model *model, const float *normal,
                                       const float *penalty, float *latent, size_t channels, float *workspace)
{
    if (channels == 0 || model->rows == 0 || model->blocks == 0)
        return RSD_OK;
    const rsd_status status = check(model, normal, penalty, latent, channels, workspace);
    if (status != RSD_OK)
        return status;
    if (!holds_differences(model, penalty))
        return RSD_MODEL;
    kernels()->solve(model, NULL, normal, penalty, NULL, latent, channels, workspace);
    return RSD_OK;
}
