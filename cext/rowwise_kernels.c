/*
 * The rowwise kernels, compiled once per SIMD level (see meson.build).
 *
 * Nearly all the time goes into inner products of three rows with three others, and their transposes, over records
 * that stay in the second-level cache: a window of columns of A, and of rows of the Cholesky factor. The factor is that
 * of the conjugate of the normal matrix, N[j, i] = sum_y A[y, j] conj(A[y, i]), so that data need no conjugation. With
 * N = L L^H,
 *
 *     L[j, i] = (N[j, i] - sum_{k < i} L[j, k] conj(L[i, k])) / L[i, i]
 *     z[j]    = (r[j]    - sum_{k < j} z[k]    conj(L[j, k])) / L[j, j],     r[j] = sum_y G[y] conj(A[y, j])
 *     u[j]    = (z[j]    - sum_{i > j} L[i, j] u[i]) / L[j, j].
 *
 * The channels of z are computed like three more rows of L. Diagonal elements of L are stored as their inverses.
 */
#include "rowwise.h"

#include <math.h>
#include <string.h>

#if defined(__AVX512F__)
#define WIDTH 16
#define LEVEL rsd_rowwise_avx512
#elif defined(__AVX2__)
#define WIDTH 8
#define LEVEL rsd_rowwise_avx2
#else
#define LEVEL rsd_rowwise_baseline
#ifdef __GNUC__
#define WIDTH 4
#else
#define WIDTH 1
#endif
#endif

/* Columns of sums that fit into the registers with their operands: a 3 x 3 block takes 30 registers, a column 14. */
#if defined(__AVX512F__) || defined(__aarch64__)
#define TOGETHER RSD_BLOCK
#else
#define TOGETHER 1
#endif

#if WIDTH > 1
/* Callers guarantee the alignment of a float only. */
typedef float vec __attribute__((vector_size(WIDTH * sizeof(float)), aligned(sizeof(float)), may_alias));
#define INLINE static inline __attribute__((always_inline))
#else
typedef float vec;
#define INLINE static inline
#endif

typedef struct {
    vec re, im;
} cvec;

INLINE cvec load(const float *p)
{
    return (cvec){*(const vec *)p, *(const vec *)(p + RSD_LANES)};
}

INLINE void store(float *p, cvec value)
{
    *(vec *)p = value.re;
    *(vec *)(p + RSD_LANES) = value.im;
}

/* a + b c */
INLINE cvec plus(cvec a, cvec b, cvec c)
{
    a.re += b.re * c.re;
    a.im += b.re * c.im;
    a.re -= b.im * c.im;
    a.im += b.im * c.re;
    return a;
}

INLINE cvec minus(cvec a, cvec b, cvec c)
{
    a.re -= b.re * c.re;
    a.im -= b.re * c.im;
    a.re += b.im * c.im;
    a.im -= b.im * c.re;
    return a;
}

INLINE cvec conjugate(cvec a)
{
    return (cvec){a.re, -a.im};
}

/* Add to sum[r][s], or subtract, the sum over k < n of x[r][k] conj(y[s][k]); strides in floats. */
INLINE void multiply(cvec sum[RSD_BLOCK][RSD_BLOCK], const float *x, size_t x_stride, const float *y, size_t y_stride,
                     size_t n, const size_t rows, const int subtract)
{
    for (size_t s0 = 0; s0 < RSD_BLOCK; s0 += TOGETHER) {
        cvec t[RSD_BLOCK][TOGETHER];
        for (size_t r = 0; r < rows; r++)
            for (size_t s = 0; s < TOGETHER; s++)
                t[r][s] = sum[r][s0 + s];
        for (size_t k = 0; k < n; k++) {
            cvec a[RSD_BLOCK];
            for (size_t r = 0; r < rows; r++)
                a[r] = load(x + r * x_stride + k * RSD_RECORD);
            for (size_t s = 0; s < TOGETHER; s++) {
                const cvec b = load(y + (s0 + s) * y_stride + k * RSD_RECORD);
                for (size_t r = 0; r < rows; r++) {
                    if (subtract) {
                        t[r][s].re -= a[r].re * b.re;
                        t[r][s].im -= a[r].im * b.re;
                        t[r][s].re -= a[r].im * b.im;
                        t[r][s].im += a[r].re * b.im;
                    } else {
                        t[r][s].re += a[r].re * b.re;
                        t[r][s].im += a[r].im * b.re;
                        t[r][s].re += a[r].im * b.im;
                        t[r][s].im -= a[r].re * b.im;
                    }
                }
            }
        }
        for (size_t r = 0; r < rows; r++)
            for (size_t s = 0; s < TOGETHER; s++)
                sum[r][s0 + s] = t[r][s];
    }
}

