/*
 * Numeric kernels of rsdeblur, independent of Python.
 *
 * Arrays are dense and row-major, of native float32 unless they say otherwise. A complex value is two floats, real part first. Sizes count the
 * elements that each comment names. The caller owns all memory; the kernels allocate, keep and free nothing. Arrays of
 * one call must not overlap. Functions are thread-safe on distinct outputs. With a size of zero, a function does
 * nothing and returns RSD_OK. If it returns anything else, it has written nothing.
 *
 * All SIMD levels give the same bits, because no operation is reordered or contracted. The rowwise kernels are the
 * exception: they use fused multiply-adds where the machine has them, and agree between levels up to rounding.
 */
#ifndef RSDEBLUR_KERNELS_H
#define RSDEBLUR_KERNELS_H

#include <stddef.h>
#include <stdint.h>

typedef enum {
    RSD_OK = 0,
    RSD_NULL = 1, /* a pointer is null although its array is not empty */
    RSD_SIZE = 2, /* a size overflows, or a stride is shorter than the line it spans */
    RSD_MODEL = 3 /* a table contains positions outside an array, or in a wrong order */
} rsd_status;

/* Return a line of English for a status, in static memory, never null. */
const char *rsd_status_message(rsd_status status);

/* Return the instruction set in use on this machine: "avx512f", "avx2" or "baseline" (the compiler's default). */
const char *rsd_simd_level(void);

/*
 * Multiply every channel of a spectrum by the frequency response of a filter, in place: spectra[c, i] *= response[i].
 *
 * spectra   channels x n complex
 * response  n complex
 */
rsd_status rsd_spectral_multiply(float *spectra, const float *response, size_t channels, size_t n);

/*
 * Add a picture's part to the normal equations: share conj(H) G to `signal` and share |H|^2 to `power`, or set them to
 * it if `first`.
 *
 * spectra   channels x n complex: G
 * otf       n complex: H
 * signal    channels x n complex
 * power     n floats
 */
rsd_status rsd_add_normal(const float *spectra, const float *otf, float share, int first, float *signal, float *power,
                          size_t channels, size_t n);

/* A prior that pulls; see rsdeblur.kernels.spectral.solve_normal_numpy. */
typedef struct {
    float nsr;
    const float *coupling; /* 3: weights of the picture, its gradient and its second derivatives */
    float pull;
    const float *across, *down; /* a float per column, and per place in a column: squared frequency responses */
} rsd_prior;

/*
 * Solve the normal equations of rsd_add_normal:
 *
 *     spectra = scale ((1 + nsr) signal + pull spectra) / (power + nsr + c0 + c1 d + c2 d^2),  d = across + down.
 *
 * signal    channels x columns x length complex
 * power     columns x length floats
 * spectra   as `signal`; spectra of the prior's pull, which the solution replaces
 */
rsd_status rsd_solve_normal(const float *signal, const float *power, rsd_prior prior, float scale, float *spectra,
                            size_t channels, size_t columns, size_t length);

/*
 * Add weighted lines of a slab to an accumulator: accumulator[l, i] += weights[i] * slab[l, i].
 *
 * accumulator  first complex value to change in line 0; line l starts l * accumulator_stride complex values later
 * slab         first complex value to read in line 0; line l starts l * slab_stride complex values later
 * weights      n floats
 */
rsd_status rsd_blend_lines(float *accumulator, const float *slab, const float *weights, size_t lines, size_t n,
                           size_t accumulator_stride, size_t slab_stride);

/*
 * A line of 2 n real values is transformed as n complex ones, pairs of neighbours, in half the time. From the spectrum
 * of the pairs follows that of the values, and back: FFTW's real transforms do the same, with less use of SIMD. The way
 * back is not scaled: the inverse transform of the pairs gives 2 n times the values. Of the first and the last
 * frequency it reads the real part.
 *
 * pairs     lines x n complex
 * turns     n complex, exp(-pi i k / n)
 * spectra   lines of n + 1 complex, `stride` complex values apart; `rsd_unpair` sets the values between them to zero
 */
rsd_status rsd_unpair(const float *pairs, const float *turns, float *spectra, size_t lines, size_t n, size_t stride);
rsd_status rsd_pair(const float *spectra, const float *turns, float *pairs, size_t lines, size_t n, size_t stride);

