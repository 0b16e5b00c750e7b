/*
 * rsdeblur._cext: checks arguments, releases the GIL and calls the kernels. Only this file, binding_rowwise.c,
 * binding_whittle.c and arguments.c use Python's API.
 *
 * The limited API (Python 3.11, set by the build) includes the buffer protocol, so NumPy's C API is not needed. Every
 * function has the parameters of its NumPy twin in rsdeblur.kernels: `name` lists them, and `call_name` takes them.
 */
#include "arguments.h"

/* Layout of an array of three dimensions, whose first one counts planes. */
static rsd_layout layout_of(const Py_buffer *view)
{
    return (rsd_layout){(size_t)(view->shape[1] * view->shape[2]), (size_t)view->shape[2]};
}

/* Whether `array` (B, K, L) has the shape of one channel of `spectra` (B, C, K, L). */
static bool is_channel(const Py_buffer *array, const Py_buffer *spectra)
{
    return array->shape[0] == spectra->shape[0] && array->shape[1] == spectra->shape[2] &&
           array->shape[2] == spectra->shape[3];
}

static bool have_equal_shapes(const Py_buffer *a, const Py_buffer *b)
{
    for (int axis = 0; axis < a->ndim; axis++)
        if (a->shape[axis] != b->shape[axis])
            return false;
    return true;
}

static const char *call_multiply(rsd_value *given)
{
    const Py_buffer *spectra = &given[0].array, *responses = &given[1].array;
    const Py_ssize_t *shape = spectra->shape, n = shape[2] * shape[3];
    rsd_status status = RSD_OK;
    if (!is_channel(responses, spectra))
        return "responses must have the shape of one channel of spectra";
    for (Py_ssize_t b = 0; status == RSD_OK && b < shape[0]; b++)
        status = rsd_spectral_multiply((float *)spectra->buf + 2 * b * shape[1] * n,
                                       (const float *)responses->buf + 2 * b * n, (size_t)shape[1], (size_t)n);
    return rsd_refusal(status);
}

static PyObject *multiply(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {{"spectra", COMPLEX64, 4, WRITTEN}, {"responses", COMPLEX64, 3, READ}};
    (void)module;
    return rsd_call(args, parameters, call_multiply);
}

static const char *call_add_normal(rsd_value *given)
{
    const Py_buffer *spectra = &given[0].array, *otfs = &given[1].array;
    const Py_buffer *signal = &given[4].array, *power = &given[5].array;
    const Py_ssize_t *shape = spectra->shape, n = shape[2] * shape[3];
    rsd_status status = RSD_OK;
    if (!is_channel(otfs, spectra) || !have_equal_shapes(power, otfs) || !have_equal_shapes(signal, spectra))
        return "signal must have the shape of spectra, and otfs and power that of one of its channels";
    for (Py_ssize_t b = 0; status == RSD_OK && b < shape[0]; b++)
        status = rsd_add_normal((const float *)spectra->buf + 2 * b * shape[1] * n,
                                (const float *)otfs->buf + 2 * b * n, (float)given[2].real, (int)given[3].integer,
                                (float *)signal->buf + 2 * b * shape[1] * n, (float *)power->buf + b * n,
                                (size_t)shape[1], (size_t)n);
    return rsd_refusal(status);
}

static PyObject *add_normal(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {{"spectra", COMPLEX64, 4, READ},   {"otfs", COMPLEX64, 3, READ},
                                              {"share", REAL, 0, READ},          {"first", TRUTH, 0, READ},
                                              {"signal", COMPLEX64, 4, WRITTEN}, {"power", FLOAT32, 3, WRITTEN}};
    (void)module;
    return rsd_call(args, parameters, call_add_normal);
}