/* Add to z[c][k], or subtract, the sum over r < 3 of a[r][k] u[r][c], for k < n. */
INLINE void spread(float *z, size_t z_stride, const float *a, size_t a_stride, cvec u[RSD_BLOCK][RSD_BLOCK], size_t n,
                   const size_t channels, const int subtract)
{
    for (size_t c0 = 0; c0 < channels; c0 += TOGETHER)
        for (size_t k = 0; k < n; k++) {
            cvec b[RSD_BLOCK];
            for (size_t r = 0; r < RSD_BLOCK; r++)
                b[r] = load(a + r * a_stride + k * RSD_RECORD);
            for (size_t c = c0; c < channels && c < c0 + TOGETHER; c++) {
                float *const p = z + c * z_stride + k * RSD_RECORD;
                cvec t = load(p);
                for (size_t r = 0; r < RSD_BLOCK; r++)
                    t = subtract ? minus(t, b[r], u[r][c]) : plus(t, b[r], u[r][c]);
                store(p, t);
            }
        }
}

/* Compute the columns of A of block J: A[y, 3 J + s] is at columns[s * stride + (y - row_first[J]) * RSD_RECORD]. */
static void fill(float *columns, size_t stride, const rsd_rowwise_model *model, const float *table, size_t block,
                 const int32_t *start)
{
    const size_t rows = (size_t)(model->row_end[block] - model->row_first[block]);
    for (size_t s = 0; s < RSD_BLOCK; s++)
        for (size_t y = 0; y < rows; y++, start++)
            for (size_t lane = 0; lane < RSD_LANES; lane += WIDTH) {
                cvec sum = {{0}, {0}};
                for (int32_t t = start[0]; t < start[1]; t++) {
                    const cvec phase = load(table + (size_t)model->tap_shift[t] * RSD_RECORD + lane);
                    sum.re += model->tap_weight[t] * phase.re;
                    sum.im += model->tap_weight[t] * phase.im;
                }
                store(columns + s * stride + y * RSD_RECORD + lane, sum);
            }
}

static void forward(const rsd_rowwise_model *model, const float *table, const float *latent, float *data,
                    size_t channels, float *columns)
{
    const size_t stride = rsd_rowwise_reach(model) * RSD_RECORD, plane = model->rows * RSD_RECORD;
    const size_t latent_plane = model->blocks * RSD_BLOCK * RSD_RECORD;
    const int32_t *start = model->tap_start;
    memset(data, 0, channels * plane * sizeof *data);
    for (size_t b = 0; b < model->blocks; start += rsd_rowwise_pairs(model, b++)) {
        const size_t first = (size_t)model->row_first[b], rows = (size_t)model->row_end[b] - first;
        fill(columns, stride, model, table, b, start);
        for (size_t c = 0; c < channels; c++)
            for (size_t lane = 0; lane < RSD_LANES; lane += WIDTH) {
                cvec u[RSD_BLOCK][RSD_BLOCK];
                for (size_t r = 0; r < RSD_BLOCK; r++)
                    u[r][0] = load(latent + c * latent_plane + (b * RSD_BLOCK + r) * RSD_RECORD + lane);
                spread(data + c * plane + first * RSD_RECORD + lane, 0, columns + lane, stride, u, rows, 1, 0);
            }
    }
}

