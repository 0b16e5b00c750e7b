#include <string.h>

#include "internal.h"
#include "rsdeblur_kernels.h"

/* Eight complex values fill a cache line. */
#define BLOCK 8
/* Rows are kilobytes apart, which hardware prefetchers do not follow, so the kernels prefetch this many rows ahead. */
#define AHEAD 32
#ifdef __GNUC__
#define RSD_PREFETCH(address, for_writing) __builtin_prefetch(address, for_writing)
#else
#define RSD_PREFETCH(address, for_writing) ((void)0)
#endif

typedef struct {
    float re, im;
} complex_float;

/* Return the position within 0 to n - 1 whose value continues a line of n values at any `position`. */
static inline size_t continued(ptrdiff_t position, size_t n, bool periodic)
{
    /* Divisions are slow, and most positions lie inside. */
    if (position >= 0 && position < (ptrdiff_t)n)
        return (size_t)position;
    const ptrdiff_t period = periodic ? (ptrdiff_t)n : 2 * (ptrdiff_t)n;
    ptrdiff_t folded = position % period;
    if (folded < 0)
        folded += period;
    return (size_t)(folded < (ptrdiff_t)n ? folded : 2 * (ptrdiff_t)n - 1 - folded);
}

/* Find the positions `low` to `high - 1` of the tile that lie inside the picture. */
static void inside(size_t n, rsd_tile tile, size_t *low, size_t *high)
{
    const ptrdiff_t length = (ptrdiff_t)tile.length, end = (ptrdiff_t)n - tile.start;
    const ptrdiff_t first = tile.start >= 0 ? 0 : -tile.start < length ? -tile.start : length;
    *low = (size_t)first;
    *high = (size_t)(end < first ? first : end < length ? end : length);
}

/* Fill the positions of a line that lie beyond the picture, all but `low` to `high - 1`. Values are `width` floats
 * each, `step` floats apart in `source`. Only positions inside the picture are read from it, so it may be `line` itself
 * if the tile starts at 0. */
static void continue_line(const float *source, size_t n, size_t step, size_t width, rsd_tile tile, size_t low,
                          size_t high, float *line)
{
    for (size_t k = low > 0 ? 0 : high; k < tile.length; k = k + 1 == low ? high : k + 1) {
        const float *value = source + continued(tile.start + (ptrdiff_t)k, n, tile.periodic) * step;
        for (size_t i = 0; i < width; i++)
            line[k * width + i] = value[i];
    }
}

RSD_CLONES
static void fade_complex(float *line, const float *before, const float *fade, size_t n)
{
    for (size_t k = 0; k < n; k++) {
        line[2 * k] += fade[k] * (before[2 * k] - line[2 * k]);
        line[2 * k + 1] += fade[k] * (before[2 * k + 1] - line[2 * k + 1]);
    }
}

RSD_CLONES
static void fade_real(float *line, const float *before, size_t step, const float *fade, size_t n)
{
    for (size_t k = 0; k < n; k++)
        line[k] += fade[k] * (before[k * step] - line[k]);
}

/* Fade the last positions of a line into the values before its start. */
static void fade_line(const float *source, size_t n, size_t step, size_t width, rsd_tile tile, float *line)
{
    float *end = line + (tile.length - tile.taper) * width;
    const ptrdiff_t before = tile.start - (ptrdiff_t)tile.taper;
    if (before >= 0 && tile.start <= (ptrdiff_t)n && (width == 1 || step == 2)) {
        /* Nearly every line: all values lie inside the picture, one after the other. */
        if (width == 1)
            fade_real(end, source + step * (size_t)before, step, tile.fade, tile.taper);
        else
            fade_complex(end, source + step * (size_t)before, tile.fade, tile.taper);
        return;
    }
    for (size_t k = 0; k < tile.taper; k++) {
        const float *value = source + continued(before + (ptrdiff_t)k, n, tile.periodic) * step;
        for (size_t i = 0; i < width; i++)
            end[k * width + i] += tile.fade[k] * (value[i] - end[k * width + i]);
    }
}