static const char *call_solve_normal(rsd_value *given)
{
    const Py_buffer *signal = &given[0].array, *power = &given[1].array;
    const Py_buffer *across = &given[2].array, *down = &given[3].array, *coupling = &given[5].array;
    const Py_buffer *spectra = &given[8].array;
    const Py_ssize_t *shape = spectra->shape, n = shape[2] * shape[3];
    rsd_status status = RSD_OK;
    if (!have_equal_shapes(signal, spectra) || !is_channel(power, spectra))
        return "signal must have the shape of spectra, and power that of one of its channels";
    if (across->shape[0] != shape[2] || down->shape[0] != shape[3] || coupling->shape[0] != 3)
        return "across must have a value for each column, down one for each of its places, and coupling 3";
    const rsd_prior prior = {.nsr = (float)given[4].real,
                             .coupling = coupling->buf,
                             .pull = (float)given[6].real,
                             .across = across->buf,
                             .down = down->buf};
    for (Py_ssize_t b = 0; status == RSD_OK && b < shape[0]; b++)
        status = rsd_solve_normal((const float *)signal->buf + 2 * b * shape[1] * n,
                                  (const float *)power->buf + b * n, prior, (float)given[7].real,
                                  (float *)spectra->buf + 2 * b * shape[1] * n, (size_t)shape[1], (size_t)shape[2],
                                  (size_t)shape[3]);
    return rsd_refusal(status);
}

static PyObject *solve_normal(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {
        {"signal", COMPLEX64, 4, READ}, {"power", FLOAT32, 3, READ}, {"across", FLOAT32, 1, READ},
        {"down", FLOAT32, 1, READ},     {"nsr", REAL, 0, READ},      {"coupling", FLOAT32, 1, READ},
        {"pull", REAL, 0, READ},        {"scale", REAL, 0, READ},    {"spectra", COMPLEX64, 4, WRITTEN}};
    (void)module;
    return rsd_call(args, parameters, call_solve_normal);
}

/* Each row of `spans` holds the first position in the accumulator, the first one in the slab, and their number. */
static const char *call_blend(rsd_value *given)
{
    const Py_buffer *accumulator = &given[0].array, *slabs = &given[1].array, *weights = &given[2].array;
    const Py_buffer *spans = &given[3].array;
    const Py_ssize_t *shape = slabs->shape, lines = shape[1] * shape[2];
    const int32_t *span = spans->buf;
    rsd_status status = RSD_OK;
    if (accumulator->shape[0] != shape[1] || accumulator->shape[1] != shape[2])
        return "accumulator and slabs must have the same channels and columns";
    if (weights->shape[0] != shape[0] || spans->shape[0] != shape[0] || spans->shape[1] != 3)
        return "weights and spans must have a row for each slab, of spans with 3 values";
    for (Py_ssize_t b = 0; b < shape[0]; b++)
        if (!rsd_within(span[3 * b], span[3 * b + 2], accumulator->shape[2]) ||
            !rsd_within(span[3 * b + 1], span[3 * b + 2], shape[3]) ||
            !rsd_within(0, span[3 * b + 2], weights->shape[1]))
            return "spans must lie within accumulator, slabs and weights";
    for (Py_ssize_t b = 0; status == RSD_OK && b < shape[0]; b++, span += 3)
        status = rsd_blend_lines((float *)accumulator->buf + 2 * span[0],
                                 (const float *)slabs->buf + 2 * (b * lines * shape[3] + span[1]),
                                 (const float *)weights->buf + b * weights->shape[1], (size_t)lines, (size_t)span[2],
                                 (size_t)accumulator->shape[2], (size_t)shape[3]);
    return rsd_refusal(status);
}

static PyObject *blend(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {{"accumulator", COMPLEX64, 3, WRITTEN},
                                              {"slabs", COMPLEX64, 4, READ},
                                              {"weights", FLOAT32, 2, READ},
                                              {"spans", INT32, 2, READ}};
    (void)module;
    return rsd_call(args, parameters, call_blend);
}

