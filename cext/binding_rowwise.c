/* The binding of the rowwise kernels. Arguments are positional: the arrays of the model, then those of the kernel. */
#include "buffers.h"

#include <string.h>

/* Positions of the model's arrays; the kernel's own arrays follow. */
enum { ROW_FIRST, ROW_END, COUPLED, TAP_START, TAP_SHIFT, TAP_WEIGHT, TABLE, OWN };
static const rsd_spec model_arrays[OWN] = {
    {"row_first", INT32, 1, false}, {"row_end", INT32, 1, false},    {"coupled", INT32, 1, false},
    {"tap_start", INT32, 1, false}, {"tap_shift", INT32, 1, false},  {"tap_weight", FLOAT32, 1, false},
    {"table", FLOAT32, 3, false},
};
/* Positions of the kernel's own arrays; only `solve` takes all of them. */
enum { DATA = OWN, LATENT, WORKSPACE, RIDGE, MOST };

static bool acquire(PyObject **objects, Py_buffer *views, const rsd_spec *own, int count)
{
    rsd_spec specs[MOST];
    memcpy(specs, model_arrays, sizeof model_arrays);
    if (count > OWN)
        memcpy(specs + OWN, own, (size_t)(count - OWN) * sizeof *own);
    return rsd_acquire(objects, views, specs, count);
}

static PyObject *conclude(const char *refusal, rsd_status status)
{
    if (!rsd_conclude(refusal, status))
        return NULL;
    Py_RETURN_NONE;
}

/* Fill `model`. Return NULL, or a message if the lengths of the arrays do not match. */
static const char *as_model(const Py_buffer *views, size_t rows, rsd_rowwise_model *model)
{
    const Py_ssize_t blocks = views[ROW_FIRST].shape[0], taps = views[TAP_SHIFT].shape[0];
    if (views[ROW_END].shape[0] != blocks || views[COUPLED].shape[0] != blocks || blocks > INT32_MAX / RSD_BLOCK)
        return "row_first, row_end and coupled must have the same length";
    if (views[TAP_WEIGHT].shape[0] != taps || taps > INT32_MAX)
        return "tap_shift and tap_weight must have the same length";
    if (views[TABLE].shape[1] != 2 || views[TABLE].shape[2] != RSD_LANES)
        return "table must have shape (n, 2, 16)";
    const int32_t *first = views[ROW_FIRST].buf, *end = views[ROW_END].buf;
    Py_ssize_t pairs = 0;
    for (Py_ssize_t b = 0; b < blocks; b++)
        pairs += RSD_BLOCK * ((Py_ssize_t)end[b] - first[b]);
    if (views[TAP_START].shape[0] != pairs + 1)
        return "tap_start must have one value per latent row and picture row that sees its block, and one more";
    *model = (rsd_rowwise_model){
        .rows = rows,
        .blocks = (size_t)blocks,
        .taps = (size_t)taps,
        .phases = (size_t)views[TABLE].shape[0],
        .row_first = first,
        .row_end = end,
        .coupled = views[COUPLED].buf,
        .tap_start = views[TAP_START].buf,
        .tap_shift = views[TAP_SHIFT].buf,
        .tap_weight = views[TAP_WEIGHT].buf,
    };
    return NULL;
}

/* Return NULL if data, latent and workspace fit the model and each other, else a message. */
static const char *check_own(const Py_buffer *views, const rsd_rowwise_model *model, int solve)
{
    const Py_ssize_t *data = views[DATA].shape, *latent = views[LATENT].shape;
    if (data[2] != 2 || latent[2] != 2 || data[3] != RSD_LANES || latent[3] != RSD_LANES)
        return "data and latent must have shape (channels, rows, 2, 16)";
    if (data[0] != latent[0])
        return "data and latent must have the same channels";
    if ((size_t)latent[1] != RSD_BLOCK * model->blocks)
        return "latent must have three rows per block";
    const size_t floats = rsd_rowwise_workspace(model, solve);
    if (floats == 0 && model->blocks > 0)
        return rsd_status_message(RSD_MODEL);
    if ((size_t)views[WORKSPACE].shape[0] < floats)
        return "workspace is too small; rowwise_workspace returns the size that it needs";
    for (int a = DATA; a <= WORKSPACE; a++)
        for (int b = 0; b < a; b++)
            if (rsd_overlap(&views[a], &views[b]))
                return "data, latent and workspace must not overlap anything";
    return NULL;
}

typedef rsd_status (*operator)(const rsd_rowwise_model *, const float *, const float *, float *, size_t, float *);