RSD_CLONES
static bool all_finite(const float *values, size_t n)
{
    uint32_t bad = 0;
    for (size_t i = 0; i < n; i++) {
        uint32_t bits;
        memcpy(&bits, values + i, sizeof bits);
        bad |= (bits & 0x7f800000u) == 0x7f800000u;
    }
    return !bad;
}

RSD_CLONES
static void split3(const float *restrict pixels, size_t n, float *restrict red, float *restrict green,
                   float *restrict blue)
{
    for (size_t i = 0; i < n; i++) {
        red[i] = pixels[3 * i];
        green[i] = pixels[3 * i + 1];
        blue[i] = pixels[3 * i + 2];
    }
}

/* Copy one channel of pixels. */
static void pick(const float *restrict pixels, size_t channels, size_t n, float *restrict line)
{
    if (channels == 1)
        memcpy(line, pixels, n * sizeof *line);
    else
        for (size_t i = 0; i < n; i++)
            line[i] = pixels[i * channels];
}

/* Whether `planes` planes of `lines` lines of `length` values of `width` floats can be addressed and do not overlap. */
static bool valid_layout(rsd_layout layout, size_t planes, size_t lines, size_t length, size_t width)
{
    if (layout.line > PTRDIFF_MAX / 2 || layout.plane > PTRDIFF_MAX / 2)
        return false;
    if ((lines > 1 && layout.line < length) || (planes > 1 && layout.plane < (lines - 1) * layout.line + length))
        return false;
    return rsd_addressable(planes, width * layout.plane) && rsd_addressable(lines, width * layout.line) &&
           rsd_addressable(length, width);
}

static bool valid_tile(rsd_tile tile, size_t n)
{
    return tile.taper <= tile.length && tile.length <= PTRDIFF_MAX / 4 && n <= PTRDIFF_MAX / 4 &&
           tile.start >= -(PTRDIFF_MAX / 4) && tile.start <= PTRDIFF_MAX / 4;
}

rsd_status rsd_picture_to_lines(const float *picture, size_t rows, size_t width, size_t channels, rsd_tile tile,
                                float *lines, rsd_layout layout, int *finite)
{
    if (finite == NULL)
        return RSD_NULL;
    *finite = 1;
    if (rows == 0 || width == 0 || channels == 0 || tile.length == 0)
        return RSD_OK;
    if (picture == NULL || lines == NULL || (tile.fade == NULL && tile.taper > 0))
        return RSD_NULL;
    if (!valid_tile(tile, width) || !valid_layout(layout, channels, rows, tile.length, 1) ||
        !rsd_addressable(channels, width) || !rsd_addressable(rows, channels * width))
        return RSD_SIZE;
    size_t low, high;
    inside(width, tile, &low, &high);
    for (size_t r = 0; r < rows; r++) {
        const float *row = picture + r * width * channels;
        float *line = lines + r * layout.line;
        /* An address outside the row would be undefined, even unused, where the tile sees none of the picture. */
        const float *seen = low < high ? row + (size_t)(tile.start + (ptrdiff_t)low) * channels : row;
        if (channels == 3)
            split3(seen, high - low, line + low, line + layout.plane + low, line + 2 * layout.plane + low);
        else
            for (size_t c = 0; c < channels; c++)
                pick(seen + c, channels, high - low, line + c * layout.plane + low);
        for (size_t c = 0; c < channels; c++) {
            if (!all_finite(line + c * layout.plane + low, high - low))
                *finite = 0;
            continue_line(row + c, width, channels, 1, tile, low, high, line + c * layout.plane);
            fade_line(row + c, width, channels, 1, tile, line + c * layout.plane);
        }
    }
    return RSD_OK;
}

