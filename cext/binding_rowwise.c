/* The binding of the rowwise kernels. Arguments are positional: the arrays of the model, then those of the kernel. */
#include "arguments.h"

/* Positions of the model's arrays; the kernel's own arguments follow. */
enum { ROW_FIRST, ROW_END, COUPLED, TAP_START, TAP_SHIFT, TAP_WEIGHT, TABLE, OWN };
#define MODEL_ARRAYS                                                                                                   \
    {"row_first", INT32, 1, READ}, {"row_end", INT32, 1, READ}, {"coupled", INT32, 1, READ},                           \
        {"tap_start", INT32, 1, READ}, {"tap_shift", INT32, 1, READ}, {"tap_weight", FLOAT32, 1, READ},                \
        {"table", FLOAT32, 3, READ}
/* Positions of the kernel's own arguments: of the blur, its adjoint and `solve`, which alone takes PENALTY; of
 * `assemble`; of `solve_assembled`; and of the functions that return sizes. */
enum { DATA = OWN, LATENT, WORKSPACE, PENALTY };
enum { NORMAL = OWN, NORMAL_WORKSPACE, NORMAL_ROWS };
enum { SOLVE_NORMAL = OWN, SOLVE_LATENT, SOLVE_WORKSPACE, SOLVE_PENALTY, SOLVE_ROWS };
enum { SIZE_ROWS = OWN, SIZE_SOLVE };

/* Fill `model`, of a picture of `rows` rows. Return NULL, or a message if the lengths of the arrays do not match. */
static const char *as_model(const rsd_value *given, Py_ssize_t rows, rsd_rowwise_model *model)
{
    const Py_ssize_t blocks = given[ROW_FIRST].array.shape[0], taps = given[TAP_SHIFT].array.shape[0];
    const Py_ssize_t *table = given[TABLE].array.shape;
    const int32_t *first = given[ROW_FIRST].array.buf, *end = given[ROW_END].array.buf;
    Py_ssize_t pairs = 0;
    if (rows < 0)
        return "rows must not be negative";
    if (given[ROW_END].array.shape[0] != blocks || given[COUPLED].array.shape[0] != blocks ||
        blocks > INT32_MAX / RSD_BLOCK)
        return "row_first, row_end and coupled must have the same length";
    if (given[TAP_WEIGHT].array.shape[0] != taps || taps > INT32_MAX)
        return "tap_shift and tap_weight must have the same length";
    if (table[1] != 2 || table[2] != RSD_LANES)
        return "table must have shape (n, 2, 16)";
    for (Py_ssize_t b = 0; b < blocks; b++)
        pairs += RSD_BLOCK * ((Py_ssize_t)end[b] - first[b]);
    if (given[TAP_START].array.shape[0] != pairs + 1)
        return "tap_start must have one value per latent row and picture row that sees its block, and one more";
    *model = (rsd_rowwise_model){
        .rows = (size_t)rows,
        .blocks = (size_t)blocks,
        .taps = (size_t)taps,
        .phases = (size_t)table[0],
        .row_first = first,
        .row_end = end,
        .coupled = given[COUPLED].array.buf,
        .tap_start = given[TAP_START].array.buf,
        .tap_shift = given[TAP_SHIFT].array.buf,
        .tap_weight = given[TAP_WEIGHT].array.buf,
    };
    return NULL;
}

/* Return NULL if the model is valid and a workspace is large enough for it, else a message. */
static const char *check_workspace(const rsd_value *workspace, const rsd_rowwise_model *model, int solve)
{
    const size_t floats = rsd_rowwise_workspace(model, solve);
    if (floats == 0 && model->blocks > 0)
        return rsd_status_message(RSD_MODEL);
    if ((size_t)workspace->array.shape[0] < floats)
        return "workspace is too small; rowwise_workspace returns the size that it needs";
    return NULL;
}

static const char *check_normal(const rsd_value *normal, const rsd_rowwise_model *model)
{
    return (size_t)normal->array.shape[0] == rsd_rowwise_assembled_size(model)
               ? NULL
               : "normal has the wrong size; rowwise_assembled_size returns the right one";
}

