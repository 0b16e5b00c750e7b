/*
 * Numeric kernels of rsdeblur, free of Python.
 *
 * Arrays are dense, row before column, in the machine's own float32. A complex value is two floats, real part first.
 * Sizes count the elements named in each comment. The caller owns all memory, before and after; nothing is allocated,
 * kept or freed here. Arrays of one call must not overlap. Functions are thread-safe on distinct outputs. A zero size
 * is allowed and does nothing. Unless RSD_OK is returned, nothing was written.
 *
 * Every SIMD level gives the same bits, no operation being reordered or contracted; except for the rowwise kernels, which
 * use fused multiply-adds where the machine has them and agree between levels to rounding.
 */
#ifndef RSDEBLUR_KERNELS_H
#define RSDEBLUR_KERNELS_H

#include <stddef.h>
#include <stdint.h>

typedef enum {
    RSD_OK = 0,
    RSD_NULL = 1, /* a pointer is null although its array is not empty */
    RSD_SIZE = 2, /* a size overflows, or a stride is shorter than the line it spans */
    RSD_MODEL = 3 /* the tables of a rowwise model contradict each other */
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

/* Where the lines of an array stand: line l of plane p starts p * plane + l * line values from the first one. */
typedef struct {
    size_t plane, line;
} rsd_layout;

/*
 * A tile reads a line of a picture from position `start` on, `length` positions, any of which may lie beyond the picture:
 * there it goes on by reflection (border positions repeat), or by repetition if `periodic`. Its last `taper` positions
 * fade, by the shares fade[taper], into what precedes its start.
 */
typedef struct {
    ptrdiff_t start;
    size_t length;
    const float *fade;
    size_t taper;
    int periodic;
} rsd_tile;

/*
 * Cut a tile out of picture rows: a line per channel (plane) and row.
 *
 * picture   rows x width x channels floats
 * lines     float lines of tile.length
 * finite    receives whether all that was read inside the picture is finite
 */
rsd_status rsd_picture_to_lines(const float *picture, size_t rows, size_t width, size_t channels, rsd_tile tile,
                                float *lines, rsd_layout layout, int *finite);

/*
 * Put lines, weighted by position, into picture rows, or add them if `add`.
 *
 * lines     float lines, of which the first n values count; a line per channel (plane) and row
 * picture   the first float to change in row 0; rows are width * channels floats apart
 */
rsd_status rsd_lines_to_picture(const float *lines, rsd_layout layout, size_t rows, size_t channels,
                                const float *weights, size_t n, int add, float *picture, size_t width);

/*
 * Transpose `count` columns of complex rows into complex lines of `height`, and back.
 *
 * rows      per channel (plane) `height` lines, of which the first `count` values count
 * columns   per channel (plane) `count` lines of `height`
 */
rsd_status rsd_rows_to_columns(const float *rows, rsd_layout row_layout, float *columns, rsd_layout column_layout,
                               size_t channels, size_t height, size_t count);
rsd_status rsd_columns_to_rows(const float *columns, rsd_layout column_layout, float *rows, rsd_layout row_layout,
                               size_t channels, size_t height, size_t count);

/*
 * Cut a tile out of complex lines of n values. `lines` may be `source` where the tile starts at 0: it is then extended
 * in place.
 */
rsd_status rsd_cut_lines(const float *source, rsd_layout source_layout, size_t n, rsd_tile tile, float *lines,
                         rsd_layout layout, size_t channels, size_t count);

/*
 * Rowwise: 16 frequencies at once, one to a lane. A complex value of all lanes is a record: 16 real parts, then 16
 * imaginary ones. For each frequency k the blur is a matrix from latent rows j to picture rows y,
 *
 *     A[y, j] = sum over the taps of (j, y) of weight * phase(shift),
 *
 * where phase(shift) = exp(-2 pi i k shift / N) comes from a table. Latent rows are taken three at a time: a block J is the
 * rows 3 J to 3 J + 2. It is seen by picture rows row_first[J] to row_end[J] - 1 and by no other.
 */
#define RSD_LANES 16
#define RSD_RECORD (2 * RSD_LANES)
#define RSD_BLOCK 3

typedef struct {
    size_t rows, blocks, taps, phases;
    const int32_t *row_first, *row_end; /* blocks each */
    const int32_t *coupled;             /* blocks: first block that shares a picture row (or a gradient) with this one */
    const int32_t *tap_start;           /* where the taps of each (j, y) begin, and the end of the last; j is outermost */
    const int32_t *tap_shift;           /* taps: index into the phases */
    const float *tap_weight;            /* taps */
} rsd_rowwise_model;

/* Number of floats of workspace that rsd_rowwise_solve (`solve` true) or the others want; 0 if the model is not valid. */
size_t rsd_rowwise_workspace(const rsd_rowwise_model *model, int solve);

/*
 * data[c] = A latent[c] and its adjoint latent[c] = A^H data[c].
 *
 * table      phases records
 * latent     channels x 3 blocks records
 * data       channels x rows records
 */
rsd_status rsd_rowwise_forward(const rsd_rowwise_model *model, const float *table, const float *latent, float *data,
                               size_t channels, float *workspace);
rsd_status rsd_rowwise_adjoint(const rsd_rowwise_model *model, const float *table, const float *data, float *latent,
                               size_t channels, float *workspace);

/*
 * Solve (A^H A + diag(ridge) + smooth D^T D) u = A^H data + latent in place of latent, where D takes the differences of
 * neighbouring latent rows: banded Cholesky, forward and back substitution.
 *
 * ridge      RSD_LANES positive floats, one per frequency
 * smooth     at least 0; if it is not 0, coupled[J] must be less than J for J > 0
 */
rsd_status rsd_rowwise_solve(const rsd_rowwise_model *model, const float *table, const float *ridge, float smooth,
                             const float *data, float *latent, size_t channels, float *workspace);

#endif
