#include <math.h>
#include <string.h>

#include "internal.h"
#include "rsdeblur_kernels.h"

/* Factors of what shrinking leaves of the first derivatives, of the second ones and of the mixed one, and factors of
 * their thresholds: see rsdeblur.kernels.shrink. */
#define FIRST 0.5f
#define SECOND 0.125f
#define TWIST 0.25f
#define BENDING 2.0f
#define MIXED 1.41421356237309505f
/* Derivatives that are shortened together: two AVX-512 vectors of values. */
#define RUN 32

/* Rows are split into planes of width + 2 values, one per channel, so that loops over all planes are SIMD code. Values
 * 1 to `width` are those of the row; the two others let neighbours be read beyond its ends. */
typedef struct {
    size_t width, channels, n; /* n: values of all planes together */
    int periodic;
    rsd_shrinkage shrinkage;
    float *factors; /* width + 2 */
} row_layout;

/* Let the first and the last value of each plane continue the row: by the last value before it, and by repetition or by
 * the last value again beyond it. */
static void continue_planes(const row_layout *l, float *planes)
{
    for (size_t c = 0; c < l->channels; c++) {
        float *plane = planes + c * (l->width + 2);
        plane[0] = plane[l->width];
        plane[l->width + 1] = plane[l->periodic ? 1 : l->width];
    }
}

RSD_CLONES
static void load3(const float *restrict row, size_t width, float *restrict red, float *restrict green,
                  float *restrict blue)
{
    for (size_t x = 0; x < width; x++) {
        red[x] = row[3 * x];
        green[x] = row[3 * x + 1];
        blue[x] = row[3 * x + 2];
    }
}

static void load(const row_layout *l, const float *row, float *planes)
{
    const size_t pitch = l->width + 2;
    if (l->channels == 1)
        memcpy(planes + 1, row, l->width * sizeof *row);
    else if (l->channels == 3)
        load3(row, l->width, planes + 1, planes + pitch + 1, planes + 2 * pitch + 1);
    else
        for (size_t c = 0; c < l->channels; c++)
            for (size_t x = 0; x < l->width; x++)
                planes[c * pitch + 1 + x] = row[x * l->channels + c];
    continue_planes(l, planes);
}

RSD_CLONES
static void subtract(const float *restrict minuends, const float *restrict subtrahends, float *restrict out, size_t n)
{
    for (size_t i = 0; i < n; i++)
        out[i] = minuends[i] - subtrahends[i];
}

/* Compute the horizontal differences of planes, forward or, for the adjoint, backward. */
static void differ(const row_layout *l, const float *planes, float *out)
{
    subtract(planes + 1, planes, out, l->n - 1);
    continue_planes(l, out);
}

static void differ_back(const row_layout *l, const float *planes, float *out)
{
    subtract(planes, planes + 1, out + 1, l->n - 1);
    continue_planes(l, out);
}

/* Compute the second difference of rows, -1, 2, -1. */
RSD_CLONES
static void bend(const float *restrict above, const float *restrict here, const float *restrict below,
                 float *restrict out, size_t n)
{
    for (size_t i = 0; i < n; i++)
        out[i] = (here[i] - above[i]) - (below[i] - here[i]);
}

RSD_CLONES
static void add_squares(const float *restrict plane, float *restrict squares, size_t n)
{
    for (size_t x = 0; x < n; x++)
        squares[x] += plane[x] * plane[x];
}

/* Whether any of RUN squares is larger than `bound`, or not a number. Without the sign, floats are ordered like their
 * bits as integers; GCC makes no SIMD code of a comparison of floats here. */
static inline bool any_larger(const float *squares, float bound)
{
    uint32_t least, signs = 0;
    memcpy(&least, &bound, sizeof least);
    for (size_t x = 0; x < RUN; x++) {
        uint32_t bits;
        memcpy(&bits, squares + x, sizeof bits);
        signs |= least - (bits & 0x7fffffffu);
    }
    return signs >> 31;
}

/* Replace squared magnitudes by the factors by which such vectors are shortened. A polynomial of some terms takes a
 * quarter of the time of a table, whose entries would have to be gathered. */
static inline void replace_by_factors(float *restrict squares, size_t n, float threshold,
                                      const float *restrict polynomial)
{
    const float least = threshold * threshold;
    for (size_t x = 0; x < n; x++) {
        const float square = squares[x] > least ? squares[x] : least;
        const float at = 2.0f * (threshold / sqrtf(square)) - 1.0f;
        float factor = polynomial[RSD_SHRINK_TERMS - 1];
        for (int k = RSD_SHRINK_TERMS - 2; k >= 0; k--)
            factor = factor * at + polynomial[k];
        squares[x] = squares[x] > least ? factor : 0.0f;
    }
}