static const char *call_picture_to_lines(rsd_value *given)
{
    const Py_buffer *picture = &given[0].array, *fade = &given[4].array, *lines = &given[6].array;
    const Py_ssize_t top = given[1].integer, rows = given[2].integer;
    const Py_ssize_t width = picture->shape[1], channels = picture->shape[2];
    const rsd_tile tile = {.start = given[3].integer,
                           .length = (size_t)lines->shape[2],
                           .fade = fade->buf,
                           .taper = (size_t)fade->shape[0],
                           .periodic = (int)given[5].integer};
    int finite = 1;
    if (lines->shape[0] != channels)
        return "lines and picture must have the same channels";
    if (!rsd_within(top, rows, picture->shape[0]) || !rsd_within(0, rows, lines->shape[1]))
        return "the rows from top on must lie within picture, and as many within lines";
    const rsd_status status =
        rsd_picture_to_lines((const float *)picture->buf + top * width * channels, (size_t)rows, (size_t)width,
                             (size_t)channels, tile, lines->buf, layout_of(lines), &finite);
    given[7].integer = finite;
    return rsd_refusal(status);
}

static PyObject *picture_to_lines(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {
        {"picture", FLOAT32, 3, READ}, {"top", INTEGER, 0, READ},    {"rows", INTEGER, 0, READ},
        {"start", INTEGER, 0, READ},   {"fade", FLOAT32, 1, READ},   {"periodic", TRUTH, 0, READ},
        {"lines", FLOAT32, 3, WRITTEN}, {"finite", RETURNED_TRUTH, 0, READ}};
    (void)module;
    return rsd_call(args, parameters, call_picture_to_lines);
}

static const char *call_lines_to_picture(rsd_value *given)
{
    const Py_buffer *lines = &given[0].array, *weights = &given[3].array, *picture = &given[6].array;
    const Py_ssize_t rows = given[1].integer, offset = given[2].integer;
    const Py_ssize_t first = given[4].integer, top = given[7].integer;
    const Py_ssize_t width = picture->shape[1], channels = picture->shape[2], n = weights->shape[0];
    if (lines->shape[0] != channels)
        return "lines and picture must have the same channels";
    if (!rsd_within(top, rows, picture->shape[0]) || !rsd_within(0, rows, lines->shape[1]))
        return "the rows from top on must lie within picture, and as many within lines";
    if (!rsd_within(offset, n, lines->shape[2]) || !rsd_within(first, n, width))
        return "the positions from offset on must lie within lines, and from first on within picture";
    return rsd_refusal(rsd_lines_to_picture((const float *)lines->buf + offset, layout_of(lines), (size_t)rows,
                                            (size_t)channels, weights->buf, (size_t)n, (int)given[5].integer,
                                            (float *)picture->buf + (top * width + first) * channels, (size_t)width));
}

static PyObject *lines_to_picture(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {
        {"lines", FLOAT32, 3, READ},   {"rows", INTEGER, 0, READ},  {"offset", INTEGER, 0, READ},
        {"weights", FLOAT32, 1, READ}, {"first", INTEGER, 0, READ}, {"add", TRUTH, 0, READ},
        {"picture", FLOAT32, 3, WRITTEN}, {"top", INTEGER, 0, READ}};
    (void)module;
    return rsd_call(args, parameters, call_lines_to_picture);
}

typedef rsd_status pairing(const float *, const float *, float *, size_t, size_t, size_t);

/* Either `from` or `to` is `pairs`, the other one is `spectra`, of which the rows from `top` on are used. */
static const char *call_pairing(pairing *convert, const Py_buffer *from, const Py_buffer *to, const Py_buffer *pairs,
                                const Py_buffer *turns, const Py_buffer *spectra, Py_ssize_t top)
{
    const Py_ssize_t *shape = pairs->shape, stride = spectra->shape[2];
    rsd_status status = RSD_OK;
    if (spectra->shape[0] != shape[0])
        return "pairs and spectra must have the same channels";
    if (turns->shape[0] != shape[2] || shape[2] >= stride)
        return "turns must have a value for each pair, and spectra one more in a row";
    if (!rsd_within(top, shape[1], spectra->shape[1]))
        return "the rows from top on must lie within spectra";
    for (Py_ssize_t c = 0; status == RSD_OK && c < shape[0]; c++) {
        const Py_ssize_t of_pairs = 2 * c * shape[1] * shape[2];
        const Py_ssize_t of_spectra = 2 * (c * spectra->shape[1] + top) * stride;
        status = convert((const float *)from->buf + (from == pairs ? of_pairs : of_spectra), turns->buf,
                         (float *)to->buf + (to == pairs ? of_pairs : of_spectra), (size_t)shape[1],
                         (size_t)shape[2], (size_t)stride);
    }
    return rsd_refusal(status);
}

