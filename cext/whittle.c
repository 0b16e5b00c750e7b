#include <math.h>
#include <string.h>

#include "internal.h"
#include "rsdeblur_kernels.h"

/* Frequencies that are summed up side by side: an AVX-512 vector. */
#define LANES 16
/* Newton steps for the gains of a tile, the change of a logarithm that ends them, and the largest one of a step: see
 * rsdeblur.kernels.whittle. */
#define STEPS 12
#define SETTLED 0.02
#define LONGEST 1.0
/* Products within these bounds stay within the range of doubles when multiplied by any float. */
#define SMALL 1e-100
#define LARGE 1e100

/* A tile, or its part in one direction, under the gain of the scene and the level of the noise. */
typedef struct {
    const float *power, *noise, *expected;
    size_t n;
    float gain, level;
} spectrum;

/* Sums of LANES frequencies side by side. */
typedef struct {
    float first[LANES], second[LANES];
} derivatives;
typedef struct {
    double nats, products[LANES];
} likelihood;

/* Add derivatives of the nats by the logarithm of the gain, at up to LANES frequencies from `i` on. */
static inline void add_derivatives(const spectrum *s, size_t i, size_t n, derivatives *restrict sums)
{
    for (size_t l = 0; l < n; l++) {
        const float signal = s->gain * s->expected[i + l], half = 0.5f * s->power[i + l];
        const float variance = signal + s->level * s->noise[i + l];
        /* Two divisions: the product of both divisors might be too small for float32. */
        const float share = signal / variance;
        sums->first[l] += share * ((variance - half) / (variance + half));
        sums->second[l] += 0.5f * share * share;
    }
}

RSD_CLONES
static void differentiate(const spectrum *s, double *restrict first, double *restrict second)
{
    derivatives sums = {{0.0f}, {0.0f}};
    size_t i = 0;
    for (; s->n - i >= LANES; i += LANES)
        add_derivatives(s, i, LANES, &sums);
    add_derivatives(s, i, s->n - i, &sums);
    for (size_t half = LANES / 2; half > 0; half /= 2)
        for (size_t l = 0; l < half; l++) {
            sums.first[l] += sums.first[l + half];
            sums.second[l] += sums.second[l + half];
        }
    *first += sums.first[0];
    *second += sums.second[0];
}

/* fmin and fmax are calls, because of what they do with NaN. */
static inline double lesser(double a, double b)
{
    return a < b ? a : b;
}

static inline double greater(double a, double b)
{
    return a > b ? a : b;
}

