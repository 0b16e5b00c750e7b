/* Laws of the rowwise kernels, at every SIMD level of this machine, against dense systems in double precision; exits
 * with 1 if any fails. */
#include "check.h"
#include "rowwise.h"

#define PHASES 5
/* float32 sums of some dozen products of values up to 1; the solve divides by eigenvalues of 0.1 and more. */
#define TOLERANCE 1e-5
#define SOLVE_TOLERANCE 1e-4

static unsigned seed = 1;

/* The SIMD level under test. */
static const rsd_rowwise_kernels *level;

static unsigned draw(unsigned n)
{
    seed = seed * 1664525u + 1013904223u;
    return (seed >> 8) % n;
}

static void *allocate(size_t n, size_t size)
{
    void *memory = malloc(n * size + 1);
    if (memory == NULL)
        abort();
    return memory;
}

/* A model in which every row sees 1 to `tallest` rows at up to two shifts each. */
typedef struct {
    rsd_rowwise_model model;
    int32_t *row_first, *row_end, *coupled, *tap_start, *tap_shift;
    float *tap_weight, *table;
    size_t latents;
} blur;

static blur make_blur(size_t rows, size_t tallest)
{
    blur b = {.latents = (rows + tallest + 2) / 3 * 3};
    const size_t blocks = b.latents / 3;
    int *count = allocate(rows * b.latents, sizeof *count);
    int32_t *first_seen = allocate(rows, sizeof *first_seen);
    b.row_first = allocate(blocks, sizeof(int32_t));
    b.row_end = allocate(blocks, sizeof(int32_t));
    b.coupled = allocate(blocks, sizeof(int32_t));
    for (size_t i = 0; i < rows * b.latents; i++)
        count[i] = 0;
    for (size_t y = 0; y < rows; y++) {
        const size_t height = 1 + draw((unsigned)tallest), first = y + draw((unsigned)(tallest - height + 1));
        first_seen[y] = (int32_t)(first / 3);
        for (size_t j = first; j < first + height; j++)
            count[y * b.latents + j] = 1 + (int)draw(2);
    }
    size_t pairs = 0, taps = 0;
    for (size_t block = 0; block < blocks; block++) {
        int32_t first = 0, end = 0;
        for (size_t y = 0; y < rows; y++)
            for (size_t s = 0; s < 3; s++)
                if (count[y * b.latents + 3 * block + s] > 0) {
                    first = end == 0 ? (int32_t)y : first;
                    end = (int32_t)y + 1;
                }
        b.row_first[block] = first;
        b.row_end[block] = end;
        b.coupled[block] = block > 0 ? (int32_t)block - 1 : 0;
        for (int32_t y = first; y < end; y++)
            if (first_seen[y] < b.coupled[block])
                b.coupled[block] = first_seen[y];
        pairs += 3 * (size_t)(end - first);
    }
    for (size_t i = 0; i < rows * b.latents; i++)
        taps += (size_t)count[i];
    b.tap_start = allocate(pairs + 1, sizeof(int32_t));
    b.tap_shift = allocate(taps, sizeof(int32_t));
    b.tap_weight = allocate(taps, sizeof(float));
    size_t pair = 0;
    int32_t tap = 0;
    b.tap_start[0] = 0;
    for (size_t j = 0; j < b.latents; j++)
        for (int32_t y = b.row_first[j / 3]; y < b.row_end[j / 3]; y++) {
            for (int i = 0; i < count[(size_t)y * b.latents + j]; i++, tap++) {
                b.tap_shift[tap] = (int32_t)draw(PHASES);
                b.tap_weight[tap] = (float)(1 + draw(10)) / (float)(10 * tallest);
            }
            b.tap_start[++pair] = tap;
        }
    b.table = noise(PHASES * RSD_RECORD, draw(1u << 20));
    b.model = (rsd_rowwise_model){rows,        blocks,      taps,        PHASES,      b.row_first,
                                  b.row_end,   b.coupled,   b.tap_start, b.tap_shift, b.tap_weight};
    free(count), free(first_seen);
    return b;
}

static void free_blur(blur b)
{
    free(b.row_first), free(b.row_end), free(b.coupled), free(b.tap_start);
    free(b.tap_shift), free(b.tap_weight), free(b.table);
}