static const char *call_unpair(rsd_value *given)
{
    const Py_buffer *pairs = &given[0].array, *turns = &given[1].array, *spectra = &given[2].array;
    return call_pairing(rsd_unpair, pairs, spectra, pairs, turns, spectra, given[3].integer);
}

static PyObject *unpair(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {{"pairs", COMPLEX64, 3, READ},
                                              {"turns", COMPLEX64, 1, READ},
                                              {"spectra", COMPLEX64, 3, WRITTEN},
                                              {"top", INTEGER, 0, READ}};
    (void)module;
    return rsd_call(args, parameters, call_unpair);
}

static const char *call_pair(rsd_value *given)
{
    const Py_buffer *spectra = &given[0].array, *turns = &given[2].array, *pairs = &given[3].array;
    return call_pairing(rsd_pair, spectra, pairs, pairs, turns, spectra, given[1].integer);
}

static PyObject *pair(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {{"spectra", COMPLEX64, 3, READ},
                                              {"top", INTEGER, 0, READ},
                                              {"turns", COMPLEX64, 1, READ},
                                              {"pairs", COMPLEX64, 3, WRITTEN}};
    (void)module;
    return rsd_call(args, parameters, call_pair);
}

typedef rsd_status transposition(const float *, rsd_layout, float *, rsd_layout, size_t, size_t, size_t);

/* Either `from` or `to` is `rows`; the lines of `columns` are its columns from `first` on, `height` values each. */
static const char *call_transposition(transposition *transpose, const Py_buffer *from, const Py_buffer *to,
                                      const Py_buffer *rows, const Py_buffer *columns, Py_ssize_t first,
                                      Py_ssize_t height)
{
    const Py_ssize_t channels = rows->shape[0], count = columns->shape[1], skipped = 2 * first;
    if (columns->shape[0] != channels)
        return "rows and columns must have the same channels";
    if (!rsd_within(first, count, rows->shape[2]))
        return "the columns from first on must lie within rows";
    if (!rsd_within(0, height, rows->shape[1]) || !rsd_within(0, height, columns->shape[2]))
        return "height must lie within rows and columns";
    return rsd_refusal(transpose((const float *)from->buf + (from == rows ? skipped : 0), layout_of(from),
                                 (float *)to->buf + (to == rows ? skipped : 0), layout_of(to), (size_t)channels,
                                 (size_t)height, (size_t)count));
}

static const char *call_rows_to_columns(rsd_value *given)
{
    const Py_buffer *rows = &given[0].array, *columns = &given[3].array;
    return call_transposition(rsd_rows_to_columns, rows, columns, rows, columns, given[1].integer, given[2].integer);
}

static PyObject *rows_to_columns(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {{"rows", COMPLEX64, 3, READ},
                                              {"first", INTEGER, 0, READ},
                                              {"height", INTEGER, 0, READ},
                                              {"columns", COMPLEX64, 3, WRITTEN}};
    (void)module;
    return rsd_call(args, parameters, call_rows_to_columns);
}

static const char *call_columns_to_rows(rsd_value *given)
{
    const Py_buffer *columns = &given[0].array, *rows = &given[1].array;
    return call_transposition(rsd_columns_to_rows, columns, rows, rows, columns, given[2].integer, given[3].integer);
}

