/* Laws of the arithmetic kernels; exits with 1 if any fails. */
#include "check.h"

/* A few roundings of values in [-2, 2]. */
#define TOLERANCE 1e-6

static void test_multiply(size_t channels, size_t n)
{
    const size_t floats = 2 * channels * n;
    float *spectra = noise(floats, 1), *before = noise(floats, 1), *response = noise(2 * n, 2);
    CHECK(rsd_spectral_multiply(spectra, response, channels, n) == RSD_OK);
    for (size_t i = 0; i < channels * n; i++) {
        const double re = before[2 * i], im = before[2 * i + 1];
        const double response_re = response[2 * (i % n)], response_im = response[2 * (i % n) + 1];
        CHECK(fabs(spectra[2 * i] - (re * response_re - im * response_im)) < TOLERANCE);
        CHECK(fabs(spectra[2 * i + 1] - (re * response_im + im * response_re)) < TOLERANCE);
    }
    free(spectra), free(before), free(response);
}

static void test_blend(size_t lines, size_t n, size_t skipped)
{
    const size_t stride = n + skipped;
    float *sum = noise(2 * lines * stride, 3), *before = noise(2 * lines * stride, 3);
    float *slab = noise(2 * lines * n, 4), *weights = noise(n, 5);
    /* Adding at the end of the last line must not touch anything beyond it. */
    CHECK(rsd_blend_lines(sum + 2 * skipped, slab, weights, lines, n, stride, n) == RSD_OK);
    for (size_t l = 0; l < lines; l++)
        for (size_t i = 0; i < 2 * stride; i++) {
            const size_t at = 2 * l * stride + i;
            const double added =
                i < 2 * skipped ? 0.0 : (double)weights[i / 2 - skipped] * slab[2 * l * n + i - 2 * skipped];
            CHECK(fabs(sum[at] - (before[at] + added)) < TOLERANCE);
        }
    free(sum), free(before), free(slab), free(weights);
}

static void test_refusals(void)
{
    float a[4] = {1, 2, 3, 4}, b[4] = {1, 2, 3, 4};
    CHECK(rsd_spectral_multiply(NULL, b, 1, 2) == RSD_NULL);
    CHECK(rsd_spectral_multiply(a, NULL, 1, 2) == RSD_NULL);
    CHECK(rsd_spectral_multiply(a, b, 1, SIZE_MAX / 2 + 1) == RSD_SIZE);
    CHECK(rsd_spectral_multiply(a, b, SIZE_MAX / 4, 2) == RSD_SIZE);
    CHECK(rsd_spectral_multiply(NULL, NULL, 0, 2) == RSD_OK);
    CHECK(rsd_blend_lines(NULL, b, b, 1, 1, 1, 1) == RSD_NULL);
    CHECK(rsd_blend_lines(a, NULL, b, 1, 1, 1, 1) == RSD_NULL);
    CHECK(rsd_blend_lines(a, b, NULL, 1, 1, 1, 1) == RSD_NULL);
    CHECK(rsd_blend_lines(a, b, b, 2, 2, 1, 2) == RSD_SIZE);
    CHECK(rsd_blend_lines(a, b, b, 2, 2, 2, 1) == RSD_SIZE);
    CHECK(rsd_blend_lines(a, b, b, 1, SIZE_MAX / 2, 1, 1) == RSD_SIZE);
    CHECK(rsd_blend_lines(a, b, b, SIZE_MAX / 2, 1, 1, 1) == RSD_SIZE);
    CHECK(rsd_blend_lines(NULL, NULL, NULL, 1, 0, 1, 1) == RSD_OK);
    for (int i = 0; i < 4; i++)
        CHECK(a[i] == (float)(i + 1)); /* a refused call writes nothing */
}

int main(void)
{
    /* Lengths on both sides of every vector width. */
    for (size_t n = 0; n <= 40; n++) {
        test_multiply(1, n);
        test_multiply(3, n);
        test_blend(1, n, 0);
        test_blend(5, n, 3);
    }
    test_refusals();
    CHECK(strlen(rsd_simd_level()) > 0);
    for (int status = RSD_OK; status <= RSD_SIZE + 1; status++)
        CHECK(strlen(rsd_status_message((rsd_status)status)) > 0);
    printf("spectral kernels (%s): %d failures\n", rsd_simd_level(), failures);
    return failures != 0;
}