RSD_CLONES
static void merge3(float *restrict pixels, size_t n, const float *restrict red, const float *restrict green,
                   const float *restrict blue, const float *restrict weights)
{
    for (size_t i = 0; i < n; i++) {
        pixels[3 * i] = weights[i] * red[i];
        pixels[3 * i + 1] = weights[i] * green[i];
        pixels[3 * i + 2] = weights[i] * blue[i];
    }
}

RSD_CLONES
static void add3(float *restrict pixels, size_t n, const float *restrict red, const float *restrict green,
                 const float *restrict blue, const float *restrict weights)
{
    for (size_t i = 0; i < n; i++) {
        pixels[3 * i] += weights[i] * red[i];
        pixels[3 * i + 1] += weights[i] * green[i];
        pixels[3 * i + 2] += weights[i] * blue[i];
    }
}

RSD_CLONES
static void merge1(float *restrict pixels, size_t n, const float *restrict line, const float *restrict weights)
{
    for (size_t i = 0; i < n; i++)
        pixels[i] = weights[i] * line[i];
}

RSD_CLONES
static void add1(float *restrict pixels, size_t n, const float *restrict line, const float *restrict weights)
{
    for (size_t i = 0; i < n; i++)
        pixels[i] += weights[i] * line[i];
}

rsd_status rsd_lines_to_picture(const float *lines, rsd_layout layout, size_t rows, size_t channels,
                                const float *weights, size_t n, int add, float *picture, size_t width)
{
    if (rows == 0 || channels == 0 || n == 0)
        return RSD_OK;
    if (lines == NULL || weights == NULL || picture == NULL)
        return RSD_NULL;
    if (n > width || !valid_layout(layout, channels, rows, n, 1) || !rsd_addressable(channels, width) ||
        !rsd_addressable(rows, channels * width))
        return RSD_SIZE;
    for (size_t r = 0; r < rows; r++) {
        const float *line = lines + r * layout.line;
        float *row = picture + r * width * channels;
        if (channels == 3) {
            (add ? add3 : merge3)(row, n, line, line + layout.plane, line + 2 * layout.plane, weights);
            continue;
        }
        if (channels == 1) {
            (add ? add1 : merge1)(row, n, line, weights);
            continue;
        }
        for (size_t c = 0; c < channels; c++)
            for (size_t i = 0; i < n; i++) {
                const float value = weights[i] * line[c * layout.plane + i];
                row[i * channels + c] = add ? row[i * channels + c] + value : value;
            }
    }
    return RSD_OK;
}

/* Transpose `from` (rows x columns) into `to`. */
static inline void transpose(const complex_float *from, size_t from_stride, complex_float *to, size_t to_stride,
                             size_t rows, size_t columns)
{
    for (size_t j = 0; j < columns; j++)
        for (size_t i = 0; i < rows; i++)
            to[j * to_stride + i] = from[i * from_stride + j];
}

/* Transpose a block of at most BLOCK x BLOCK; for constant sizes the compiler generates vector shuffles. */
static inline void transpose_block(const complex_float *from, size_t from_stride, complex_float *to, size_t to_stride,
                                   size_t rows, size_t columns)
{
    if (rows == BLOCK && columns == BLOCK)
        transpose(from, from_stride, to, to_stride, BLOCK, BLOCK);
    else
        transpose(from, from_stride, to, to_stride, rows, columns);
}

RSD_CLONES
static void gather(const complex_float *restrict rows, size_t row_stride, complex_float *restrict columns,
                   size_t column_stride, size_t height, size_t count)
{
    for (size_t y = 0; y < height; y += BLOCK) {
        const size_t high = height - y < BLOCK ? height - y : BLOCK;
        for (size_t k = 0; k < high && y + k + AHEAD < height; k++)
            for (size_t j = 0; j < count; j += BLOCK)
                RSD_PREFETCH(rows + (y + k + AHEAD) * row_stride + j, 0);
        for (size_t j = 0; j < count; j += BLOCK)
            transpose_block(rows + y * row_stride + j, row_stride, columns + j * column_stride + y, column_stride, high,
                            count - j < BLOCK ? count - j : BLOCK);
    }
}