static void adjoint(const rsd_rowwise_model *model, const float *table, const float *data, float *latent,
                    size_t channels, float *columns)
{
    const size_t stride = rsd_rowwise_reach(model) * RSD_RECORD, plane = model->rows * RSD_RECORD;
    const size_t latent_plane = model->blocks * RSD_BLOCK * RSD_RECORD;
    const int32_t *start = model->tap_start;
    for (size_t b = 0; b < model->blocks; start += rsd_rowwise_pairs(model, b++)) {
        const size_t first = (size_t)model->row_first[b], rows = (size_t)model->row_end[b] - first;
        fill(columns, stride, model, table, b, start);
        for (size_t c = 0; c < channels; c++)
            for (size_t lane = 0; lane < RSD_LANES; lane += WIDTH) {
                cvec sum[RSD_BLOCK][RSD_BLOCK];
                memset(sum, 0, sizeof sum);
                multiply(sum, data + c * plane + first * RSD_RECORD + lane, 0, columns + lane, stride, rows, 1, 0);
                for (size_t s = 0; s < RSD_BLOCK; s++)
                    store(latent + c * latent_plane + (b * RSD_BLOCK + s) * RSD_RECORD + lane, sum[0][s]);
            }
    }
}

/* State of the factorisation. */
typedef struct {
    const rsd_rowwise_model *model;
    float *columns; /* A for a window of blocks */
    size_t window, columns_stride;
    float *factor;
    size_t factor_stride;
} system;

static const float *columns_of(const system *s, size_t block, size_t row)
{
    return s->columns + block % s->window * RSD_BLOCK * s->columns_stride +
           (row - (size_t)s->model->row_first[block]) * RSD_RECORD;
}

/* L[3 block, latent] */
static float *factor_of(const system *s, size_t block, size_t latent)
{
    return s->factor + block * RSD_BLOCK * s->factor_stride +
           (latent - RSD_BLOCK * (size_t)s->model->coupled[block]) * RSD_RECORD;
}

static size_t larger(size_t a, size_t b)
{
    return a > b ? a : b;
}

/* Replace `sum` by sum L[I, I]^-H, where `diagonal` is L[I, I]. */
INLINE void divide(cvec sum[RSD_BLOCK][RSD_BLOCK], const float *diagonal, size_t stride, const size_t rows)
{
    for (size_t s = 0; s < RSD_BLOCK; s++) {
        for (size_t q = 0; q < s; q++) {
            const cvec l = conjugate(load(diagonal + s * stride + q * RSD_RECORD));
            for (size_t r = 0; r < rows; r++)
                sum[r][s] = minus(sum[r][s], sum[r][q], l);
        }
        const cvec inverse = load(diagonal + s * stride + s * RSD_RECORD);
        for (size_t r = 0; r < rows; r++) {
            sum[r][s].re *= inverse.re;
            sum[r][s].im *= inverse.re;
        }
    }
}

/* Add A^H A [J, I], computed from the columns of A, to `sum`. */
INLINE void add_product(cvec sum[RSD_BLOCK][RSD_BLOCK], const system *s, size_t J, size_t I, size_t lane)
{
    const rsd_rowwise_model *m = s->model;
    /* The picture rows that see both. */
    const size_t first = larger((size_t)m->row_first[J], (size_t)m->row_first[I]);
    const size_t end = (size_t)(m->row_end[J] < m->row_end[I] ? m->row_end[J] : m->row_end[I]);
    if (first < end)
        multiply(sum, columns_of(s, J, first) + lane, s->columns_stride, columns_of(s, I, first) + lane,
                 s->columns_stride, end - first, RSD_BLOCK, 0);
}