static PyObject *columns_to_rows(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {{"columns", COMPLEX64, 3, READ},
                                              {"rows", COMPLEX64, 3, WRITTEN},
                                              {"first", INTEGER, 0, READ},
                                              {"height", INTEGER, 0, READ}};
    (void)module;
    return rsd_call(args, parameters, call_columns_to_rows);
}

/* Whether the only slab is `columns` itself, whose lines are extended in place: no value that is read is faded. */
static bool in_place(const Py_buffer *columns, Py_ssize_t height, const Py_buffer *starts, const Py_buffer *fade,
                     const Py_buffer *slabs)
{
    return slabs->buf == columns->buf && slabs->shape[0] == 1 && slabs->shape[3] == columns->shape[2] &&
           *(const int32_t *)starts->buf == 0 && fade->shape[0] <= slabs->shape[3] - height;
}

static const char *call_cut_lines(rsd_value *given)
{
    const Py_buffer *columns = &given[0].array, *starts = &given[2].array, *fade = &given[3].array;
    const Py_buffer *slabs = &given[5].array;
    const Py_ssize_t height = given[1].integer, *shape = slabs->shape;
    const rsd_layout layout = {(size_t)(shape[2] * shape[3]), (size_t)shape[3]};
    rsd_tile tile = {.length = layout.line,
                     .fade = fade->buf,
                     .taper = (size_t)fade->shape[0],
                     .periodic = (int)given[4].integer};
    rsd_status status = RSD_OK;
    if (shape[1] != columns->shape[0] || shape[2] != columns->shape[1])
        return "slabs and columns must have the same channels and columns";
    if (starts->shape[0] != shape[0])
        return "starts must have a value for each slab";
    if (!rsd_within(0, height, columns->shape[2]))
        return "height must lie within columns";
    if (rsd_overlap(slabs, columns) && !in_place(columns, height, starts, fade, slabs))
        return "slabs must not overlap columns unless the only one is the same array, starts at 0 and fades only "
               "values from height on";
    for (Py_ssize_t b = 0; status == RSD_OK && b < shape[0]; b++) {
        tile.start = ((const int32_t *)starts->buf)[b];
        status = rsd_cut_lines(columns->buf, layout_of(columns), (size_t)height, tile,
                               (float *)slabs->buf + 2 * b * shape[1] * shape[2] * shape[3], layout, (size_t)shape[1],
                               (size_t)shape[2]);
    }
    return rsd_refusal(status);
}

static PyObject *cut_lines(PyObject *module, PyObject *args)
{
    static const rsd_parameters parameters = {{"columns", COMPLEX64, 3, SHARED}, {"height", INTEGER, 0, READ},
                                              {"starts", INT32, 1, READ},        {"fade", FLOAT32, 1, READ},
                                              {"periodic", TRUTH, 0, READ},      {"slabs", COMPLEX64, 4, WRITTEN}};
    (void)module;
    return rsd_call(args, parameters, call_cut_lines);
}

typedef rsd_status shrinking(rsd_picture, size_t, size_t, rsd_shrinkage, float *, float *);

static const rsd_parameters shrinking_parameters = {
    {"picture", FLOAT32, 3, READ},      {"top", INTEGER, 0, READ},        {"rows", INTEGER, 0, READ},
    {"threshold", REAL, 0, READ},       {"polynomial", FLOAT32, 1, READ}, {"periodic", TRUTH, 0, READ},
    {"workspace", FLOAT32, 3, WRITTEN}, {"out", FLOAT32, 3, WRITTEN}};

