/* Laws of the shrinkages of derivatives; the Python tests compare them with their twins. */
#include "check.h"

typedef rsd_status shrinking(rsd_picture, size_t, size_t, rsd_shrinkage, float *, float *);

static float *workspace_of(rsd_picture picture)
{
    return noise(RSD_SHRINK_PLANES * picture.channels * (picture.width + 2), 9);
}

/* Blocks of rows make the whole, and rows outside a block stay. */
static void test_blocks(shrinking *shrink, rsd_picture picture, rsd_shrinkage shrinkage)
{
    const size_t n = picture.height * picture.width * picture.channels, row = picture.width * picture.channels;
    float *whole = noise(n, 2), *parts = noise(n, 3), *before = noise(n, 3), *memory = workspace_of(picture);
    CHECK(shrink(picture, 0, picture.height, shrinkage, memory, whole) == RSD_OK);
    for (size_t top = 0; top < picture.height; top += 2) {
        const size_t rows = picture.height - top < 2 ? picture.height - top : 2;
        CHECK(shrink(picture, top, rows, shrinkage, memory, parts) == RSD_OK);
        for (size_t i = 0; i < n; i++)
            CHECK(parts[i] == (i < (top + rows) * row ? whole[i] : before[i]));
    }
    free(whole), free(parts), free(before), free(memory);
}

/* The pull is a sum of adjoint differences, which sums up to zero over a channel. With a threshold beyond all
 * derivatives it is zero. */
static void test_extremes(shrinking *shrink, rsd_picture picture)
{
    const float whole[RSD_SHRINK_TERMS] = {1.0f};
    const size_t n = picture.height * picture.width * picture.channels;
    float *out = noise(n, 4), *memory = workspace_of(picture);
    CHECK(shrink(picture, 0, picture.height, (rsd_shrinkage){1e-9f, whole}, memory, out) == RSD_OK);
    for (size_t c = 0; c < picture.channels; c++) {
        double sum = 0.0;
        for (size_t i = c; i < n; i += picture.channels)
            sum += out[i];
        CHECK(fabs(sum) < 1e-5 * (double)n); /* roundings of values up to 8 */
    }
    CHECK(shrink(picture, 0, picture.height, (rsd_shrinkage){100.0f, whole}, memory, out) == RSD_OK);
    for (size_t i = 0; i < n; i++)
        CHECK(out[i] == 0.0f);
    free(out), free(memory);
}

static void test_refusals(shrinking *shrink)
{
    float values[12] = {0}, out[12] = {0}, memory[RSD_SHRINK_PLANES * 6], polynomial[RSD_SHRINK_TERMS] = {1.0f};
    const rsd_picture picture = {values, 3, 4, 1, 0};
    rsd_picture other = picture;
    const rsd_shrinkage shrinkage = {0.1f, polynomial};
    other.values = NULL;
    CHECK(shrink(other, 0, 3, shrinkage, memory, out) == RSD_NULL);
    CHECK(shrink(picture, 0, 3, (rsd_shrinkage){0.1f, NULL}, memory, out) == RSD_NULL);
    CHECK(shrink(picture, 0, 3, shrinkage, NULL, out) == RSD_NULL);
    CHECK(shrink(picture, 0, 3, shrinkage, memory, NULL) == RSD_NULL);
    CHECK(shrink(picture, 4, 1, shrinkage, memory, out) == RSD_SIZE);
    CHECK(shrink(picture, 1, 3, shrinkage, memory, out) == RSD_SIZE);
    CHECK(shrink(picture, 1, SIZE_MAX, shrinkage, memory, out) == RSD_SIZE);
    other = picture, other.width = SIZE_MAX / 2;
    CHECK(shrink(other, 0, 3, shrinkage, memory, out) == RSD_SIZE);
    other = picture, other.channels = SIZE_MAX / 32;
    CHECK(shrink(other, 0, 3, shrinkage, memory, out) == RSD_SIZE);
    other = picture, other.height = SIZE_MAX / 4;
    CHECK(shrink(other, 0, 3, shrinkage, memory, out) == RSD_SIZE);
    CHECK(shrink((rsd_picture){0}, 0, 0, (rsd_shrinkage){0}, NULL, NULL) == RSD_OK);
    CHECK(shrink(picture, 1, 0, (rsd_shrinkage){0}, NULL, NULL) == RSD_OK);
}

int main(void)
{
    shrinking *const kernels[] = {rsd_shrunk_grad_adjoint, rsd_shrunk_derivatives_adjoint};
    const float polynomial[RSD_SHRINK_TERMS] = {0.8f, -0.2f, 0.05f};
    for (size_t k = 0; k < 2; k++) {
        /* Widths on both sides of every vector width, and of a run of derivatives. */
        for (size_t width = 1; width <= 40; width++)
            for (size_t height = 1; height <= 5; height += 2)
                for (size_t channels = 1; channels <= 4; channels++)
                    for (int periodic = 0; periodic < 2; periodic++) {
                        float *values = noise(height * width * channels, 1);
                        const rsd_picture picture = {values, height, width, channels, periodic};
                        test_blocks(kernels[k], picture, (rsd_shrinkage){0.3f, polynomial});
                        test_extremes(kernels[k], picture);
                        free(values);
                    }
        test_refusals(kernels[k]);
    }
    printf("shrinkages (%s): %d failures\n", rsd_simd_level(), failures);
    return failures != 0;
}