/* Add N[J, I] to `sum`, less the products of the columns of L before I; `tile` is A^H A [J, I], or NULL. */
INLINE void remainder_tile(cvec sum[RSD_BLOCK][RSD_BLOCK], const system *s, size_t J, size_t I, const float *tile,
                           size_t lane)
{
    const size_t k = RSD_BLOCK * larger((size_t)s->model->coupled[J], (size_t)s->model->coupled[I]);
    if (tile == NULL)
        add_product(sum, s, J, I, lane);
    else
        for (size_t r = 0; r < RSD_BLOCK; r++)
            for (size_t c = 0; c < RSD_BLOCK; c++) {
                const cvec value = load(tile + (r * RSD_BLOCK + c) * RSD_RECORD + lane);
                sum[r][c].re += value.re;
                sum[r][c].im += value.im;
            }
    if (k < RSD_BLOCK * I)
        multiply(sum, factor_of(s, J, k) + lane, s->factor_stride, factor_of(s, I, k) + lane, s->factor_stride,
                 RSD_BLOCK * I - k, RSD_BLOCK, 1);
}

/* A tile of the assembled normal matrix, or NULL without one. */
static const float *tile_of(const float *normal, size_t tile)
{
    return normal == NULL ? NULL : normal + tile * RSD_TILE * RSD_RECORD;
}

/* The differences that a latent row takes part in: D^T D has this number on its diagonal, and -1 beside it. */
static float differences(const system *s, size_t latent)
{
    return (float)((latent > 0) + (latent + 1 < s->model->blocks * RSD_BLOCK));
}

/* Add the terms of `penalty` in D^T D and its square between a latent row and the one before it. */
INLINE void add_to_neighbour(cvec *sum, const system *s, size_t latent, const float *penalty)
{
    const vec slope = *(const vec *)(penalty + RSD_LANES), bend = *(const vec *)(penalty + 2 * RSD_LANES);
    sum->re -= slope + bend * (differences(s, latent) + differences(s, latent - 1));
}

static void off_diagonal(const system *s, size_t J, size_t I, const float *tile, const float *penalty)
{
    float *const out = factor_of(s, J, RSD_BLOCK * I);
    for (size_t lane = 0; lane < RSD_LANES; lane += WIDTH) {
        cvec sum[RSD_BLOCK][RSD_BLOCK];
        memset(sum, 0, sizeof sum);
        if (I + 1 == J) {
            const vec bend = *(const vec *)(penalty + 2 * RSD_LANES + lane);
            add_to_neighbour(&sum[0][RSD_BLOCK - 1], s, J * RSD_BLOCK, penalty + lane);
            for (size_t r = 0; r < 2; r++)
                sum[r][r + RSD_BLOCK - 2].re += bend;
        }
        remainder_tile(sum, s, J, I, tile, lane);
        divide(sum, factor_of(s, I, RSD_BLOCK * I) + lane, s->factor_stride, RSD_BLOCK);
        for (size_t r = 0; r < RSD_BLOCK; r++)
            for (size_t c = 0; c < RSD_BLOCK; c++)
                store(out + r * s->factor_stride + c * RSD_RECORD + lane, sum[r][c]);
    }
}

/* Return 1 / sqrt(max(x, ridge)): no eigenvalue, and so no pivot, is below the ridge, except by rounding. */
INLINE vec inverse_root(vec x, const float *ridge)
{
    float values[WIDTH];
    memcpy(values, &x, sizeof values);
    for (size_t i = 0; i < WIDTH; i++)
        values[i] = 1.0f / sqrtf(values[i] > ridge[i] ? values[i] : ridge[i]);
    memcpy(&x, values, sizeof values);
    return x;
}