/* Positions of the lines of an array: line l of plane p starts p * plane + l * line values after the first value. */
typedef struct {
    size_t plane, line;
} rsd_layout;

/*
 * A tile reads `length` positions of a line of a picture, from `start` on. Any of them may lie beyond the picture,
 * where the line continues by reflection (border positions repeat) or, if `periodic`, by repetition. The last `taper`
 * positions fade, by the weights fade[taper], into the values before the start.
 */
typedef struct {
    ptrdiff_t start;
    size_t length;
    const float *fade;
    size_t taper;
    int periodic;
} rsd_tile;

/*
 * Copy a tile of picture rows into lines, one per channel (plane) and row.
 *
 * picture   rows x width x channels floats
 * lines     lines of tile.length floats
 * finite    output: whether all values read inside the picture are finite; 1 if the call is refused
 */
rsd_status rsd_picture_to_lines(const float *picture, size_t rows, size_t width, size_t channels, rsd_tile tile,
                                float *lines, rsd_layout layout, int *finite);

/*
 * Write lines, weighted by position, into picture rows, or add them if `add`.
 *
 * lines     lines of floats, one per channel (plane) and row; their first n values are read
 * weights   n floats
 * picture   first float to change in row 0; rows are width * channels floats apart
 */
rsd_status rsd_lines_to_picture(const float *lines, rsd_layout layout, size_t rows, size_t channels,
                                const float *weights, size_t n, int add, float *picture, size_t width);

/*
 * Transpose `count` columns of complex rows into complex lines of `height` values, and back.
 *
 * rows      `height` lines per channel (plane), of which the first `count` values are used
 * columns   `count` lines of `height` values per channel (plane)
 */
rsd_status rsd_rows_to_columns(const float *rows, rsd_layout row_layout, float *columns, rsd_layout column_layout,
                               size_t channels, size_t height, size_t count);
rsd_status rsd_columns_to_rows(const float *columns, rsd_layout column_layout, float *rows, rsd_layout row_layout,
                               size_t channels, size_t height, size_t count);

/*
 * Copy a tile of complex lines of n values. If the tile starts at 0 and no faded position lies among the n values
 * (tile.taper <= tile.length - n), `lines` may be `source`, which is then extended in place.
 */
rsd_status rsd_cut_lines(const float *source, rsd_layout source_layout, size_t n, rsd_tile tile, float *lines,
                         rsd_layout layout, size_t channels, size_t count);

/* A picture of height x width x channels floats, whose differences beyond its ends are zero or, if `periodic`, wrap
 * around. */
typedef struct {
    const float *values;
    size_t height, width, channels;
    int periodic;
} rsd_picture;

/* Number of coefficients of a shrinkage, and of planes of its workspace. */
#define RSD_SHRINK_TERMS 9
#define RSD_SHRINK_PLANES 10

/* Magnitudes up to `threshold` become 0. Others keep the share sum_k polynomial[k] (2 threshold / magnitude - 1)^k. */
typedef struct {
    float threshold;
    const float *polynomial;
} rsd_shrinkage;

/*
 * Compute the adjoint derivatives of the shrunk derivatives of `rows` rows of a picture, from row `top` on. All
 * channels of a pixel are one vector: of its gradient, whose two directions are one vector, or of its derivatives of
 * first and second order, each alone, with the factors of rsdeblur.kernels.shrink.
 *
 * workspace  RSD_SHRINK_PLANES x channels x (width + 2) floats
 * out        height x width x channels floats, of which only these rows are written
 */
rsd_status rsd_shrunk_grad_adjoint(rsd_picture picture, size_t top, size_t rows, rsd_shrinkage shrinkage,
                                   float *workspace, float *out);
rsd_status rsd_shrunk_derivatives_adjoint(rsd_picture picture, size_t top, size_t rows, rsd_shrinkage shrinkage,
                                          float *workspace, float *out);

/* Periodograms of tiles and their expectations; see rsdeblur.kernels.whittle. */
typedef struct {
    size_t tiles, frequencies, places, directions;
    const float *power, *noise; /* tiles x frequencies */
    const float *expected;      /* places x frequencies */
    const int32_t *place;       /* tiles: index of each tile's place */
    const int32_t *sectors;     /* first frequency of each direction, ascending, and the end of the last one */
} rsd_tiles;

