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
/* Positions of the kernel's own arrays: of the blur, its adjoint and `solve`, which alone takes PENALTY; of `assemble`;
 * and of `solve_assembled`. */
enum { DATA = OWN, LATENT, WORKSPACE, PENALTY, MOST };
enum { NORMAL = OWN, NORMAL_WORKSPACE, MOST_OF_ASSEMBLE };
enum { SOLVE_NORMAL = OWN, SOLVE_LATENT, SOLVE_WORKSPACE, SOLVE_PENALTY };

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

/* Return NULL if the model is valid and a workspace is large enough for it, else a message. */
static const char *check_workspace(const Py_buffer *workspace, const rsd_rowwise_model *model, int solve)
{
    const size_t floats = rsd_rowwise_workspace(model, solve);
    if (floats == 0 && model->blocks > 0)
        return rsd_status_message(RSD_MODEL);
    if ((size_t)workspace->shape[0] < floats)
        return "workspace is too small; rowwise_workspace returns the size that it needs";
    return NULL;
}

/* Return NULL if the views from `first` to `last` overlap none before them, else a message. */
static const char *check_apart(const Py_buffer *views, int first, int last, const char *message)
{
    for (int a = first; a <= last; a++)
        for (int b = 0; b < a; b++)
            if (rsd_overlap(&views[a], &views[b]))
                return message;
    return NULL;
}

static const char *check_penalty(const Py_buffer *penalty)
{
    return penalty->shape[0] == 3 && penalty->shape[1] == RSD_LANES ? NULL : "penalty must have shape (3, 16)";
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
    const char *refusal = check_workspace(&views[WORKSPACE], model, solve);
    if (refusal != NULL)
        return refusal;
    return check_apart(views, DATA, WORKSPACE, "data, latent and workspace must not overlap anything");
}

typedef rsd_status (*operator)(const rsd_rowwise_model *, const float *, const float *, float *, size_t, float *);

static PyObject *apply(PyObject *args, operator function, bool to_data)
{
    const rsd_spec own[] = {
        {"data", FLOAT32, 4, to_data}, {"latent", FLOAT32, 4, !to_data}, {"workspace", FLOAT32, 1, true}};
    PyObject *o[MOST];
    Py_buffer views[MOST];
    if (!PyArg_ParseTuple(args, "OOOOOOOOOO", o, o + 1, o + 2, o + 3, o + 4, o + 5, o + 6, o + 7, o + 8, o + 9) ||
        !acquire(o, views, own, PENALTY))
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
    rsd_release(views, PENALTY);
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
                            {"penalty", FLOAT32, 2, false}};
    PyObject *o[MOST];
    Py_buffer views[MOST];
    (void)module;
    if (!PyArg_ParseTuple(args, "OOOOOOOOOOO", o, o + 1, o + 2, o + 3, o + 4, o + 5, o + 6, o + 7, o + 8, o + 9,
                          o + 10) ||
        !acquire(o, views, own, MOST))
        return NULL;
    rsd_rowwise_model model;
    rsd_status status = RSD_OK;
    const char *refusal = as_model(views, (size_t)views[DATA].shape[1], &model);
    if (refusal == NULL)
        refusal = check_own(views, &model, 1);
    if (refusal == NULL)
        refusal = check_penalty(&views[PENALTY]);
    if (refusal == NULL &&
        (rsd_overlap(&views[PENALTY], &views[LATENT]) || rsd_overlap(&views[PENALTY], &views[WORKSPACE])))
        refusal = "penalty must not overlap latent or workspace";
    if (refusal == NULL) {
        Py_BEGIN_ALLOW_THREADS
        status = rsd_rowwise_solve(&model, views[TABLE].buf, views[PENALTY].buf, views[DATA].buf,
                                   views[LATENT].buf, (size_t)views[DATA].shape[0], views[WORKSPACE].buf);
        Py_END_ALLOW_THREADS
    }
    rsd_release(views, MOST);
    return conclude(refusal, status);
}