static void on_diagonal(const system *s, size_t J, const float *tile, const float *penalty)
{
    float *const out = factor_of(s, J, RSD_BLOCK * J);
    for (size_t lane = 0; lane < RSD_LANES; lane += WIDTH) {
        const float *const ridge = penalty + lane;
        const vec slope = *(const vec *)(ridge + RSD_LANES), bend = *(const vec *)(ridge + 2 * RSD_LANES);
        cvec sum[RSD_BLOCK][RSD_BLOCK];
        memset(sum, 0, sizeof sum);
        for (size_t r = 0; r < RSD_BLOCK; r++) {
            const float n = differences(s, J * RSD_BLOCK + r);
            sum[r][r].re += *(const vec *)ridge + n * slope + n * (n + 1) * bend;
            if (r > 0)
                add_to_neighbour(&sum[r][r - 1], s, J * RSD_BLOCK + r, ridge);
            if (r > 1)
                sum[r][r - 2].re += bend;
        }
        remainder_tile(sum, s, J, J, tile, lane);
        for (size_t c = 0; c < RSD_BLOCK; c++) {
            for (size_t q = 0; q < c; q++)
                for (size_t r = c; r < RSD_BLOCK; r++)
                    sum[r][c] = minus(sum[r][c], sum[r][q], conjugate(sum[c][q]));
            const vec inverse = inverse_root(sum[c][c].re, ridge);
            for (size_t r = c + 1; r < RSD_BLOCK; r++) {
                sum[r][c].re *= inverse;
                sum[r][c].im *= inverse;
            }
            sum[c][c].re = inverse;
        }
        for (size_t r = 0; r < RSD_BLOCK; r++)
            for (size_t c = 0; c <= r; c++)
                store(out + r * s->factor_stride + c * RSD_RECORD + lane, sum[r][c]);
    }
}

/* Replace the right-hand side, which lacks A^H data unless `data` is NULL, by z in block J of 1 to 3 planes. */
INLINE void substitute_forward(const system *s, size_t J, const float *data, float *z, const size_t channels)
{
    const rsd_rowwise_model *m = s->model;
    const size_t first = (size_t)m->row_first[J], rows = (size_t)m->row_end[J] - first;
    const size_t plane = m->rows * RSD_RECORD, z_plane = m->blocks * RSD_BLOCK * RSD_RECORD;
    const size_t k = RSD_BLOCK * (size_t)m->coupled[J], j = RSD_BLOCK * J;
    for (size_t lane = 0; lane < RSD_LANES; lane += WIDTH) {
        cvec sum[RSD_BLOCK][RSD_BLOCK];
        for (size_t c = 0; c < channels; c++)
            for (size_t r = 0; r < RSD_BLOCK; r++)
                sum[c][r] = load(z + c * z_plane + (j + r) * RSD_RECORD + lane);
        if (data != NULL)
            multiply(sum, data + first * RSD_RECORD + lane, plane, columns_of(s, J, first) + lane, s->columns_stride,
                     rows, channels, 0);
        multiply(sum, z + k * RSD_RECORD + lane, z_plane, factor_of(s, J, k) + lane, s->factor_stride, j - k, channels,
                 1);
        divide(sum, factor_of(s, J, j) + lane, s->factor_stride, channels);
        for (size_t c = 0; c < channels; c++)
            for (size_t r = 0; r < RSD_BLOCK; r++)
                store(z + c * z_plane + (j + r) * RSD_RECORD + lane, sum[c][r]);
    }
}

/* Replace z by u in block J of the planes, and subtract its products from the blocks before J. */
INLINE void substitute_back(const system *s, size_t J, float *z, const size_t channels)
{
    const size_t z_plane = s->model->blocks * RSD_BLOCK * RSD_RECORD;
    const size_t k = RSD_BLOCK * (size_t)s->model->coupled[J], j = RSD_BLOCK * J;
    for (size_t lane = 0; lane < RSD_LANES; lane += WIDTH) {
        const float *const diagonal = factor_of(s, J, j) + lane;
        cvec u[RSD_BLOCK][RSD_BLOCK];
        for (size_t c = 0; c < channels; c++)
            for (size_t r = RSD_BLOCK; r-- > 0;) {
                float *const p = z + c * z_plane + (j + r) * RSD_RECORD + lane;
                cvec value = load(p);
                for (size_t q = r + 1; q < RSD_BLOCK; q++)
                    value = minus(value, load(diagonal + q * s->factor_stride + r * RSD_RECORD), u[q][c]);
                const cvec inverse = load(diagonal + r * s->factor_stride + r * RSD_RECORD);
                value.re *= inverse.re;
                value.im *= inverse.re;
                store(p, value);
                u[r][c] = value;
            }
        spread(z + k * RSD_RECORD + lane, z_plane, factor_of(s, J, k) + lane, s->factor_stride, u, j - k, channels, 1);
    }
}

