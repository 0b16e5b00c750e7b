/* The binding of the fit of tiles. Arguments are positional: the arrays of the tiles, then those of the fit. */
#include "arguments.h"

enum { POWER, NOISE, EXPECTED, PLACE, SECTORS, STARTS, LEVELS, STIFFNESS, NATS, GAINS, CHOSEN, WORKSPACE };

static const char *call_fit_tiles(rsd_value *given)
{
    const Py_ssize_t *power = given[POWER].array.shape, *noise = given[NOISE].array.shape;
    const Py_ssize_t *expected = given[EXPECTED].array.shape, *starts = given[STARTS].array.shape;
    const Py_ssize_t *workspace = given[WORKSPACE].array.shape, *gains = given[GAINS].array.shape;
    const Py_ssize_t count = power[0], directions = given[SECTORS].array.shape[0] - 1;
    const Py_ssize_t levels = given[LEVELS].array.shape[0];
    if (noise[0] != count || noise[1] != power[1] || expected[1] != power[1])
        return "power and noise must have the same shape, and expected as many frequencies";
    if (directions < 1 || levels < 1)
        return "sectors must have two values or more, and levels one";
    if (given[PLACE].array.shape[0] != count || given[NATS].array.shape[0] != count ||
        given[CHOSEN].array.shape[0] != count || gains[0] != count || gains[1] != directions)
        return "place, nats, gains and chosen must have a row for each tile, of gains with one for each sector";
    if (starts[0] != count || starts[1] != levels || starts[2] != 2)
        return "starts must have two values for each level of each tile";
    if (workspace[0] != RSD_FIT_TERMS || workspace[1] != directions)
        return "workspace must have three values for each sector";
    const rsd_tiles tiles = {.tiles = (size_t)count,
                             .frequencies = (size_t)power[1],
                             .places = (size_t)expected[0],
                             .directions = (size_t)directions,
                             .power = given[POWER].array.buf,
                             .noise = given[NOISE].array.buf,
                             .expected = given[EXPECTED].array.buf,
                             .place = given[PLACE].array.buf,
                             .sectors = given[SECTORS].array.buf};
    const rsd_gain_search search = {.count = (size_t)levels,
                                    .levels = given[LEVELS].array.buf,
                                    .starts = given[STARTS].array.buf,
                                    .stiffness = given[STIFFNESS].real};
    return rsd_refusal(rsd_fit_tiles(&tiles, search, given[WORKSPACE].array.buf, given[NATS].array.buf,
                                     given[GAINS].array.buf, given[CHOSEN].array.buf));
}

PyObject *rsd_bind_fit_tiles(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {
        {"power", FLOAT32, 2, READ},    {"noise", FLOAT32, 2, READ},    {"expected", FLOAT32, 2, READ},
        {"place", INT32, 1, READ},      {"sectors", INT32, 1, READ},    {"starts", FLOAT64, 3, READ},
        {"levels", FLOAT64, 1, READ},   {"stiffness", REAL, 0, READ},   {"nats", FLOAT64, 1, WRITTEN},
        {"gains", FLOAT64, 2, WRITTEN}, {"chosen", FLOAT64, 1, WRITTEN}, {"workspace", FLOAT64, 2, WRITTEN}};
    (void)module;
    return rsd_call(args, parameters, call_fit_tiles);
}