static inline uint64_t bits_of(double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

/* Multiply up to LANES products by what the nats are the logarithm of. Return whether any is too large or too small:
 * positive doubles are ordered like their bits as integers, whose comparison is SIMD code. */
static inline bool multiply_ratios(const spectrum *s, size_t i, size_t n, double *restrict products)
{
    const uint64_t small = bits_of(SMALL), large = bits_of(LARGE);
    uint64_t signs = 0;
    for (size_t l = 0; l < n; l++) {
        const float variance = s->gain * s->expected[i + l] + s->level * s->noise[i + l];
        const float doubled = variance + 0.5f * s->power[i + l];
        /* Squares of faint light might be too small for float32. */
        products[l] *= doubled / variance * (doubled / s->noise[i + l]);
        signs |= (bits_of(products[l]) - small) | (large - bits_of(products[l]));
    }
    return signs >> 63;
}

/* One logarithm for several factors takes less time than one for each. */
static void take_logarithms(likelihood *sum)
{
    for (size_t l = 0; l < LANES; l++) {
        sum->nats += log(sum->products[l]);
        sum->products[l] = 1.0;
    }
}

RSD_CLONES
static void add_likelihood(const spectrum *s, likelihood *restrict sum)
{
    for (size_t i = 0; i < s->n; i += LANES) {
        const bool outside = s->n - i >= LANES ? multiply_ratios(s, i, LANES, sum->products)
                                               : multiply_ratios(s, i, s->n - i, sum->products);
        if (outside)
            take_logarithms(sum);
    }
}

/* Return the part of a tile in direction k, under the gain exp(logarithm). */
static inline spectrum direction(const spectrum *tile, const int32_t *sectors, size_t k, double logarithm)
{
    const int32_t first = sectors[k];
    return (spectrum){.power = tile->power + first,
                      .noise = tile->noise + first,
                      .expected = tile->expected + first,
                      .n = (size_t)(sectors[k + 1] - first),
                      .gain = (float)exp(logarithm),
                      .level = tile->level};
}

/* Find the logarithms of a tile's gains, from start[0] for all of them on; none gets below start[1]. Return their
 * differences' share of the nats. `slopes` and `bends` are workspace. */
static double find_gains(const spectrum *tile, const rsd_tiles *tiles, const double *start, double stiffness,
                         double *restrict logs, double *restrict slopes, double *restrict bends)
{
    const size_t count = tiles->directions;
    const double faintest = start[1];
    double mean = greater(start[0], faintest), longest = LONGEST, apart = 0.0;
    for (size_t k = 0; k < count; k++)
        logs[k] = mean;
    for (int step = 0; step < STEPS && !(longest < SETTLED); step++) {
        double ones = 0.0, forces = 0.0, total = 0.0;
        for (size_t k = 0; k < count; k++) {
            slopes[k] = stiffness * (logs[k] - mean), bends[k] = stiffness + 1e-6;
            const spectrum part = direction(tile, tiles->sectors, k, logs[k]);
            differentiate(&part, &slopes[k], &bends[k]);
            ones += 1.0 / bends[k];
            forces += slopes[k] / bends[k];
        }
        /* The Hessian is diag(bends) - stiffness / count, which the Sherman-Morrison formula inverts. */
        const double each = stiffness / (double)count, common = each * forces / greater(1.0 - each * ones, 1e-9);
        longest = 0.0;
        for (size_t k = 0; k < count; k++) {
            const double change = lesser(greater(-(slopes[k] + common) / bends[k], -LONGEST), LONGEST);
            const double moved = greater(logs[k] + change, faintest);
            longest = greater(longest, fabs(moved - logs[k]));
            total += logs[k] = moved;
        }
        mean = total / (double)count;
    }
    for (size_t k = 0; k < count; k++)
        apart += (logs[k] - mean) * (logs[k] - mean);
    return 0.5 * stiffness * apart;
}

static void fit_tile(const rsd_tiles *tiles, size_t n, rsd_gain_search search, double *workspace, double *nats,
                     double *gains, double *chosen)
{
    const size_t frequencies = tiles->frequencies, count = tiles->directions;
    double *logs = workspace;
    spectrum tile = {.n = frequencies,
                     .power = tiles->power + n * frequencies,
                     .noise = tiles->noise + n * frequencies,
                     .expected = tiles->expected + (size_t)tiles->place[n] * frequencies};
    for (size_t l = 0; l < search.count; l++) {
        likelihood sum = {.nats = 0.0};
        tile.level = (float)search.levels[l];
        sum.nats = find_gains(&tile, tiles, search.starts + 2 * (n * search.count + l), search.stiffness, logs,
                              workspace + count, workspace + 2 * count);
        for (size_t lane = 0; lane < LANES; lane++)
            sum.products[lane] = 1.0;
        for (size_t k = 0; k < count; k++) {
            const spectrum part = direction(&tile, tiles->sectors, k, logs[k]);
            add_likelihood(&part, &sum);
        }
        take_logarithms(&sum);
        if (l == 0 || sum.nats < *nats) {
            *nats = sum.nats, *chosen = search.levels[l];
            for (size_t k = 0; k < count; k++)
                gains[k] = exp(logs[k]);
        }
    }
}

static rsd_status check_tiles(const rsd_tiles *tiles)
{
    if (tiles->sectors == NULL || tiles->place == NULL)
        return RSD_NULL;
    if (tiles->frequencies > INT32_MAX || tiles->places > INT32_MAX ||
        !rsd_addressable(tiles->tiles, tiles->frequencies) || !rsd_addressable(tiles->places, tiles->frequencies))
        return RSD_SIZE;
    for (size_t k = 0; k <= tiles->directions; k++)
        if (tiles->sectors[k] < (k == 0 ? 0 : tiles->sectors[k - 1]) ||
            (size_t)tiles->sectors[k] > tiles->frequencies)
            return RSD_MODEL;
    for (size_t n = 0; n < tiles->tiles; n++)
        if (tiles->place[n] < 0 || (size_t)tiles->place[n] >= tiles->places)
            return RSD_MODEL;
    return RSD_OK;
}

rsd_status rsd_fit_tiles(const rsd_tiles *tiles, rsd_gain_search search, double *workspace, double *nats,
                         double *gains, double *chosen)
{
    if (tiles->tiles == 0 || tiles->directions == 0 || search.count == 0)
        return RSD_OK;
    if (tiles->power == NULL || tiles->noise == NULL || tiles->expected == NULL || search.levels == NULL ||
        search.starts == NULL || workspace == NULL || nats == NULL || gains == NULL || chosen == NULL)
        return RSD_NULL;
    const rsd_status status = check_tiles(tiles);
    for (size_t n = 0; status == RSD_OK && n < tiles->tiles; n++)
        fit_tile(tiles, n, search, workspace, nats + n, gains + n * tiles->directions, chosen + n);
    return status;
}