static const char *call_shrinking(shrinking *shrink, rsd_value *given)
{
    const Py_buffer *picture = &given[0].array, *polynomial = &given[4].array;
    const Py_buffer *workspace = &given[6].array, *out = &given[7].array;
    const Py_ssize_t top = given[1].integer, rows = given[2].integer;
    const Py_ssize_t *shape = picture->shape, *planes = workspace->shape;
    if (!have_equal_shapes(out, picture))
        return "out must have the shape of picture";
    if (!rsd_within(top, rows, shape[0]))
        return "the rows from top on must lie within picture";
    if (polynomial->shape[0] != RSD_SHRINK_TERMS)
        return "polynomial must have 9 coefficients";
    if (planes[0] != RSD_SHRINK_PLANES || planes[1] != shape[2] || planes[2] - 2 != shape[1])
        return "workspace must have 10 planes of each channel, two values wider than picture";
    const rsd_picture read = {picture->buf, (size_t)shape[0], (size_t)shape[1], (size_t)shape[2],
                              (int)given[5].integer};
    return rsd_refusal(shrink(read, (size_t)top, (size_t)rows, (rsd_shrinkage){(float)given[3].real, polynomial->buf},
                              workspace->buf, out->buf));
}

static const char *call_shrunk_grad_adjoint(rsd_value *given)
{
    return call_shrinking(rsd_shrunk_grad_adjoint, given);
}

static PyObject *shrunk_grad_adjoint(PyObject *module, PyObject *args)
{
    (void)module;
    return rsd_call(args, shrinking_parameters, call_shrunk_grad_adjoint);
}

static const char *call_shrunk_derivatives_adjoint(rsd_value *given)
{
    return call_shrinking(rsd_shrunk_derivatives_adjoint, given);
}

static PyObject *shrunk_derivatives_adjoint(PyObject *module, PyObject *args)
{
    (void)module;
    return rsd_call(args, shrinking_parameters, call_shrunk_derivatives_adjoint);
}

PyDoc_STRVAR(doc, "See the NumPy twin in rsdeblur.kernels.");

static PyMethodDef methods[] = {
    {"multiply", multiply, METH_VARARGS, doc},
    {"add_normal", add_normal, METH_VARARGS, doc},
    {"solve_normal", solve_normal, METH_VARARGS, doc},
    {"blend", blend, METH_VARARGS, doc},
    {"unpair", unpair, METH_VARARGS, doc},
    {"pair", pair, METH_VARARGS, doc},
    {"picture_to_lines", picture_to_lines, METH_VARARGS, doc},
    {"lines_to_picture", lines_to_picture, METH_VARARGS, doc},
    {"rows_to_columns", rows_to_columns, METH_VARARGS, doc},
    {"columns_to_rows", columns_to_rows, METH_VARARGS, doc},
    {"cut_lines", cut_lines, METH_VARARGS, doc},
    {"shrunk_grad_adjoint", shrunk_grad_adjoint, METH_VARARGS, doc},
    {"shrunk_derivatives_adjoint", shrunk_derivatives_adjoint, METH_VARARGS, doc},
    {"fit_tiles", rsd_bind_fit_tiles, METH_VARARGS, doc},
    {"rowwise_forward", rsd_bind_rowwise_forward, METH_VARARGS, doc},
    {"rowwise_adjoint", rsd_bind_rowwise_adjoint, METH_VARARGS, doc},
    {"rowwise_solve", rsd_bind_rowwise_solve, METH_VARARGS, doc},
    {"rowwise_assemble", rsd_bind_rowwise_assemble, METH_VARARGS, doc},
    {"rowwise_solve_assembled", rsd_bind_rowwise_solve_assembled, METH_VARARGS, doc},
    {"rowwise_workspace", rsd_bind_rowwise_workspace, METH_VARARGS, doc},
    {"rowwise_assembled_size", rsd_bind_rowwise_assembled_size, METH_VARARGS, doc},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT,
    .m_name = "_cext",
    .m_doc = "C kernels of rsdeblur; import them through rsdeblur.kernels.",
    .m_methods = methods,
};

PyMODINIT_FUNC PyInit__cext(void)
{
    PyObject *module = PyModule_Create(&definition);
    if (module != NULL && PyModule_AddStringConstant(module, "SIMD", rsd_simd_level()) < 0) {
        Py_DECREF(module);
        return NULL;
    }
    return module;
}