static PyObject *apply(PyObject *args, operator function, bool to_data)
{
    const rsd_spec own[] = {
        {"data", FLOAT32, 4, to_data}, {"latent", FLOAT32, 4, !to_data}, {"workspace", FLOAT32, 1, true}};
    PyObject *o[MOST];
    Py_buffer views[MOST];
    if (!PyArg_ParseTuple(args, "OOOOOOOOOO", o, o + 1, o + 2, o + 3, o + 4, o + 5, o + 6, o + 7, o + 8, o + 9) ||
        !acquire(o, views, own, RIDGE))
        return NULL;
    rsd_rowwise_model model;
    rsd_status status = RSD_OK;
    const char *refusal = as_model(views, (size_t)views[DATA].shape[1], &model);
    if (refusal == NULL)
        refusal = check_own(views, &model, 0);
    if (refusal == NULL) {
        Py_BEGIN_ALLOW_THREADS
        status = function(&model, views[TABLE].buf, views[to_data ? LATENT : DATA].buf,
                          views[to_data ? DATA : LATENT].buf, (size_t)views[DATA].shape[0], views[WORKSPACE].buf);
        Py_END_ALLOW_THREADS
    }
    rsd_release(views, RIDGE);
    return conclude(refusal, status);
}

PyObject *rsd_bind_rowwise_forward(PyObject *module, PyObject *args)
{
    (void)module;
    return apply(args, rsd_rowwise_forward, true);
}

PyObject *rsd_bind_rowwise_adjoint(PyObject *module, PyObject *args)
{
    (void)module;
    return apply(args, rsd_rowwise_adjoint, false);
}

PyObject *rsd_bind_rowwise_solve(PyObject *module, PyObject *args)
{
    const rsd_spec own[] = {{"data", FLOAT32, 4, false},
                            {"latent", FLOAT32, 4, true},
                            {"workspace", FLOAT32, 1, true},
                            {"ridge", FLOAT32, 1, false}};
    PyObject *o[MOST];
    Py_buffer views[MOST];
    float smooth;
    (void)module;
    if (!PyArg_ParseTuple(args, "OOOOOOOOOOOf", o, o + 1, o + 2, o + 3, o + 4, o + 5, o + 6, o + 7, o + 8, o + 9,
                          o + 10, &smooth) ||
        !acquire(o, views, own, MOST))
        return NULL;
    rsd_rowwise_model model;
    rsd_status status = RSD_OK;
    const char *refusal = as_model(views, (size_t)views[DATA].shape[1], &model);
    if (refusal == NULL)
        refusal = check_own(views, &model, 1);
    if (refusal == NULL && views[RIDGE].shape[0] != RSD_LANES)
        refusal = "ridge must have 16 values";
    if (refusal == NULL &&
        (rsd_overlap(&views[RIDGE], &views[LATENT]) || rsd_overlap(&views[RIDGE], &views[WORKSPACE])))
        refusal = "ridge must not overlap latent or workspace";
    if (refusal == NULL) {
        Py_BEGIN_ALLOW_THREADS
        status = rsd_rowwise_solve(&model, views[TABLE].buf, views[RIDGE].buf, smooth, views[DATA].buf,
                                   views[LATENT].buf, (size_t)views[DATA].shape[0], views[WORKSPACE].buf);
        Py_END_ALLOW_THREADS
    }
    rsd_release(views, MOST);
    return conclude(refusal, status);
}

/* Return the floats of workspace that a model needs, for solving (`solve` true) or for the other kernels. */
PyObject *rsd_bind_rowwise_workspace(PyObject *module, PyObject *args)
{
    PyObject *o[OWN];
    Py_buffer views[OWN];
    Py_ssize_t rows;
    int solve;
    (void)module;
    if (!PyArg_ParseTuple(args, "OOOOOOOni", o, o + 1, o + 2, o + 3, o + 4, o + 5, o + 6, &rows, &solve) ||
        !acquire(o, views, NULL, OWN))
        return NULL;
    rsd_rowwise_model model;
    const char *refusal = rows < 0 ? "rows must not be negative" : as_model(views, (size_t)rows, &model);
    const size_t floats = refusal == NULL ? rsd_rowwise_workspace(&model, solve) : 0;
    rsd_release(views, OWN);
    if (refusal == NULL && floats == 0)
        refusal = rsd_status_message(RSD_MODEL);
    return refusal == NULL ? PyLong_FromSize_t(floats) : conclude(refusal, RSD_OK);
}