/* A of one lane by its definition: rows x latents complex values. */
static double *dense(const blur *b, size_t lane)
{
    double *a = allocate(2 * b->model.rows * b->latents, sizeof *a);
    for (size_t i = 0; i < 2 * b->model.rows * b->latents; i++)
        a[i] = 0;
    const int32_t *start = b->tap_start;
    for (size_t j = 0; j < b->latents; j++)
        for (int32_t y = b->row_first[j / 3]; y < b->row_end[j / 3]; y++, start++)
            for (int32_t t = start[0]; t < start[1]; t++) {
                const float *phase = b->table + b->tap_shift[t] * RSD_RECORD + lane;
                a[2 * ((size_t)y * b->latents + j)] += (double)b->tap_weight[t] * phase[0];
                a[2 * ((size_t)y * b->latents + j) + 1] += (double)b->tap_weight[t] * phase[RSD_LANES];
            }
    return a;
}

/* Read the real and imaginary part of lane `lane` in record i. */
static void read(const float *lanes, size_t i, size_t lane, double *re, double *im)
{
    *re = lanes[i * RSD_RECORD + lane];
    *im = lanes[i * RSD_RECORD + RSD_LANES + lane];
}

/* out[i] = sum over j of a[i, j] x[j], or with `adjoint` of conj(a[j, i]) x[j]. */
static void product(const double *a, size_t rows, size_t latents, int adjoint, const float *x, size_t lane, double *out)
{
    const size_t n = adjoint ? latents : rows, m = adjoint ? rows : latents;
    for (size_t i = 0; i < n; i++) {
        out[2 * i] = out[2 * i + 1] = 0;
        for (size_t j = 0; j < m; j++) {
            const double *element = a + 2 * (adjoint ? j * latents + i : i * latents + j);
            const double sign = adjoint ? -1 : 1;
            double re, im;
            read(x, j, lane, &re, &im);
            out[2 * i] += element[0] * re - sign * element[1] * im;
            out[2 * i + 1] += element[0] * im + sign * element[1] * re;
        }
    }
}

static void compare(const double *expected, const float *lanes, size_t n, size_t lane, double tolerance)
{
    for (size_t i = 0; i < n; i++) {
        double re, im;
        read(lanes, i, lane, &re, &im);
        CHECK(fabs(re - expected[2 * i]) < tolerance && fabs(im - expected[2 * i + 1]) < tolerance);
    }
}

static void test_operators(size_t rows, size_t tallest, size_t channels)
{
    const blur b = make_blur(rows, tallest);
    const size_t plane = rows * RSD_RECORD, latent_plane = b.latents * RSD_RECORD;
    float *latent = noise(channels * latent_plane, draw(1u << 20)), *data = noise(channels * plane, draw(1u << 20));
    float *spread = noise(channels * latent_plane, draw(1u << 20)), *blurred = noise(channels * plane, draw(1u << 20));
    const size_t floats = rsd_rowwise_workspace(&b.model, 0);
    float *workspace = noise(floats, draw(1u << 20));
    CHECK(floats > 0);
    level->forward(&b.model, b.table, latent, blurred, channels, workspace);
    level->adjoint(&b.model, b.table, data, spread, channels, workspace);
    double *expected = allocate(2 * b.latents, sizeof *expected);
    for (size_t lane = 0; lane < RSD_LANES; lane += 5) {
        double *a = dense(&b, lane);
        for (size_t c = 0; c < channels; c++) {
            product(a, rows, b.latents, 0, latent + c * latent_plane, lane, expected);
            compare(expected, blurred + c * plane, rows, lane, TOLERANCE);
            product(a, rows, b.latents, 1, data + c * plane, lane, expected);
            compare(expected, spread + c * latent_plane, b.latents, lane, TOLERANCE);
        }
        free(a);
    }
    free(expected), free(latent), free(data), free(spread), free(blurred), free(workspace);
    free_blur(b);
}

/* D^T D x at a row of one lane; no difference crosses an end. */
static double bent(const double *x, size_t j, size_t n)
{
    return (j > 0 ? x[j] - x[j - 1] : 0) + (j + 1 < n ? x[j] - x[j + 1] : 0);
}