RSD_CLONES
static void scatter(const complex_float *restrict columns, size_t column_stride, complex_float *restrict rows,
                    size_t row_stride, size_t height, size_t count)
{
    for (size_t y = 0; y < height; y += BLOCK) {
        const size_t high = height - y < BLOCK ? height - y : BLOCK;
        for (size_t k = 0; k < high && y + k + AHEAD < height; k++)
            for (size_t j = 0; j < count; j += BLOCK)
                RSD_PREFETCH(rows + (y + k + AHEAD) * row_stride + j, 1);
        for (size_t j = 0; j < count; j += BLOCK)
            transpose_block(columns + j * column_stride + y, column_stride, rows + y * row_stride + j, row_stride,
                            count - j < BLOCK ? count - j : BLOCK, high);
    }
}

static rsd_status check_planes(const float *rows, rsd_layout row_layout, const float *columns,
                               rsd_layout column_layout, size_t channels, size_t height, size_t count)
{
    if (rows == NULL || columns == NULL)
        return RSD_NULL;
    const bool valid = valid_layout(row_layout, channels, height, count, 2) &&
                       valid_layout(column_layout, channels, count, height, 2);
    return valid ? RSD_OK : RSD_SIZE;
}

rsd_status rsd_rows_to_columns(const float *rows, rsd_layout row_layout, float *columns, rsd_layout column_layout,
                               size_t channels, size_t height, size_t count)
{
    if (channels == 0 || height == 0 || count == 0)
        return RSD_OK;
    const rsd_status status = check_planes(rows, row_layout, columns, column_layout, channels, height, count);
    for (size_t c = 0; status == RSD_OK && c < channels; c++)
        gather((const complex_float *)rows + c * row_layout.plane, row_layout.line,
               (complex_float *)columns + c * column_layout.plane, column_layout.line, height, count);
    return status;
}

rsd_status rsd_columns_to_rows(const float *columns, rsd_layout column_layout, float *rows, rsd_layout row_layout,
                               size_t channels, size_t height, size_t count)
{
    if (channels == 0 || height == 0 || count == 0)
        return RSD_OK;
    const rsd_status status = check_planes(rows, row_layout, columns, column_layout, channels, height, count);
    for (size_t c = 0; status == RSD_OK && c < channels; c++)
        scatter((const complex_float *)columns + c * column_layout.plane, column_layout.line,
                (complex_float *)rows + c * row_layout.plane, row_layout.line, height, count);
    return status;
}

rsd_status rsd_cut_lines(const float *source, rsd_layout source_layout, size_t n, rsd_tile tile, float *lines,
                         rsd_layout layout, size_t channels, size_t count)
{
    if (channels == 0 || count == 0 || n == 0 || tile.length == 0)
        return RSD_OK;
    if (source == NULL || lines == NULL || (tile.fade == NULL && tile.taper > 0))
        return RSD_NULL;
    if (!valid_tile(tile, n) || !valid_layout(source_layout, channels, count, n, 2) ||
        !valid_layout(layout, channels, count, tile.length, 2))
        return RSD_SIZE;
    size_t low, high;
    inside(n, tile, &low, &high);
    for (size_t c = 0; c < channels; c++)
        for (size_t j = 0; j < count; j++) {
            const float *from = source + 2 * (c * source_layout.plane + j * source_layout.line);
            float *line = lines + 2 * (c * layout.plane + j * layout.line);
            if (line != from && low < high)
                memcpy(line + 2 * low, from + 2 * (tile.start + (ptrdiff_t)low), 2 * (high - low) * sizeof *line);
            continue_line(from, n, 2, 2, tile, low, high, line);
            fade_line(from, n, 2, 2, tile, line);
        }
    return RSD_OK;
}
