/* Laws of the kernels that move lines; exits with 1 if any fails. */
#include "check.h"

/* Two roundings of values in [-1, 1]. */
#define TOLERANCE 1e-6

/* Return the position within 0 to n - 1 whose value continues a line of n values at `position`, found step by step. */
static size_t walk(ptrdiff_t position, size_t n, int periodic)
{
    size_t at = 0;
    int forward = 1;
    const ptrdiff_t step = position < 0 ? -1 : 1;
    for (ptrdiff_t k = 0; k != position; k += step) {
        const int up = periodic || forward ? step > 0 : step < 0;
        if (up && at + 1 == n) {
            at = periodic ? 0 : at;
            forward = !forward;
        } else if (!up && at == 0) {
            at = periodic ? n - 1 : at;
            forward = !forward;
        } else
            at = up ? at + 1 : at - 1;
    }
    return at;
}

/* Return the value of a tile at k, computed one position at a time. */
static double expected(const float *source, size_t step, size_t n, rsd_tile tile, size_t k)
{
    const double value = source[walk(tile.start + (ptrdiff_t)k, n, tile.periodic) * step];
    if (k < tile.length - tile.taper)
        return value;
    const ptrdiff_t position = tile.start + (ptrdiff_t)k - (ptrdiff_t)tile.length;
    const double before = source[walk(position, n, tile.periodic) * step];
    return value + tile.fade[k - (tile.length - tile.taper)] * (before - value);
}

static void test_picture_to_lines(size_t width, size_t channels, rsd_tile tile)
{
    const size_t rows = 2;
    float *picture = noise(rows * width * channels, 1), *lines = noise(channels * rows * tile.length, 2);
    int finite = 0;
    const rsd_layout layout = {rows * tile.length, tile.length};
    CHECK(rsd_picture_to_lines(picture, rows, width, channels, tile, lines, layout, &finite) == RSD_OK);
    CHECK(finite == 1);
    for (size_t c = 0; c < channels; c++)
        for (size_t r = 0; r < rows; r++)
            for (size_t k = 0; k < tile.length; k++) {
                const double reference = expected(picture + r * width * channels + c, channels, width, tile, k);
                CHECK(fabs(lines[(c * rows + r) * tile.length + k] - reference) < TOLERANCE);
            }
    free(picture), free(lines);
}

static void test_cut_lines(size_t n, rsd_tile tile)
{
    const size_t channels = 2, count = 3;
    float *source = noise(2 * channels * count * n, 3), *lines = noise(2 * channels * count * tile.length, 4);
    const rsd_layout source_layout = {count * n, n}, layout = {count * tile.length, tile.length};
    CHECK(rsd_cut_lines(source, source_layout, n, tile, lines, layout, channels, count) == RSD_OK);
    for (size_t l = 0; l < channels * count; l++)
        for (size_t k = 0; k < tile.length; k++)
            for (size_t part = 0; part < 2; part++) {
                const double reference = expected(source + 2 * l * n + part, 2, n, tile, k);
                CHECK(fabs(lines[2 * (l * tile.length + k) + part] - reference) < TOLERANCE);
            }
    free(source), free(lines);
}

static void test_transposition(size_t height, size_t count)
{
    const size_t channels = 2, stride = count + 3;
    const rsd_layout row_layout = {height * stride, stride}, column_layout = {count * height, height};
    float *rows = noise(2 * channels * height * stride, 5), *back = noise(2 * channels * height * stride, 5);
    float *columns = noise(2 * channels * count * height, 6);
    /* Columns at the end of the rows, so that an access beyond the last one is an error. */
    CHECK(rsd_rows_to_columns(rows + 6, row_layout, columns, column_layout, channels, height, count) == RSD_OK);
    for (size_t c = 0; c < channels; c++)
        for (size_t y = 0; y < height; y++)
            for (size_t i = 0; i < 2 * count; i++) {
                const size_t at = 2 * (c * height + y) * stride + 6 + i;
                CHECK(columns[2 * ((c * count + i / 2) * height + y) + i % 2] == rows[at]);
                rows[at] = 7.0f;
            }
    CHECK(rsd_columns_to_rows(columns, column_layout, rows + 6, row_layout, channels, height, count) == RSD_OK);
    CHECK(memcmp(rows, back, 2 * channels * height * stride * sizeof *rows) == 0);
    free(rows), free(back), free(columns);
}

static void test_lines_to_picture(size_t n, size_t channels, int add)
{
    const size_t rows = 2, width = n + 3;
    float *lines = noise(channels * rows * n, 7), *weights = noise(n, 8);
    float *picture = noise(rows * width * channels, 9), *before = noise(rows * width * channels, 9);
    const rsd_layout layout = {rows * n, n};
    CHECK(rsd_lines_to_picture(lines, layout, rows, channels, weights, n, add, picture + 3 * channels, width) ==
          RSD_OK);
    for (size_t r = 0; r < rows; r++)
        for (size_t x = 0; x < width; x++)
            for (size_t c = 0; c < channels; c++) {
                const size_t at = (r * width + x) * channels + c;
                double reference = before[at];
                if (x >= 3)
                    reference = (add ? reference : 0.0) + (double)weights[x - 3] * lines[(c * rows + r) * n + x - 3];
                CHECK(fabs(picture[at] - reference) < 2 * TOLERANCE);
            }
    free(lines), free(weights), free(picture), free(before);
}