/* Most derivatives of a picture vanish, most of them beside others that do: such runs need no polynomial. */
RSD_CLONES
static void fill_factors(float *restrict squares, size_t n, float threshold, const float *restrict polynomial)
{
    const float least = threshold * threshold;
    size_t x = 0;
    /* For a constant length the compiler generates straight vector code. */
    for (; x + RUN <= n; x += RUN)
        if (any_larger(squares + x, least))
            replace_by_factors(squares + x, RUN, threshold, polynomial);
        else
            memset(squares + x, 0, RUN * sizeof *squares);
    replace_by_factors(squares + x, n - x, threshold, polynomial);
}

/* Shorten up to RUN numbers. */
static inline void shorten_run(float *restrict values, size_t n, float threshold, const float *restrict polynomial)
{
    float factors[RUN] = {0.0f};
    for (size_t i = 0; i < n; i++)
        factors[i] = values[i] * values[i];
    if (!any_larger(factors, threshold * threshold)) {
        memset(values, 0, n * sizeof *values);
        return;
    }
    replace_by_factors(factors, RUN, threshold, polynomial);
    for (size_t i = 0; i < n; i++)
        values[i] *= factors[i];
}

/* Shorten numbers, which are vectors of one part, in one pass. */
RSD_CLONES
static void shorten_numbers(float *restrict values, size_t n, float threshold, const float *restrict polynomial)
{
    size_t x = 0;
    for (; x + RUN <= n; x += RUN)
        shorten_run(values + x, RUN, threshold, polynomial);
    shorten_run(values + x, n - x, threshold, polynomial);
}

RSD_CLONES
static void scale(float *restrict plane, const float *restrict factors, size_t n)
{
    for (size_t x = 0; x < n; x++)
        plane[x] *= factors[x];
}

/* Shorten vectors, whose parts are the planes of `one` and, unless it is null, of `other`. */
static void shorten(const row_layout *l, float threshold, float *one, float *other)
{
    const size_t pitch = l->width + 2;
    float *const parts[2] = {one, other};
    const size_t count = other == NULL ? 1 : 2;
    if (count * l->channels == 1) {
        shorten_numbers(one, pitch, threshold, l->shrinkage.polynomial);
        return;
    }
    for (size_t x = 0; x < pitch; x++)
        l->factors[x] = 0.0f;
    for (size_t p = 0; p < count; p++)
        for (size_t c = 0; c < l->channels; c++)
            add_squares(parts[p] + c * pitch, l->factors, pitch);
    fill_factors(l->factors, pitch, threshold, l->shrinkage.polynomial);
    for (size_t p = 0; p < count; p++)
        for (size_t c = 0; c < l->channels; c++)
            scale(parts[p] + c * pitch, l->factors, pitch);
}

/* Add to the flux FIRST flux what the bends of this row and the next one and the twist contribute. */
RSD_CLONES
static void add_down(float *restrict flux, const float *restrict before, const float *restrict after,
                     const float *restrict twist, size_t n)
{
    for (size_t i = 1; i < n; i++)
        flux[i] = FIRST * flux[i] + SECOND * (after[i] - before[i]) + TWIST * (twist[i - 1] - twist[i]);
}

RSD_CLONES
static void add_across(float *restrict flux, const float *restrict bow, size_t n)
{
    for (size_t i = 0; i + 1 < n; i++)
        flux[i] = FIRST * flux[i] + SECOND * (bow[i + 1] - bow[i]);
}

/* Apply the adjoint of the differences to fluxes: across, and down in the row above and in this one. */
RSD_CLONES
static void apply_adjoint(const float *restrict across, const float *restrict above, const float *restrict here,
                          float *restrict out, size_t n)
{
    for (size_t i = 1; i < n; i++)
        out[i] = (across[i - 1] - across[i]) + (above[i] - here[i]);
}

RSD_CLONES
static void store3(const float *restrict red, const float *restrict green, const float *restrict blue, size_t width,
                   float *restrict row)
{
    for (size_t x = 0; x < width; x++) {
        row[3 * x] = red[x];
        row[3 * x + 1] = green[x];
        row[3 * x + 2] = blue[x];
    }
}

static void store(const row_layout *l, const float *planes, float *row)
{
    const size_t pitch = l->width + 2;
    if (l->channels == 1)
        memcpy(row, planes + 1, l->width * sizeof *row);
    else if (l->channels == 3)
        store3(planes + 1, planes + pitch + 1, planes + 2 * pitch + 1, l->width, row);
    else
        for (size_t c = 0; c < l->channels; c++)
            for (size_t x = 0; x < l->width; x++)
                row[x * l->channels + c] = planes[c * pitch + 1 + x];
}

static void swap(float **a, float **b)
{
    float *const kept = *a;
    *a = *b;
    *b = kept;
}

/* Return row y of a picture, or the row that continues it beyond its ends. */
static const float *row_at(rsd_picture picture, ptrdiff_t y)
{
    const ptrdiff_t height = (ptrdiff_t)picture.height;
    const ptrdiff_t nearest = y < 0 ? 0 : y < height ? y : height - 1;
    const ptrdiff_t row = picture.periodic ? ((y % height) + height) % height : nearest;
    return picture.values + (size_t)row * picture.width * picture.channels;
}