/* Levels of the noise, and where the search for the gains begins under each of them. */
typedef struct {
    size_t count;
    const double *levels; /* count */
    const double *starts; /* tiles x count x 2: logarithms of the first gain, the same in all directions, and the least */
    double stiffness;
} rsd_gain_search;

/* Values of workspace per direction. */
#define RSD_FIT_TERMS 3

/*
 * Find the gains and the level of the noise under which the periodogram of each tile is most likely.
 *
 * workspace  RSD_FIT_TERMS x directions doubles
 * nats       tiles doubles: the negative log-likelihoods
 * gains      tiles x directions doubles
 * chosen     tiles doubles: the levels
 */
rsd_status rsd_fit_tiles(const rsd_tiles *tiles, rsd_gain_search search, double *workspace, double *nats,
                         double *gains, double *chosen);

/*
 * Rowwise: 16 frequencies at once, one per lane. A record is a complex value for all lanes: 16 real parts, then 16
 * imaginary parts. For each frequency k the blur is a matrix from latent rows j to picture rows y,
 *
 *     A[y, j] = sum over the taps of (j, y) of weight * phase(shift),
 *
 * where phase(shift) = exp(-2 pi i k shift / N) comes from a table. Block J consists of the latent rows 3 J to 3 J + 2.
 * Only the picture rows row_first[J] to row_end[J] - 1 see it.
 */
#define RSD_LANES 16
#define RSD_RECORD (2 * RSD_LANES)
#define RSD_BLOCK 3
/* Floats of a penalty p: for each frequency the weights of |u|^2, |D u|^2 and |D^T D u|^2, in this order. */
#define RSD_PENALTY (3 * RSD_LANES)

typedef struct {
    size_t rows, blocks, taps, phases;
    const int32_t *row_first, *row_end; /* blocks each */
    const int32_t *coupled;             /* blocks: first block that shares a picture row or a gradient with this one */
    const int32_t *tap_start;           /* first tap of each (j, y), j outermost, and at the end the number of taps */
    const int32_t *tap_shift;           /* taps: index into the phases */
    const float *tap_weight;            /* taps */
} rsd_rowwise_model;

/*
 * Return the floats of workspace that rsd_rowwise_forward and rsd_rowwise_adjoint need, or (if `solve`) the others; 0
 * if the model is invalid, or if that many cannot be addressed.
 */
size_t rsd_rowwise_workspace(const rsd_rowwise_model *model, int solve);
/* Return the floats of the assembled normal matrix A^H A; 0 as for the workspace. */
size_t rsd_rowwise_assembled_size(const rsd_rowwise_model *model);

/*
 * Compute data[c] = A latent[c], or the adjoint latent[c] = A^H data[c].
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
 * Solve (A^H A + p0 + p1 D^T D + p2 (D^T D)^2) u = A^H data + latent; u replaces latent. D takes the differences of
 * neighbouring latent rows. The method is banded Cholesky factorisation with forward and back substitution.
 *
 * penalty    RSD_PENALTY floats p, the first RSD_LANES positive, the others at least 0; if any of these is not 0,
 *            coupled[J] must be less than J for J > 0
 */
rsd_status rsd_rowwise_solve(const rsd_rowwise_model *model, const float *table, const float *penalty,
                             const float *data, float *latent, size_t channels, float *workspace);

/*
 * Assemble the normal matrix A^H A, which does not depend on a picture: for each block J and each block I from
 * coupled[J] to J nine records, the conjugates of the values at the rows of J (outer) and the columns of I.
 */
rsd_status rsd_rowwise_assemble(const rsd_rowwise_model *model, const float *table, float *normal, float *workspace);

/*
 * Solve (A^H A + p0 + p1 D^T D + p2 (D^T D)^2) u = latent with the assembled normal matrix; see rsd_rowwise_solve. That
 * pays where the matrix is used again and has many more rows of pictures than of u, as with several pictures.
 */
rsd_status rsd_rowwise_solve_assembled(const rsd_rowwise_model *model, const float *normal,
                                       const float *penalty, float *latent, size_t channels, float *workspace);

#endif
