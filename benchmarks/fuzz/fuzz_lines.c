/* libFuzzer's harness for the kernels that move and multiply lines; see docs/developer/reliability.md. */
#include "input.h"
#include "rsdeblur_kernels.h"

/* An array of lines whose layout the input chooses: lines may be longer than they must be, or absurd. */
typedef struct {
    rsd_layout layout;
    float *values;
    size_t n;
    int absurd;
} lines_of;

/* Return `planes` x `count` lines of `length` values of `parts` floats. */
static lines_of lines(rsd_input *input, size_t planes, size_t count, size_t length, size_t parts)
{
    lines_of result;
    const size_t line = length + below(input, 3), plane = count * line + below(input, 3);
    result.n = planes && count ? ((planes - 1) * plane + (count - 1) * line + length) * parts : 0;
    result.values = floats(input, result.n);
    result.layout.line = or_huge(input, line);
    result.layout.plane = or_huge(input, plane);
    /* A stride that no line follows is not used. */
    result.absurd = planes > 0 && count > 0 && length > 0 &&
                    ((result.layout.line != line && count > 1) || (result.layout.plane != plane && planes > 1));
    return result;
}

static rsd_tile tile_of(rsd_input *input, const float *fade, size_t length, size_t taper)
{
    const rsd_tile tile = {.start = (ptrdiff_t)or_huge(input, (size_t)((ptrdiff_t)next(input) - 128)),
                           .length = length,
                           .fade = fade,
                           .taper = taper,
                           .periodic = next(input) & 1};
    return tile;
}

/* Absurd layouts of arrays that are used must be refused: the arrays are smaller than they claim. Frees the copy. */
static void conclude(rsd_status status, int absurd, const float *values, float *copy, size_t n)
{
    if (absurd && status == RSD_OK)
        abort();
    check_refused(status != RSD_OK, values, copy, n);
}

static void fuzz_spectra(rsd_input *input, size_t channels, size_t count, size_t n)
{
    lines_of to = lines(input, 1, channels * count, n, 2), from = lines(input, 1, channels * count, n, 2);
    float *weights = floats(input, n), *copy = copied(to.values, to.n);
    rsd_status status = rsd_blend_lines(to.values, from.values, weights, channels * count, n, to.layout.line,
                                        from.layout.line);
    conclude(status, to.absurd || from.absurd, to.values, copy, to.n);
    free(to.values), free(from.values), free(weights);

    float *spectra = floats(input, 2 * channels * n), *response = floats(input, 2 * n);
    const size_t claimed = or_huge(input, n);
    copy = copied(spectra, 2 * channels * n);
    status = rsd_spectral_multiply(spectra, response, channels, claimed);
    conclude(status, claimed != n && channels > 0, spectra, copy, 2 * channels * n);
    free(spectra), free(response);
}

static void fuzz_pictures(rsd_input *input, size_t channels, size_t rows, size_t width)
{
    const size_t length = below(input, 40), taper = below(input, 12);
    float *picture = floats(input, rows * width * channels), *fade = floats(input, taper);
    lines_of out = lines(input, channels, rows, length, 1);
    float *copy = copied(out.values, out.n);
    int finite = 2;
    rsd_status status = rsd_picture_to_lines(picture, rows, width, channels, tile_of(input, fade, length, taper),
                                             out.values, out.layout, &finite);
    conclude(status, out.absurd && width > 0, out.values, copy, out.n);
    free(out.values), free(fade);

    const size_t n = below(input, width + 1), first = below(input, width - n + 1);
    lines_of in = lines(input, channels, rows, n, 1);
    float *weights = floats(input, n);
    copy = copied(picture, rows * width * channels);
    status = rsd_lines_to_picture(in.values, in.layout, rows, channels, weights, n, next(input) & 1,
                                  picture + first * channels, width);
    conclude(status, in.absurd, picture, copy, rows * width * channels);
    free(in.values), free(weights), free(picture);
}

static void fuzz_transposition(rsd_input *input, size_t channels, size_t height, size_t count)
{
    lines_of rows = lines(input, channels, height, count, 2), columns = lines(input, channels, count, height, 2);
    float *copy = copied(columns.values, columns.n);
    rsd_status status = rsd_rows_to_columns(rows.values, rows.layout, columns.values, columns.layout, channels, height,
                                            count);
    conclude(status, rows.absurd || columns.absurd, columns.values, copy, columns.n);
    if (status == RSD_OK) {
        copy = copied(rows.values, rows.n);
        status = rsd_columns_to_rows(columns.values, columns.layout, rows.values, rows.layout, channels, height, count);
        /* Back again: no bit may have changed. */
        check_refused(1, rows.values, copy, rows.n);
        if (status != RSD_OK)
            abort();
    }
    free(rows.values), free(columns.values);
}

static void fuzz_cuts(rsd_input *input, size_t channels, size_t count, size_t n)
{
    const size_t length = below(input, 40), taper = below(input, 12);
    lines_of from = lines(input, channels, count, n, 2), to = lines(input, channels, count, length, 2);
    float *fade = floats(input, taper), *copy = copied(to.values, to.n);
    const rsd_status status = rsd_cut_lines(from.values, from.layout, n, tile_of(input, fade, length, taper), to.values,
                                            to.layout, channels, count);
    conclude(status, n > 0 && length > 0 && (from.absurd || to.absurd), to.values, copy, to.n);
    free(from.values), free(to.values), free(fade);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    rsd_input input = {data, size};
    const uint8_t kind = next(&input);
    const size_t channels = below(&input, 5), count = below(&input, 40), n = below(&input, 40);
    switch (kind % 4) {
    case 0:
        fuzz_spectra(&input, channels, count, n);
        break;
    case 1:
        fuzz_pictures(&input, channels, count % 9, n);
        break;
    case 2:
        fuzz_transposition(&input, channels, count, n);
        break;
    default:
        fuzz_cuts(&input, channels, count % 9, n);
    }
    return 0;
}