/* Check the arguments. Return whether there is something to do; then `l` is filled, and the planes of the workspace are
 * clear except the first one. */
static bool prepare(rsd_picture picture, size_t top, size_t rows, rsd_shrinkage shrinkage, float *workspace,
                    const float *out, row_layout *l, rsd_status *status)
{
    *status = RSD_OK;
    if (picture.height == 0 || picture.width == 0 || picture.channels == 0 || rows == 0)
        return false;
    if (picture.values == NULL || shrinkage.polynomial == NULL || workspace == NULL || out == NULL)
        *status = RSD_NULL;
    else if (picture.width > PTRDIFF_MAX / 4 || !rsd_addressable(picture.channels, picture.width + 2) ||
             !rsd_addressable(RSD_SHRINK_PLANES * picture.channels, picture.width + 2) ||
             !rsd_addressable(picture.height, picture.channels * picture.width) || top > picture.height ||
             rows > picture.height - top)
        *status = RSD_SIZE;
    if (*status != RSD_OK)
        return false;
    const size_t n = picture.channels * (picture.width + 2);
    *l = (row_layout){picture.width, picture.channels, n, picture.periodic, shrinkage, workspace};
    for (size_t i = 0; i < (RSD_SHRINK_PLANES - 1) * n; i++)
        workspace[n + i] = 0.0f;
    return true;
}

rsd_status rsd_shrunk_grad_adjoint(rsd_picture picture, size_t top, size_t rows, rsd_shrinkage shrinkage,
                                   float *workspace, float *out)
{
    row_layout l;
    rsd_status status;
    if (!prepare(picture, top, rows, shrinkage, workspace, out, &l, &status))
        return status;
    float *here = workspace + l.n, *below = here + l.n, *across = below + l.n;
    /* Vertical part of w in the previous and in the current row; above the first one there is none. */
    float *above = across + l.n, *down = above + l.n;
    const ptrdiff_t first = top > 0 || picture.periodic ? (ptrdiff_t)top - 1 : 0, end = (ptrdiff_t)(top + rows);
    load(&l, row_at(picture, first), here);
    for (ptrdiff_t y = first; y < end; y++) {
        load(&l, row_at(picture, y + 1), below);
        differ(&l, here, across);
        subtract(below, here, down, l.n);
        shorten(&l, shrinkage.threshold, across, down);
        if (y >= (ptrdiff_t)top) {
            apply_adjoint(across, above, down, here, l.n);
            store(&l, here, out + (size_t)y * l.width * l.channels);
        }
        swap(&above, &down);
        swap(&here, &below);
    }
    return RSD_OK;
}

rsd_status rsd_shrunk_derivatives_adjoint(rsd_picture picture, size_t top, size_t rows, rsd_shrinkage shrinkage,
                                          float *workspace, float *out)
{
    row_layout l;
    rsd_status status;
    if (!prepare(picture, top, rows, shrinkage, workspace, out, &l, &status))
        return status;
    const float threshold = shrinkage.threshold, bending = BENDING * threshold;
    float *here = workspace + l.n, *below = here + l.n, *beyond = below + l.n;
    /* Second vertical difference of this row and of the next one; fluxes down, whose differences are the output. */
    float *bent = beyond + l.n, *next_bent = bent + l.n, *above = next_bent + l.n, *flux = above + l.n;
    float *across = flux + l.n, *bow = across + l.n; /* `bow` holds the mixed difference first */
    const ptrdiff_t first = top > 0 || picture.periodic ? (ptrdiff_t)top - 1 : 0, end = (ptrdiff_t)(top + rows);
    load(&l, row_at(picture, first - 1), beyond);
    load(&l, row_at(picture, first), here);
    load(&l, row_at(picture, first + 1), below);
    bend(beyond, here, below, bent, l.n);
    shorten(&l, bending, bent, NULL);
    for (ptrdiff_t y = first; y < end; y++) {
        load(&l, row_at(picture, y + 2), beyond);
        bend(here, below, beyond, next_bent, l.n);
        shorten(&l, bending, next_bent, NULL);
        subtract(below, here, flux, l.n);
        differ(&l, flux, bow);
        shorten(&l, MIXED * threshold, bow, NULL);
        shorten(&l, threshold, flux, NULL);
        add_down(flux, bent, next_bent, bow, l.n);
        if (y + 1 == (ptrdiff_t)picture.height && !picture.periodic)
            for (size_t i = 0; i < l.n; i++)
                flux[i] = 0.0f;
        if (y >= (ptrdiff_t)top) {
            differ(&l, here, across);
            differ_back(&l, across, bow);
            shorten(&l, bending, bow, NULL);
            shorten(&l, threshold, across, NULL);
            add_across(across, bow, l.n);
            continue_planes(&l, across);
            apply_adjoint(across, above, flux, here, l.n);
            store(&l, here, out + (size_t)y * l.width * l.channels);
        }
        swap(&above, &flux);
        swap(&bent, &next_bent);
        float *const read = here;
        here = below, below = beyond, beyond = read;
    }
    return RSD_OK;
}
