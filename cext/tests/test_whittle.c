/* Laws of the fit of gains; exits with 1 if any fails. */
#include "check.h"

#define DIRECTIONS 3
#define LEVELS 2
#define TILES 2
#define STIFFNESS 5.0

static const double levels[LEVELS] = {0.3, 1.0};
static const int32_t place[TILES] = {1, 0};

/* The negative log-likelihood of a tile, as its definition says. */
static double nats_of(const rsd_tiles *tiles, size_t n, const double *gains, double level)
{
    double mean = 0.0, nats = 0.0;
    for (size_t k = 0; k < DIRECTIONS; k++)
        mean += log(gains[k]) / DIRECTIONS;
    for (size_t k = 0; k < DIRECTIONS; k++) {
        nats += 0.5 * STIFFNESS * (log(gains[k]) - mean) * (log(gains[k]) - mean);
        for (int32_t i = tiles->sectors[k]; i < tiles->sectors[k + 1]; i++) {
            const size_t at = n * tiles->frequencies + (size_t)i;
            const double noise = tiles->noise[at], power = tiles->power[at];
            const double scene = tiles->expected[(size_t)tiles->place[n] * tiles->frequencies + (size_t)i];
            const double variance = gains[k] * scene + level * noise;
            nats += log((variance + 0.5 * power) * (variance + 0.5 * power) / (variance * noise));
        }
    }
    return nats;
}

/* Return positive values, which `spread` lets differ by many orders of magnitude. */
static float *powers(size_t n, unsigned seed, float spread)
{
    float *values = noise(n, seed);
    for (size_t i = 0; i < n; i++)
        values[i] = expf(spread * values[i]);
    return values;
}

/* The nats belong to the gains and the level. Another level has no less; another gain neither, unless powers are so far
 * apart that the search may end early. */
static void test_fit(int32_t n, float spread)
{
    /* Directions of many lengths, and frequencies on both sides that belong to none. */
    const int32_t sectors[DIRECTIONS + 1] = {1, 1 + n, 1 + n + n / 2, 4 + n + n / 2};
    const size_t frequencies = (size_t)sectors[DIRECTIONS] + 1;
    float *power = powers(TILES * frequencies, 1, spread), *floor = powers(TILES * frequencies, 2, 0.1f);
    float *expected = powers(2 * frequencies, 3, 1.0f);
    const rsd_tiles tiles = {TILES, frequencies, 2, DIRECTIONS, power, floor, expected, place, sectors};
    const double starts[2 * LEVELS * TILES] = {0.0, -9.0, 0.0, -9.0, 0.0, -9.0, 0.0, -9.0};
    double workspace[RSD_FIT_TERMS * DIRECTIONS], nats[TILES], gains[TILES * DIRECTIONS], chosen[TILES];
    const rsd_gain_search search = {LEVELS, levels, starts, STIFFNESS};
    CHECK(rsd_fit_tiles(&tiles, search, workspace, nats, gains, chosen) == RSD_OK);
    for (size_t tile = 0; tile < TILES; tile++) {
        double *own = gains + tile * DIRECTIONS;
        CHECK(fabs(nats[tile] - nats_of(&tiles, tile, own, chosen[tile])) < 1e-6 * (fabs(nats[tile]) + frequencies));
        CHECK(chosen[tile] == levels[0] || chosen[tile] == levels[1]);
        CHECK(nats_of(&tiles, tile, own, levels[chosen[tile] == levels[0]]) > nats[tile] - 0.01);
        for (size_t k = 0; spread < 2.0f && k < DIRECTIONS; k++)
            for (int sign = -1; sign <= 1; sign += 2) {
                const double before = own[k];
                own[k] *= exp(0.3 * sign); /* much more than the change that ends the steps */
                CHECK(nats_of(&tiles, tile, own, chosen[tile]) > nats[tile]);
                own[k] = before;
            }
    }
    free(power), free(floor), free(expected);
}

static void test_refusals(void)
{
    float values[8] = {1, 1, 1, 1, 1, 1, 1, 1};
    const double starts[4] = {0.0};
    double workspace[RSD_FIT_TERMS], nats[2] = {7.0, 7.0}, gains[2] = {7.0, 7.0}, chosen[2] = {7.0, 7.0};
    const rsd_gain_search search = {1, levels, starts, 1.0};
    const int32_t sectors[2] = {0, 4};
    const rsd_tiles tiles = {2, 4, 2, 1, values, values, values, place, sectors};
    const int32_t wrong_sectors[][2] = {{-1, 4}, {0, 5}, {3, 2}}, wrong_places[][2] = {{0, 2}, {-1, 0}};
    const int32_t *const pointers[] = {NULL, sectors};
    rsd_tiles other;
    for (size_t i = 0; i < 3; i++) {
        other = tiles, other.sectors = wrong_sectors[i];
        CHECK(rsd_fit_tiles(&other, search, workspace, nats, gains, chosen) == RSD_MODEL);
    }
    for (size_t i = 0; i < 2; i++) {
        other = tiles, other.place = wrong_places[i];
        CHECK(rsd_fit_tiles(&other, search, workspace, nats, gains, chosen) == RSD_MODEL);
        other = tiles, other.sectors = pointers[i], other.place = pointers[1 - i];
        CHECK(rsd_fit_tiles(&other, search, workspace, nats, gains, chosen) == RSD_NULL);
    }
    other = tiles, other.frequencies = (size_t)INT32_MAX + 1;
    CHECK(rsd_fit_tiles(&other, search, workspace, nats, gains, chosen) == RSD_SIZE);
    other = tiles, other.tiles = SIZE_MAX / 8;
    CHECK(rsd_fit_tiles(&other, search, workspace, nats, gains, chosen) == RSD_SIZE);
    CHECK(rsd_fit_tiles(&tiles, search, NULL, nats, gains, chosen) == RSD_NULL);
    CHECK(rsd_fit_tiles(&tiles, search, workspace, NULL, gains, chosen) == RSD_NULL);
    other = (rsd_tiles){0};
    CHECK(rsd_fit_tiles(&other, search, NULL, NULL, NULL, NULL) == RSD_OK);
    for (int i = 0; i < 2; i++)
        CHECK(nats[i] == 7.0 && gains[i] == 7.0 && chosen[i] == 7.0); /* a refused call writes nothing */
}

int main(void)
{
    /* Lengths on both sides of every vector width. */
    for (int32_t n = 0; n <= 70; n++)
        test_fit(n, 1.0f);
    test_fit(500, 30.0f); /* products beyond any double */
    test_refusals();
    printf("fit of tiles (%s): %d failures\n", rsd_simd_level(), failures);
    return failures != 0;
}