static void test_finite(void)
{
    const float bad[] = {(float)NAN, (float)INFINITY, (float)-INFINITY};
    float picture[40] = {0}, line[10];
    const rsd_layout layout = {10, 10};
    int finite;
    for (size_t i = 0; i < 3; i++) {
        picture[20] = bad[i];
        for (ptrdiff_t start = 5; start < 25; start++) {
            const rsd_tile tile = {.start = start, .length = 10};
            CHECK(rsd_picture_to_lines(picture, 1, 40, 1, tile, line, layout, &finite) == RSD_OK);
            CHECK(finite == (start <= 10 || start > 20));
        }
    }
}

static void test_refusals(void)
{
    float a[8] = {1, 2, 3, 4, 5, 6, 7, 8}, b[8] = {0};
    const rsd_layout dense = {4, 4}, short_line = {4, 1}, huge = {PTRDIFF_MAX, PTRDIFF_MAX};
    const rsd_tile tile = {.start = 0, .length = 2}, far = {.start = PTRDIFF_MAX / 2, .length = 2};
    const rsd_tile faded = {.start = 0, .length = 2, .fade = NULL, .taper = 1};
    const rsd_tile all_fade = {.start = 0, .length = 2, .fade = b, .taper = 3};
    int finite;
    CHECK(rsd_picture_to_lines(b, 1, 2, 1, tile, a, dense, NULL) == RSD_NULL);
    CHECK(rsd_picture_to_lines(NULL, 1, 2, 1, tile, a, dense, &finite) == RSD_NULL);
    CHECK(rsd_picture_to_lines(b, 1, 2, 1, tile, NULL, dense, &finite) == RSD_NULL);
    CHECK(rsd_picture_to_lines(b, 1, 2, 1, faded, a, dense, &finite) == RSD_NULL);
    CHECK(rsd_picture_to_lines(b, 1, 2, 1, all_fade, a, dense, &finite) == RSD_SIZE);
    CHECK(rsd_picture_to_lines(b, 1, 2, 1, far, a, dense, &finite) == RSD_SIZE);
    CHECK(rsd_picture_to_lines(b, 2, 2, 1, tile, a, short_line, &finite) == RSD_SIZE);
    CHECK(rsd_picture_to_lines(b, 2, SIZE_MAX / 4, 4, tile, a, dense, &finite) == RSD_SIZE);
    CHECK(rsd_picture_to_lines(NULL, 0, 2, 1, tile, NULL, dense, &finite) == RSD_OK && finite == 1);
    CHECK(rsd_lines_to_picture(b, dense, 1, 1, NULL, 2, 0, a, 2) == RSD_NULL);
    CHECK(rsd_lines_to_picture(b, dense, 1, 1, b, 3, 0, a, 2) == RSD_SIZE);
    CHECK(rsd_lines_to_picture(b, huge, 2, 1, b, 2, 0, a, 2) == RSD_SIZE);
    CHECK(rsd_rows_to_columns(NULL, dense, a, dense, 1, 1, 1) == RSD_NULL);
    CHECK(rsd_rows_to_columns(b, short_line, a, dense, 1, 2, 2) == RSD_SIZE);
    CHECK(rsd_columns_to_rows(b, dense, NULL, dense, 1, 1, 1) == RSD_NULL);
    CHECK(rsd_columns_to_rows(b, huge, a, dense, 2, 2, 2) == RSD_SIZE);
    CHECK(rsd_cut_lines(b, dense, 2, tile, NULL, dense, 1, 1) == RSD_NULL);
    CHECK(rsd_cut_lines(b, dense, 2, far, a, dense, 1, 1) == RSD_SIZE);
    CHECK(rsd_cut_lines(b, dense, 2, tile, a, short_line, 1, 2) == RSD_SIZE);
    CHECK(rsd_cut_lines(NULL, dense, 0, tile, NULL, dense, 1, 1) == RSD_OK);
    for (int i = 0; i < 8; i++)
        CHECK(a[i] == (float)(i + 1)); /* a refused call writes nothing */
}

int main(void)
{
    const ptrdiff_t starts[] = {-70, -13, 0, 4, 25, 90};
    float *fade = noise(8, 10);
    for (size_t i = 0; i < 6; i++)
        for (int periodic = 0; periodic < 2; periodic++)
            for (size_t taper = 0; taper <= 8; taper += 4) {
                const rsd_tile tile = {starts[i], 21, fade, taper, periodic};
                for (size_t channels = 1; channels <= 4; channels++)
                    test_picture_to_lines(19, channels, tile);
                test_cut_lines(19, tile);
                test_cut_lines(60, tile);
                test_cut_lines(1, tile);
            }
    /* Sizes on both sides of the block and of the prefetch distance. */
    for (size_t count = 1; count <= 17; count += 4)
        for (size_t height = 1; height <= 61; height += 5)
            test_transposition(height, count);
    for (size_t n = 1; n <= 35; n++)
        for (int add = 0; add < 2; add++) {
            test_lines_to_picture(n, 1, add);
            test_lines_to_picture(n, 3, add);
        }
    test_finite();
    test_refusals();
    free(fade);
    printf("line kernels (%s): %d failures\n", rsd_simd_level(), failures);
    return failures != 0;
}