/* The residual of the normal equations must vanish; `assembled`: with the assembled normal matrix. */
static void test_solve(size_t rows, size_t tallest, size_t channels, float slope, float bend, int assembled)
{
    const blur b = make_blur(rows, tallest);
    const size_t plane = rows * RSD_RECORD, latent_plane = b.latents * RSD_RECORD, n = b.latents;
    float *data = noise(channels * plane, draw(1u << 20)), *right = noise(channels * latent_plane, draw(1u << 20));
    float *u = allocate(channels * latent_plane, sizeof *u), penalty[RSD_PENALTY];
    for (size_t i = 0; i < channels * latent_plane; i++)
        u[i] = right[i];
    for (size_t i = 0; i < RSD_LANES; i++) {
        penalty[i] = 0.1f + 0.01f * (float)i;
        penalty[RSD_LANES + i] = slope * (1 + 0.1f * (float)i);
        penalty[2 * RSD_LANES + i] = bend * (1 + 0.05f * (float)i);
    }
    float *workspace = noise(rsd_rowwise_workspace(&b.model, 1), draw(1u << 20));
    if (assembled) {
        float *normal = noise(rsd_rowwise_assembled_size(&b.model), draw(1u << 20));
        float *sent = allocate(channels * latent_plane, sizeof *sent);
        level->adjoint(&b.model, b.table, data, sent, channels, workspace);
        for (size_t i = 0; i < channels * latent_plane; i++)
            u[i] += sent[i];
        level->assemble(&b.model, b.table, normal, workspace);
        level->solve(&b.model, NULL, normal, penalty, NULL, u, channels, workspace);
        free(normal), free(sent);
    } else
        level->solve(&b.model, b.table, NULL, penalty, data, u, channels, workspace);
    double *blurred = allocate(2 * rows, sizeof *blurred), *back = allocate(2 * n, sizeof *back);
    double *column = allocate(n, sizeof *column), *once = allocate(n, sizeof *once);
    float *rest = allocate(plane, sizeof *rest);
    for (size_t lane = 0; lane < RSD_LANES; lane += 3) {
        double *a = dense(&b, lane);
        for (size_t c = 0; c < channels; c++) {
            const float *x = u + c * latent_plane;
            product(a, rows, n, 0, x, lane, blurred);
            for (size_t y = 0; y < rows; y++) {
                double re, im;
                read(data + c * plane, y, lane, &re, &im);
                rest[y * RSD_RECORD + lane] = (float)(re - blurred[2 * y]);
                rest[y * RSD_RECORD + RSD_LANES + lane] = (float)(im - blurred[2 * y + 1]);
            }
            product(a, rows, n, 1, rest, lane, back);
            for (size_t part = 0; part < 2; part++) {
                const size_t at = part * RSD_LANES + lane;
                for (size_t j = 0; j < n; j++)
                    column[j] = x[j * RSD_RECORD + at];
                for (size_t j = 0; j < n; j++)
                    once[j] = bent(column, j, n);
                for (size_t j = 0; j < n; j++) {
                    const double left = back[2 * j + part] + right[c * latent_plane + j * RSD_RECORD + at] -
                                        (double)penalty[lane] * column[j] -
                                        (double)penalty[RSD_LANES + lane] * once[j] -
                                        (double)penalty[2 * RSD_LANES + lane] * bent(once, j, n);
                    CHECK(fabs(left) < SOLVE_TOLERANCE);
                }
            }
        }
        free(a);
    }
    free(data), free(right), free(u), free(workspace), free(blurred), free(back), free(rest), free(column), free(once);
    free_blur(b);
}

