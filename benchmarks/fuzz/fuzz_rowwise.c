/* libFuzzer's harness for the rowwise kernels; see docs/developer/reliability.md. */
#include "input.h"
#include "rsdeblur_kernels.h"

#define MOST_BLOCKS 6

/* Return the sum of `counts`-like differences that the kernels index `tap_start` with; 0 for an invalid model. */
static size_t pairs_of(const int32_t *first, const int32_t *end, size_t blocks, size_t rows)
{
    size_t pairs = 0;
    for (size_t b = 0; b < blocks; b++) {
        if (first[b] < 0 || end[b] < first[b] || (size_t)end[b] > rows)
            return 0;
        pairs += RSD_BLOCK * (size_t)(end[b] - first[b]);
    }
    return pairs;
}

/* Return a copy of exactly `n` integers, one of which may be any. */
static int32_t *integers(rsd_input *input, const int32_t *values, size_t n)
{
    const int32_t odd[] = {-1, INT32_MIN, INT32_MAX, 0, 1, 40, 1 << 20};
    int32_t *copy = malloc(n * sizeof *copy);
    if (copy == NULL)
        abort();
    if (n > 0)
        memcpy(copy, values, n * sizeof *copy);
    if (next(input) >= 240 && n > 0)
        copy[below(input, n)] = odd[below(input, sizeof odd / sizeof *odd)];
    return copy;
}

static void call(rsd_input *input, const rsd_rowwise_model *model, size_t channels)
{
    const int kind = (int)below(input, 3), solve = kind == 2;
    float *workspace = floats(input, rsd_rowwise_workspace(model, solve));
    float *table = floats(input, model->phases * RSD_RECORD), *ridge = floats(input, RSD_LANES);
    const size_t rows = channels * model->rows * RSD_RECORD, cols = channels * model->blocks * RSD_BLOCK * RSD_RECORD;
    float *data = floats(input, rows), *latent = floats(input, cols);
    float *data_copy = copied(data, rows), *latent_copy = copied(latent, cols), smooth;
    memcpy(&smooth, ridge, sizeof smooth);
    rsd_status status;
    if (kind == 0)
        status = rsd_rowwise_forward(model, table, latent, data, channels, workspace);
    else if (kind == 1)
        status = rsd_rowwise_adjoint(model, table, data, latent, channels, workspace);
    else
        status = rsd_rowwise_solve(model, table, ridge, next(input) & 1 ? smooth : 0.0f, data, latent, channels,
                                   workspace);
    /* The input of each function is never written. */
    check_refused(status != RSD_OK || kind != 0, data, data_copy, rows);
    check_refused(status != RSD_OK || kind == 0, latent, latent_copy, cols);
    free(workspace), free(table), free(ridge), free(data), free(latent);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    rsd_input input = {data, size};
    rsd_rowwise_model model = {.rows = below(&input, 40), .blocks = below(&input, MOST_BLOCKS + 1)};
    const size_t channels = below(&input, 4);
    model.phases = below(&input, 5);
    int32_t numbers[3][MOST_BLOCKS];
    for (size_t b = 0; b < model.blocks; b++) {
        numbers[0][b] = (int32_t)below(&input, model.rows + 1);
        const size_t left = model.rows - (size_t)numbers[0][b];
        numbers[1][b] = numbers[0][b] + (int32_t)below(&input, (left < 7 ? left : 7) + 1);
        numbers[2][b] = (int32_t)below(&input, b + 1);
    }
    int32_t *first = integers(&input, numbers[0], model.blocks), *end = integers(&input, numbers[1], model.blocks);
    int32_t *coupled = integers(&input, numbers[2], model.blocks);
    const size_t pairs = pairs_of(first, end, model.blocks, model.rows);
    int32_t start[RSD_BLOCK * MOST_BLOCKS * 40 + 1] = {0};
    for (size_t p = 0; p < pairs; p++)
        start[p + 1] = start[p] + (int32_t)below(&input, 3);
    model.taps = (size_t)start[pairs];
    int32_t *tap_start = integers(&input, start, pairs + 1);
    int32_t shifts[2 * RSD_BLOCK * MOST_BLOCKS * 40];
    for (size_t t = 0; t < model.taps; t++)
        shifts[t] = model.phases > 0 ? (int32_t)below(&input, model.phases) : 0;
    int32_t *tap_shift = integers(&input, shifts, model.taps);
    float *weights = floats(&input, model.taps);
    model.row_first = first, model.row_end = end, model.coupled = coupled;
    model.tap_start = tap_start, model.tap_shift = tap_shift, model.tap_weight = weights;
    call(&input, &model, channels);
    free(first), free(end), free(coupled), free(tap_start), free(tap_shift), free(weights);
    return 0;
}
