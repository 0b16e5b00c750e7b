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

/* What two pictures add to the normal equations, and their solution. `first` ignores what is in the sums. */
static void test_normal(size_t channels, size_t columns, size_t length)
{
    const size_t n = columns * length;
    const float coupling[3] = {0.1f, 0.2f, 0.3f};
    float *spectra = noise(2 * channels * n, 10), *otf = noise(2 * n, 11), *pull = noise(2 * channels * n, 12);
    float *result = noise(2 * channels * n, 12), *across = noise(columns, 13), *down = noise(length, 14);
    float *signal = noise(2 * channels * n, 15), *power = noise(n, 16);
    const rsd_prior prior = {.nsr = 0.01f, .coupling = coupling, .pull = 0.5f, .across = across, .down = down};
    for (size_t i = 0; i < 2 * channels * n; i++)
        signal[i] = NAN;
    for (size_t i = 0; i < n; i++)
        power[i] = NAN;
    CHECK(rsd_add_normal(spectra, otf, 0.5f, 1, signal, power, channels, n) == RSD_OK);
    CHECK(rsd_add_normal(spectra, otf, 0.25f, 0, signal, power, channels, n) == RSD_OK);
    for (size_t k = 0; k < columns; k++) /* squared magnitudes are not negative */
        across[k] = fabsf(across[k]);
    for (size_t i = 0; i < length; i++)
        down[i] = fabsf(down[i]);
    CHECK(rsd_solve_normal(signal, power, prior, 2.0f, result, channels, columns, length) == RSD_OK);
    for (size_t i = 0; i < channels * n; i++) {
        const double h_re = otf[2 * (i % n)], h_im = otf[2 * (i % n) + 1];
        const double re = 0.75 * (h_re * spectra[2 * i] + h_im * spectra[2 * i + 1]);
        const double im = 0.75 * (h_re * spectra[2 * i + 1] - h_im * spectra[2 * i]);
        const double squared = (double)across[i % n / length] + down[i % length];
        const double normal =
            0.75 * (h_re * h_re + h_im * h_im) + 0.01 + 0.1 + squared * 0.2 + squared * squared * 0.3;
        CHECK(fabs(signal[2 * i] - re) < TOLERANCE && fabs(signal[2 * i + 1] - im) < TOLERANCE);
        /* Divisors are at least 0.11. */
        CHECK(fabs(result[2 * i] - 2.0 * (1.01 * re + 0.5 * pull[2 * i]) / normal) < 20 * TOLERANCE);
        CHECK(fabs(result[2 * i + 1] - 2.0 * (1.01 * im + 0.5 * pull[2 * i + 1]) / normal) < 20 * TOLERANCE);
    }
    free(spectra), free(otf), free(pull), free(result), free(across), free(down), free(signal), free(power);
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

/* The spectrum of a real line, from that of its pairs, which are sums over them; and back. */
static void test_pairs(size_t n, size_t skipped)
{
    const double turn = -3.14159265358979323846 / (double)n;
    const size_t stride = n + 1 + skipped;
    float *line = noise(2 * n, 6), *pairs = noise(2 * n, 7), *back = noise(2 * n, 7), *turns = noise(2 * n, 8);
    float *spectrum = noise(2 * stride, 9);
    for (size_t k = 0; k < n; k++) {
        double re = 0.0, im = 0.0;
        for (size_t j = 0; j < n; j++) {
            const double at = 2.0 * turn * (double)(j * k % n);
            re += line[2 * j] * cos(at) - line[2 * j + 1] * sin(at);
            im += line[2 * j] * sin(at) + line[2 * j + 1] * cos(at);
        }
        pairs[2 * k] = (float)re, pairs[2 * k + 1] = (float)im;
        turns[2 * k] = (float)cos(turn * (double)k), turns[2 * k + 1] = (float)sin(turn * (double)k);
    }
    CHECK(rsd_unpair(pairs, turns, spectrum, 1, n, stride) == RSD_OK);
    CHECK(rsd_pair(spectrum, turns, back, 1, n, stride) == RSD_OK);
    for (size_t k = 0; k < stride; k++) {
        double re = 0.0, im = 0.0;
        for (size_t j = 0; k <= n && j < 2 * n; j++) {
            const double at = turn * (double)(j * k % (2 * n));
            re += line[j] * cos(at), im += line[j] * sin(at);
        }
        CHECK(fabs(spectrum[2 * k] - re) < 1e-5 && fabs(spectrum[2 * k + 1] - im) < 1e-5); /* sums of 2 n values */
    }
    for (size_t i = 0; i < 2 * n; i++)
        CHECK(fabs(back[i] - 2.0 * pairs[i]) < 1e-5);
    free(line), free(pairs), free(back), free(turns), free(spectrum);
}

static void test_refusals(void)
{
    float a[4] = {1, 2, 3, 4}, b[4] = {1, 2, 3, 4};
    CHECK(rsd_spectral_multiply(NULL, b, 1, 2) == RSD_NULL);
    CHECK(rsd_spectral_multiply(a, NULL, 1, 2) == RSD_NULL);
    CHECK(rsd_spectral_multiply(a, b, 1, SIZE_MAX / 2 + 1) == RSD_SIZE);
    CHECK(rsd_spectral_multiply(a, b, SIZE_MAX / 4, 2) == RSD_SIZE);
    CHECK(rsd_spectral_multiply(NULL, NULL, 0, 2) == RSD_OK);
    const rsd_prior prior = {.coupling = b, .across = b, .down = b};
    rsd_prior empty = prior;
    empty.coupling = NULL;
    CHECK(rsd_add_normal(NULL, b, 1.0f, 1, a, a + 2, 1, 1) == RSD_NULL);
    CHECK(rsd_add_normal(b, NULL, 1.0f, 1, a, a + 2, 1, 1) == RSD_NULL);
    CHECK(rsd_add_normal(b, b, 1.0f, 1, NULL, a, 1, 1) == RSD_NULL);
    CHECK(rsd_add_normal(b, b, 1.0f, 1, a, NULL, 1, 1) == RSD_NULL);
    CHECK(rsd_add_normal(b, b, 1.0f, 1, a, a + 2, 1, SIZE_MAX / 2) == RSD_SIZE);
    CHECK(rsd_add_normal(b, b, 1.0f, 1, a, a + 2, SIZE_MAX / 4, 2) == RSD_SIZE);
    CHECK(rsd_add_normal(NULL, NULL, 1.0f, 1, NULL, NULL, 1, 0) == RSD_OK);
    CHECK(rsd_solve_normal(NULL, b, prior, 1.0f, a, 1, 1, 1) == RSD_NULL);
    CHECK(rsd_solve_normal(b, NULL, prior, 1.0f, a, 1, 1, 1) == RSD_NULL);
    CHECK(rsd_solve_normal(b, b, empty, 1.0f, a, 1, 1, 1) == RSD_NULL);
    CHECK(rsd_solve_normal(b, b, prior, 1.0f, NULL, 1, 1, 1) == RSD_NULL);
    CHECK(rsd_solve_normal(b, b, prior, 1.0f, a, 1, SIZE_MAX / 4, 2) == RSD_SIZE);
    CHECK(rsd_solve_normal(b, b, prior, 1.0f, a, 1, 2, SIZE_MAX / 4) == RSD_SIZE);
    CHECK(rsd_solve_normal(b, b, prior, 1.0f, a, SIZE_MAX / 4, 2, 1) == RSD_SIZE);
    CHECK(rsd_solve_normal(NULL, NULL, empty, 1.0f, NULL, 1, 1, 0) == RSD_OK);
    CHECK(rsd_blend_lines(NULL, b, b, 1, 1, 1, 1) == RSD_NULL);
    CHECK(rsd_blend_lines(a, NULL, b, 1, 1, 1, 1) == RSD_NULL);
    CHECK(rsd_blend_lines(a, b, NULL, 1, 1, 1, 1) == RSD_NULL);
    CHECK(rsd_blend_lines(a, b, b, 2, 2, 1, 2) == RSD_SIZE);
    CHECK(rsd_blend_lines(a, b, b, 2, 2, 2, 1) == RSD_SIZE);
    CHECK(rsd_blend_lines(a, b, b, 1, SIZE_MAX / 2, 1, 1) == RSD_SIZE);
    CHECK(rsd_blend_lines(a, b, b, SIZE_MAX / 2, 1, 1, 1) == RSD_SIZE);
    CHECK(rsd_blend_lines(NULL, NULL, NULL, 1, 0, 1, 1) == RSD_OK);
    CHECK(rsd_unpair(NULL, b, a, 1, 1, 2) == RSD_NULL);
    CHECK(rsd_unpair(b, NULL, a, 1, 1, 2) == RSD_NULL);
    CHECK(rsd_unpair(b, b, a, 1, 1, 1) == RSD_SIZE);
    CHECK(rsd_unpair(b, b, a, SIZE_MAX / 4, 1, 2) == RSD_SIZE);
    CHECK(rsd_pair(b, b, NULL, 1, 1, 2) == RSD_NULL);
    CHECK(rsd_pair(b, b, a, 1, 1, SIZE_MAX / 2) == RSD_SIZE);
    CHECK(rsd_pair(NULL, NULL, NULL, 1, 0, 0) == RSD_OK);
    for (int i = 0; i < 4; i++)
        CHECK(a[i] == (float)(i + 1)); /* a refused call writes nothing */
}

int main(void)
{
    /* Lengths on both sides of every vector width. */
    for (size_t n = 0; n <= 40; n++) {
        test_multiply(1, n);
        test_multiply(3, n);
        test_normal(1, 1, n);
        test_normal(3, 2, n);
        test_blend(1, n, 0);
        test_blend(5, n, 3);
        if (n > 0)
            test_pairs(n, n % 3);
    }
    test_normal(2, 2, 300); /* more than are worked on together */
    test_refusals();
    CHECK(strlen(rsd_simd_level()) > 0);
    for (int status = RSD_OK; status <= RSD_SIZE + 1; status++)
        CHECK(strlen(rsd_status_message((rsd_status)status)) > 0);
    printf("spectral kernels (%s): %d failures\n", rsd_simd_level(), failures);
    return failures != 0;
}