static const char *check_penalty(const rsd_value *penalty)
{
    const Py_ssize_t *shape = penalty->array.shape;
    return shape[0] == 3 && shape[1] == RSD_LANES ? NULL : "penalty must have shape (3, 16)";
}

/* Fill `model`. Return NULL if it is valid, and data, latent and workspace fit it, else a message. */
static const char *as_own_model(const rsd_value *given, int solve, rsd_rowwise_model *model)
{
    const Py_ssize_t *data = given[DATA].array.shape, *latent = given[LATENT].array.shape;
    const char *refusal = as_model(given, data[1], model);
    if (refusal != NULL)
        return refusal;
    if (data[2] != 2 || latent[2] != 2 || data[3] != RSD_LANES || latent[3] != RSD_LANES)
        return "data and latent must have shape (channels, rows, 2, 16)";
    if (data[0] != latent[0])
        return "data and latent must have the same channels";
    if ((size_t)latent[1] != RSD_BLOCK * model->blocks)
        return "latent must have three rows per block";
    return check_workspace(&given[WORKSPACE], model, solve);
}

static const char *call_forward(rsd_value *given)
{
    const Py_buffer *data = &given[DATA].array, *latent = &given[LATENT].array;
    rsd_rowwise_model model;
    const char *refusal = as_own_model(given, 0, &model);
    if (refusal != NULL)
        return refusal;
    return rsd_refusal(rsd_rowwise_forward(&model, given[TABLE].array.buf, latent->buf, data->buf,
                                           (size_t)data->shape[0], given[WORKSPACE].array.buf));
}

PyObject *rsd_bind_rowwise_forward(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {
        MODEL_ARRAYS, {"data", FLOAT32, 4, WRITTEN}, {"latent", FLOAT32, 4, READ}, {"workspace", FLOAT32, 1, WRITTEN}};
    (void)module;
    return rsd_call(args, parameters, call_forward);
}

static const char *call_adjoint(rsd_value *given)
{
    const Py_buffer *data = &given[DATA].array, *latent = &given[LATENT].array;
    rsd_rowwise_model model;
    const char *refusal = as_own_model(given, 0, &model);
    if (refusal != NULL)
        return refusal;
    return rsd_refusal(rsd_rowwise_adjoint(&model, given[TABLE].array.buf, data->buf, latent->buf,
                                           (size_t)data->shape[0], given[WORKSPACE].array.buf));
}

PyObject *rsd_bind_rowwise_adjoint(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {
        MODEL_ARRAYS, {"data", FLOAT32, 4, READ}, {"latent", FLOAT32, 4, WRITTEN}, {"workspace", FLOAT32, 1, WRITTEN}};
    (void)module;
    return rsd_call(args, parameters, call_adjoint);
}

static const char *call_solve(rsd_value *given)
{
    const Py_buffer *data = &given[DATA].array;
    rsd_rowwise_model model;
    const char *refusal = as_own_model(given, 1, &model);
    if (refusal == NULL)
        refusal = check_penalty(&given[PENALTY]);
    if (refusal != NULL)
        return refusal;
    return rsd_refusal(rsd_rowwise_solve(&model, given[TABLE].array.buf, given[PENALTY].array.buf, data->buf,
                                         given[LATENT].array.buf, (size_t)data->shape[0],
                                         given[WORKSPACE].array.buf));
}

PyObject *rsd_bind_rowwise_solve(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {MODEL_ARRAYS,
                                              {"data", FLOAT32, 4, READ},
                                              {"latent", FLOAT32, 4, WRITTEN},
                                              {"workspace", FLOAT32, 1, WRITTEN},
                                              {"penalty", FLOAT32, 2, READ}};
    (void)module;
    return rsd_call(args, parameters, call_solve);
}