static void test_refusals(void)
{
    blur b = make_blur(6, 3);
    float *data = noise(6 * RSD_RECORD, draw(1u << 20)), *latent = noise(b.latents * RSD_RECORD, draw(1u << 20));
    float penalty[RSD_PENALTY] = {0};
    for (size_t i = 0; i < RSD_LANES; i++)
        penalty[i] = 1;
    float *workspace = noise(rsd_rowwise_workspace(&b.model, 1), draw(1u << 20));
    CHECK(rsd_rowwise_forward(&b.model, b.table, latent, data, 1, workspace) == RSD_OK);
    CHECK(rsd_rowwise_adjoint(&b.model, b.table, data, latent, 1, workspace) == RSD_OK);
    CHECK(rsd_rowwise_solve(&b.model, b.table, penalty, data, latent, 1, workspace) == RSD_OK);
    float *normal = noise(rsd_rowwise_assembled_size(&b.model), draw(1u << 20));
    CHECK(rsd_rowwise_assemble(&b.model, b.table, normal, workspace) == RSD_OK);
    CHECK(rsd_rowwise_solve_assembled(&b.model, normal, penalty, latent, 1, workspace) == RSD_OK);
    CHECK(rsd_rowwise_assemble(&b.model, b.table, NULL, workspace) == RSD_NULL);
    CHECK(rsd_rowwise_solve_assembled(&b.model, NULL, penalty, latent, 1, workspace) == RSD_NULL);
    CHECK(rsd_rowwise_solve_assembled(&b.model, normal, NULL, latent, 1, workspace) == RSD_NULL);
    CHECK(rsd_rowwise_solve_assembled(&b.model, normal, penalty, latent, SIZE_MAX / 8, workspace) == RSD_SIZE);
    CHECK(rsd_rowwise_solve_assembled(&b.model, normal, penalty, latent, 0, NULL) == RSD_OK);
    CHECK(rsd_rowwise_forward(&b.model, NULL, latent, data, 1, workspace) == RSD_NULL);
    CHECK(rsd_rowwise_adjoint(&b.model, b.table, data, NULL, 1, workspace) == RSD_NULL);
    CHECK(rsd_rowwise_solve(&b.model, b.table, NULL, data, latent, 1, workspace) == RSD_NULL);
    CHECK(rsd_rowwise_solve(&b.model, b.table, penalty, data, latent, SIZE_MAX / 8, workspace) == RSD_SIZE);
    CHECK(rsd_rowwise_solve(&b.model, b.table, penalty, data, latent, 0, NULL) == RSD_OK);
    b.tap_shift[0] = PHASES;
    CHECK(rsd_rowwise_solve(&b.model, b.table, penalty, data, latent, 1, workspace) == RSD_MODEL);
    CHECK(rsd_rowwise_assemble(&b.model, b.table, normal, workspace) == RSD_MODEL);
    CHECK(rsd_rowwise_solve_assembled(&b.model, normal, penalty, latent, 1, workspace) == RSD_MODEL);
    CHECK(rsd_rowwise_workspace(&b.model, 1) == 0);
    CHECK(rsd_rowwise_assembled_size(&b.model) == 0);
    b.tap_shift[0] = 0;
    b.row_end[0] = 7;
    CHECK(rsd_rowwise_forward(&b.model, b.table, latent, data, 1, workspace) == RSD_MODEL);
    free(data), free(latent), free(workspace), free(normal);
    free_blur(b);
}

static void test_level(const char *name, const rsd_rowwise_kernels *kernels)
{
    level = kernels;
    /* Channels on both sides of the block of three, windows of one block and of many. */
    for (size_t channels = 1; channels <= 4; channels++) {
        test_operators(9, 4, channels);
        for (int assembled = 0; assembled < 2; assembled++)
            test_solve(9, 4, channels, 0.0f, 0.0f, assembled);
        for (int assembled = 0; assembled < 2; assembled++)
            test_solve(14, 7, channels, 0.5f, 0.0f, assembled);
        for (int assembled = 0; assembled < 2; assembled++)
            test_solve(14, 7, channels, 0.3f, 0.1f, assembled);
    }
    test_operators(30, 13, 3);
    for (int assembled = 0; assembled < 2; assembled++)
        test_solve(30, 13, 3, 0.0f, 0.0f, assembled);
    for (int assembled = 0; assembled < 2; assembled++)
        test_solve(5, 1, 3, 0.3f, 0.1f, assembled);
    printf("rowwise kernels (%s): %d failures\n", name, failures);
}

int main(void)
{
    test_level("baseline", &rsd_rowwise_baseline);
#ifdef RSD_MULTIVERSIONING
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        test_level("avx2", &rsd_rowwise_avx2);
    if (__builtin_cpu_supports("avx512f"))
        test_level("avx512f", &rsd_rowwise_avx512);
#endif
    test_refusals();
    return failures != 0;
}