static system system_in(const rsd_rowwise_model *model, float *workspace)
{
    const size_t window = rsd_rowwise_window(model), reach = rsd_rowwise_reach(model);
    return (system){model,
                    workspace,
                    window,
                    reach * RSD_RECORD,
                    workspace + window * RSD_BLOCK * reach * RSD_RECORD,
                    window * RSD_BLOCK * RSD_RECORD};
}

/* Compute the columns of A of block J. */
static void fill_columns(const system *s, const float *table, size_t J, const int32_t *start)
{
    fill(s->columns + J % s->window * RSD_BLOCK * s->columns_stride, s->columns_stride, s->model, table, J, start);
}

static void assemble(const rsd_rowwise_model *model, const float *table, float *normal, float *workspace)
{
    const system s = system_in(model, workspace);
    const int32_t *start = model->tap_start;
    for (size_t J = 0; J < model->blocks; start += rsd_rowwise_pairs(model, J++)) {
        fill_columns(&s, table, J, start);
        for (size_t I = (size_t)model->coupled[J]; I <= J; I++, normal += RSD_TILE * RSD_RECORD)
            for (size_t lane = 0; lane < RSD_LANES; lane += WIDTH) {
                cvec sum[RSD_BLOCK][RSD_BLOCK];
                memset(sum, 0, sizeof sum);
                add_product(sum, &s, J, I, lane);
                for (size_t r = 0; r < RSD_BLOCK; r++)
                    for (size_t c = 0; c < RSD_BLOCK; c++)
                        store(normal + (r * RSD_BLOCK + c) * RSD_RECORD + lane, sum[r][c]);
            }
    }
}

static void solve(const rsd_rowwise_model *model, const float *table, const float *normal,
                  const float *penalty, const float *data, float *latent, size_t channels, float *workspace)
{
    const system s = system_in(model, workspace);
    const size_t data_plane = model->rows * RSD_RECORD, plane = model->blocks * RSD_BLOCK * RSD_RECORD;
    const int32_t *start = model->tap_start;
    size_t tile = 0;
    for (size_t J = 0; J < model->blocks; start += rsd_rowwise_pairs(model, J++)) {
        if (normal == NULL)
            fill_columns(&s, table, J, start);
        for (size_t I = (size_t)model->coupled[J]; I < J; I++)
            off_diagonal(&s, J, I, tile_of(normal, tile++), penalty);
        on_diagonal(&s, J, tile_of(normal, tile++), penalty);
        for (size_t c = 0; c < channels; c += RSD_BLOCK) {
            const float *const plane_data = data == NULL ? NULL : data + c * data_plane;
            switch (channels - c) {
            case 1:
                substitute_forward(&s, J, plane_data, latent + c * plane, 1);
                break;
            case 2:
                substitute_forward(&s, J, plane_data, latent + c * plane, 2);
                break;
            default:
                substitute_forward(&s, J, plane_data, latent + c * plane, 3);
            }
        }
    }
    for (size_t J = model->blocks; J-- > 0;)
        for (size_t c = 0; c < channels; c += RSD_BLOCK)
            switch (channels - c) {
            case 1:
                substitute_back(&s, J, latent + c * plane, 1);
                break;
            case 2:
                substitute_back(&s, J, latent + c * plane, 2);
                break;
            default:
                substitute_back(&s, J, latent + c * plane, 3);
            }
}

const rsd_rowwise_kernels LEVEL = {forward, adjoint, assemble, solve};