static const char *call_assemble(rsd_value *given)
{
    rsd_rowwise_model model;
    const char *refusal = as_model(given, given[NORMAL_ROWS].integer, &model);
    if (refusal == NULL)
        refusal = check_workspace(&given[NORMAL_WORKSPACE], &model, 1);
    if (refusal == NULL)
        refusal = check_normal(&given[NORMAL], &model);
    if (refusal != NULL)
        return refusal;
    return rsd_refusal(rsd_rowwise_assemble(&model, given[TABLE].array.buf, given[NORMAL].array.buf,
                                            given[NORMAL_WORKSPACE].array.buf));
}

PyObject *rsd_bind_rowwise_assemble(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {
        MODEL_ARRAYS, {"normal", FLOAT32, 1, WRITTEN}, {"workspace", FLOAT32, 1, WRITTEN}, {"rows", INTEGER, 0, READ}};
    (void)module;
    return rsd_call(args, parameters, call_assemble);
}

static const char *call_solve_assembled(rsd_value *given)
{
    const Py_buffer *latent = &given[SOLVE_LATENT].array;
    rsd_rowwise_model model;
    const char *refusal = as_model(given, given[SOLVE_ROWS].integer, &model);
    if (refusal == NULL && (latent->shape[2] != 2 || latent->shape[3] != RSD_LANES ||
                            (size_t)latent->shape[1] != RSD_BLOCK * model.blocks))
        refusal = "latent must have shape (channels, 3 rows per block, 2, 16)";
    if (refusal == NULL)
        refusal = check_workspace(&given[SOLVE_WORKSPACE], &model, 1);
    if (refusal == NULL)
        refusal = check_normal(&given[SOLVE_NORMAL], &model);
    if (refusal == NULL)
        refusal = check_penalty(&given[SOLVE_PENALTY]);
    if (refusal != NULL)
        return refusal;
    return rsd_refusal(rsd_rowwise_solve_assembled(&model, given[SOLVE_NORMAL].array.buf,
                                                   given[SOLVE_PENALTY].array.buf, latent->buf,
                                                   (size_t)latent->shape[0], given[SOLVE_WORKSPACE].array.buf));
}

PyObject *rsd_bind_rowwise_solve_assembled(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {MODEL_ARRAYS,
                                              {"normal", FLOAT32, 1, READ},
                                              {"latent", FLOAT32, 4, WRITTEN},
                                              {"workspace", FLOAT32, 1, WRITTEN},
                                              {"penalty", FLOAT32, 2, READ},
                                              {"rows", INTEGER, 0, READ}};
    (void)module;
    return rsd_call(args, parameters, call_solve_assembled);
}

/* Floats of workspace, for solving if `solve`, or for the other kernels. */
static const char *call_workspace(rsd_value *given)
{
    rsd_rowwise_model model;
    const char *refusal = as_model(given, given[SIZE_ROWS].integer, &model);
    if (refusal != NULL)
        return refusal;
    const size_t floats = rsd_rowwise_workspace(&model, given[SIZE_SOLVE].integer != 0);
    given[SIZE_SOLVE + 1].integer = (Py_ssize_t)floats;
    return floats > 0 ? NULL : rsd_status_message(RSD_MODEL);
}

PyObject *rsd_bind_rowwise_workspace(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {
        MODEL_ARRAYS, {"rows", INTEGER, 0, READ}, {"solve", INTEGER, 0, READ}, {"floats", RETURNED_INTEGER, 0, READ}};
    (void)module;
    return rsd_call(args, parameters, call_workspace);
}

/* Floats of a model's normal matrix. */
static const char *call_assembled_size(rsd_value *given)
{
    rsd_rowwise_model model;
    const char *refusal = as_model(given, given[SIZE_ROWS].integer, &model);
    if (refusal != NULL)
        return refusal;
    const size_t floats = rsd_rowwise_assembled_size(&model);
    given[SIZE_ROWS + 1].integer = (Py_ssize_t)floats;
    return floats > 0 ? NULL : rsd_status_message(RSD_MODEL);
}

PyObject *rsd_bind_rowwise_assembled_size(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {
        MODEL_ARRAYS, {"rows", INTEGER, 0, READ}, {"floats", RETURNED_INTEGER, 0, READ}};
    (void)module;
    return rsd_call(args, parameters, call_assembled_size);
}