PyObject *rsd_bind_rowwise_assemble(PyObject *module, PyObject *args)
{
    const rsd_spec own[] = {{"normal", FLOAT32, 1, true}, {"workspace", FLOAT32, 1, true}};
    PyObject *o[MOST];
    Py_buffer views[MOST];
    Py_ssize_t rows;
    (void)module;
    if (!PyArg_ParseTuple(args, "OOOOOOOOOn", o, o + 1, o + 2, o + 3, o + 4, o + 5, o + 6, o + 7, o + 8, &rows) ||
        !acquire(o, views, own, MOST_OF_ASSEMBLE))
        return NULL;
    rsd_rowwise_model model;
    rsd_status status = RSD_OK;
    const char *refusal = rows < 0 ? "rows must not be negative" : as_model(views, (size_t)rows, &model);
    if (refusal == NULL)
        refusal = check_workspace(&views[NORMAL_WORKSPACE], &model, 1);
    if (refusal == NULL && (size_t)views[NORMAL].shape[0] != rsd_rowwise_assembled_size(&model))
        refusal = "normal has the wrong size; rowwise_assembled_size returns the right one";
    if (refusal == NULL)
        refusal = check_apart(views, NORMAL, NORMAL_WORKSPACE, "normal and workspace must not overlap anything");
    if (refusal == NULL) {
        Py_BEGIN_ALLOW_THREADS
        status = rsd_rowwise_assemble(&model, views[TABLE].buf, views[NORMAL].buf, views[NORMAL_WORKSPACE].buf);
        Py_END_ALLOW_THREADS
    }
    rsd_release(views, MOST_OF_ASSEMBLE);
    return conclude(refusal, status);
}

PyObject *rsd_bind_rowwise_solve_assembled(PyObject *module, PyObject *args)
{
    const rsd_spec own[] = {{"normal", FLOAT32, 1, false},
                            {"latent", FLOAT32, 4, true},
                            {"workspace", FLOAT32, 1, true},
                            {"penalty", FLOAT32, 2, false}};
    PyObject *o[MOST];
    Py_buffer views[MOST];
    Py_ssize_t rows;
    (void)module;
    if (!PyArg_ParseTuple(args, "OOOOOOOOOOOn", o, o + 1, o + 2, o + 3, o + 4, o + 5, o + 6, o + 7, o + 8, o + 9,
                          o + 10, &rows) ||
        !acquire(o, views, own, MOST))
        return NULL;
    rsd_rowwise_model model;
    rsd_status status = RSD_OK;
    const char *refusal = rows < 0 ? "rows must not be negative" : as_model(views, (size_t)rows, &model);
    const Py_ssize_t *latent = views[SOLVE_LATENT].shape;
    if (refusal == NULL && (latent[2] != 2 || latent[3] != RSD_LANES || (size_t)latent[1] != RSD_BLOCK * model.blocks))
        refusal = "latent must have shape (channels, 3 rows per block, 2, 16)";
    if (refusal == NULL)
        refusal = check_workspace(&views[SOLVE_WORKSPACE], &model, 1);
    if (refusal == NULL && (size_t)views[SOLVE_NORMAL].shape[0] != rsd_rowwise_assembled_size(&model))
        refusal = "normal has the wrong size; rowwise_assembled_size returns the right one";
    if (refusal == NULL)
        refusal = check_penalty(&views[SOLVE_PENALTY]);
    if (refusal == NULL)
        refusal =
            check_apart(views, SOLVE_LATENT, SOLVE_PENALTY, "latent, workspace and penalty must not overlap anything");
    if (refusal == NULL) {
        Py_BEGIN_ALLOW_THREADS
        status = rsd_rowwise_solve_assembled(&model, views[SOLVE_NORMAL].buf, views[SOLVE_PENALTY].buf,
                                             views[SOLVE_LATENT].buf, (size_t)views[SOLVE_LATENT].shape[0],
                                             views[SOLVE_WORKSPACE].buf);
        Py_END_ALLOW_THREADS
    }
    rsd_release(views, MOST);
    return conclude(refusal, status);
}

/* Return the floats of a model's normal matrix, or of workspace for solving (`solve` true) or the other kernels. */
static PyObject *sized(PyObject *args, bool normal)
{
    PyObject *o[OWN];
    Py_buffer views[OWN];
    Py_ssize_t rows;
    int solve = 0;
    if (!PyArg_ParseTuple(args, normal ? "OOOOOOOn" : "OOOOOOOni", o, o + 1, o + 2, o + 3, o + 4, o + 5, o + 6, &rows,
                          &solve) ||
        !acquire(o, views, NULL, OWN))
        return NULL;
    rsd_rowwise_model model;
    const char *refusal = rows < 0 ? "rows must not be negative" : as_model(views, (size_t)rows, &model);
    size_t floats = 0;
    if (refusal == NULL)
        floats = normal ? rsd_rowwise_assembled_size(&model) : rsd_rowwise_workspace(&model, solve);
    rsd_release(views, OWN);
    if (refusal == NULL && floats == 0)
        refusal = rsd_status_message(RSD_MODEL);
    return refusal == NULL ? PyLong_FromSize_t(floats) : conclude(refusal, RSD_OK);
}

PyObject *rsd_bind_rowwise_workspace(PyObject *module, PyObject *args)
{
    (void)module;
    return sized(args, false);
}

PyObject *rsd_bind_rowwise_assembled_size(PyObject *module, PyObject *args)
{
    (void)module;
    return sized(args, true);
}
