/*
 * rsdeblur._cext: checks arguments, releases the GIL and calls the kernels. Only this file, binding_rowwise.c and
 * buffers.c use Python's API.
 *
 * The limited API (Python 3.11, set by the build) includes the buffer protocol, so NumPy's C API is not needed. Every
 * function has the parameters of its NumPy twin in rsdeblur.kernels.
 */
#include "buffers.h"

/* Layout of an array of three dimensions, whose first one counts planes. */
static rsd_layout layout_of(const Py_buffer *view)
{
    return (rsd_layout){(size_t)(view->shape[1] * view->shape[2]), (size_t)view->shape[2]};
}

static PyObject *none_if(bool success)
{
    if (!success)
        return NULL;
    Py_RETURN_NONE;
}

static bool call_multiply(Py_buffer *spectra, Py_buffer *responses)
{
    const Py_ssize_t *shape = spectra->shape, n = shape[2] * shape[3];
    const char *refusal = NULL;
    rsd_status status = RSD_OK;
    if (responses->shape[0] != shape[0] || responses->shape[1] != shape[2] || responses->shape[2] != shape[3])
        refusal = "responses must have the shape of one channel of spectra";
    else if (rsd_overlap(spectra, responses))
        refusal = "spectra and responses must not overlap";
    else {
        Py_BEGIN_ALLOW_THREADS
        for (Py_ssize_t b = 0; status == RSD_OK && b < shape[0]; b++)
            status = rsd_spectral_multiply((float *)spectra->buf + 2 * b * shape[1] * n,
                                           (const float *)responses->buf + 2 * b * n, (size_t)shape[1], (size_t)n);
        Py_END_ALLOW_THREADS
    }
    return rsd_conclude(refusal, status);
}

static PyObject *multiply(PyObject *module, PyObject *args)
{
    static const rsd_spec specs[] = {{"spectra", COMPLEX64, 4, true}, {"responses", COMPLEX64, 3, false}};
    PyObject *objects[2];
    Py_buffer views[2];
    (void)module;
    if (!PyArg_ParseTuple(args, "OO:multiply", &objects[0], &objects[1]) || !rsd_acquire(objects, views, specs, 2))
        return NULL;
    const bool success = call_multiply(&views[0], &views[1]);
    rsd_release(views, 2);
    return none_if(success);
}

/* Each row of `spans` holds the first position in the accumulator, the first one in the slab, and their number. */
static const char *refuse_spans(Py_buffer *accumulator, Py_buffer *slabs, Py_buffer *weights, Py_buffer *spans)
{
    if (accumulator->shape[0] != slabs->shape[1] || accumulator->shape[1] != slabs->shape[2])
        return "accumulator and slabs must have the same channels and columns";
    if (weights->shape[0] != slabs->shape[0] || spans->shape[0] != slabs->shape[0] || spans->shape[1] != 3)
        return "weights and spans must have a row for each slab, of spans with 3 values";
    for (const int32_t *span = spans->buf, *end = span + 3 * spans->shape[0]; span < end; span += 3)
        if (!rsd_within(span[0], span[2], accumulator->shape[2]) || !rsd_within(span[1], span[2], slabs->shape[3]) ||
            !rsd_within(0, span[2], weights->shape[1]))
            return "spans must lie within accumulator, slabs and weights";
    return rsd_overlap(accumulator, slabs) || rsd_overlap(accumulator, weights) || rsd_overlap(accumulator, spans)
               ? "accumulator must not overlap slabs, weights or spans"
               : NULL;
}

static bool call_blend(Py_buffer *accumulator, Py_buffer *slabs, Py_buffer *weights, Py_buffer *spans)
{
    const Py_ssize_t *shape = slabs->shape, lines = shape[1] * shape[2];
    const char *refusal = refuse_spans(accumulator, slabs, weights, spans);
    rsd_status status = RSD_OK;
    if (refusal == NULL) {
        Py_BEGIN_ALLOW_THREADS
        for (Py_ssize_t b = 0; status == RSD_OK && b < shape[0]; b++) {
            const int32_t *span = (const int32_t *)spans->buf + 3 * b;
            status = rsd_blend_lines((float *)accumulator->buf + 2 * span[0],
                                     (const float *)slabs->buf + 2 * (b * lines * shape[3] + span[1]),
                                     (const float *)weights->buf + b * weights->shape[1], (size_t)lines,
                                     (size_t)span[2], (size_t)accumulator->shape[2], (size_t)shape[3]);
        }
        Py_END_ALLOW_THREADS
    }
    return rsd_conclude(refusal, status);
}

static PyObject *blend(PyObject *module, PyObject *args)
{
    static const rsd_spec specs[] = {{"accumulator", COMPLEX64, 3, true},
                                     {"slabs", COMPLEX64, 4, false},
                                     {"weights", FLOAT32, 2, false},
                                     {"spans", INT32, 2, false}};
    PyObject *objects[4];
    Py_buffer views[4];
    (void)module;
    if (!PyArg_ParseTuple(args, "OOOO:blend", &objects[0], &objects[1], &objects[2], &objects[3]) ||
        !rsd_acquire(objects, views, specs, 4))
        return NULL;
    const bool success = call_blend(&views[0], &views[1], &views[2], &views[3]);
    rsd_release(views, 4);
    return none_if(success);
}

static bool call_picture_to_lines(Py_buffer *picture, Py_ssize_t top, Py_ssize_t rows, rsd_tile tile, Py_buffer *fade,
                                  Py_buffer *lines, int *finite)
{
    const Py_ssize_t width = picture->shape[1], channels = picture->shape[2];
    const char *refusal = NULL;
    rsd_status status = RSD_OK;
    tile.length = (size_t)lines->shape[2];
    tile.fade = fade->buf;
    tile.taper = (size_t)fade->shape[0];
    if (lines->shape[0] != channels)
        refusal = "lines and picture must have the same channels";
    else if (!rsd_within(top, rows, picture->shape[0]) || !rsd_within(0, rows, lines->shape[1]))
        refusal = "the rows from top on must lie within picture, and as many within lines";
    else if (rsd_overlap(lines, picture) || rsd_overlap(lines, fade))
        refusal = "lines must not overlap picture or fade";
    else {
        Py_BEGIN_ALLOW_THREADS
        status = rsd_picture_to_lines((const float *)picture->buf + top * width * channels, (size_t)rows, (size_t)width,
                                      (size_t)channels, tile, lines->buf, layout_of(lines), finite);
        Py_END_ALLOW_THREADS
    }
    return rsd_conclude(refusal, status);
}

static PyObject *picture_to_lines(PyObject *module, PyObject *args)
{
    static const rsd_spec specs[] = {
        {"picture", FLOAT32, 3, false}, {"fade", FLOAT32, 1, false}, {"lines", FLOAT32, 3, true}};
    PyObject *objects[3];
    Py_buffer views[3];
    Py_ssize_t top, rows, start;
    int periodic, finite = 1;
    (void)module;
    if (!PyArg_ParseTuple(args, "OnnnOpO:picture_to_lines", &objects[0], &top, &rows, &start, &objects[1], &periodic,
                          &objects[2]) ||
        !rsd_acquire(objects, views, specs, 3))
        return NULL;
    const rsd_tile tile = {.start = start, .periodic = periodic};
    const bool success = call_picture_to_lines(&views[0], top, rows, tile, &views[1], &views[2], &finite);
    rsd_release(views, 3);
    return success ? PyBool_FromLong(finite) : NULL;
}

static bool call_lines_to_picture(Py_buffer *lines, Py_ssize_t rows, Py_ssize_t offset, Py_buffer *weights,
                                  Py_ssize_t first, int add, Py_buffer *picture, Py_ssize_t top)
{
    const Py_ssize_t width = picture->shape[1], channels = picture->shape[2], n = weights->shape[0];
    const char *refusal = NULL;
    rsd_status status = RSD_OK;
    if (lines->shape[0] != channels)
        refusal = "lines and picture must have the same channels";
    else if (!rsd_within(top, rows, picture->shape[0]) || !rsd_within(0, rows, lines->shape[1]))
        refusal = "the rows from top on must lie within picture, and as many within lines";
    else if (!rsd_within(offset, n, lines->shape[2]) || !rsd_within(first, n, width))
        refusal = "the positions from offset on must lie within lines, and from first on within picture";
    else if (rsd_overlap(picture, lines) || rsd_overlap(picture, weights))
        refusal = "picture must not overlap lines or weights";
    else {
        Py_BEGIN_ALLOW_THREADS
        status = rsd_lines_to_picture((const float *)lines->buf + offset, layout_of(lines), (size_t)rows,
                                      (size_t)channels, weights->buf, (size_t)n, add,
                                      (float *)picture->buf + (top * width + first) * channels, (size_t)width);
        Py_END_ALLOW_THREADS
    }
    return rsd_conclude(refusal, status);
}

static PyObject *lines_to_picture(PyObject *module, PyObject *args)
{
    static const rsd_spec specs[] = {
        {"lines", FLOAT32, 3, false}, {"weights", FLOAT32, 1, false}, {"picture", FLOAT32, 3, true}};
    PyObject *objects[3];
    Py_buffer views[3];
    Py_ssize_t rows, offset, first, top;
    int add;
    (void)module;
    if (!PyArg_ParseTuple(args, "OnnOnpOn:lines_to_picture", &objects[0], &rows, &offset, &objects[1], &first, &add,
                          &objects[2], &top) ||
        !rsd_acquire(objects, views, specs, 3))
        return NULL;
    const bool success = call_lines_to_picture(&views[0], rows, offset, &views[1], first, add, &views[2], top);
    rsd_release(views, 3);
    return none_if(success);
}

static const char *refuse_pairs(Py_buffer *pairs, Py_buffer *turns, Py_buffer *spectra, Py_ssize_t top)
{
    const Py_ssize_t *shape = pairs->shape;
    if (spectra->shape[0] != shape[0])
        return "pairs and spectra must have the same channels";
    if (turns->shape[0] != shape[2] || shape[2] >= spectra->shape[2])
        return "turns must have a value for each pair, and spectra one more in a row";
    return rsd_within(top, shape[1], spectra->shape[1]) ? NULL : "the rows from top on must lie within spectra";
}

typedef rsd_status pairing(const float *, const float *, float *, size_t, size_t, size_t);

/* Either `from` or `to` is `pairs`, the other one is `spectra`, of which the rows from `top` on are used. */
static bool call_pairing(pairing *convert, Py_buffer *from, Py_buffer *to, Py_buffer *pairs, Py_buffer *turns,
                         Py_buffer *spectra, Py_ssize_t top)
{
    const Py_ssize_t *shape = pairs->shape, stride = spectra->shape[2];
    const char *refusal = refuse_pairs(pairs, turns, spectra, top);
    rsd_status status = RSD_OK;
    if (refusal == NULL && (rsd_overlap(to, from) || rsd_overlap(to, turns)))
        refusal = "what is written must not overlap another array";
    if (refusal == NULL) {
        Py_BEGIN_ALLOW_THREADS
        for (Py_ssize_t c = 0; status == RSD_OK && c < shape[0]; c++) {
            const Py_ssize_t of_pairs = 2 * c * shape[1] * shape[2];
            const Py_ssize_t of_spectra = 2 * (c * spectra->shape[1] + top) * stride;
            status = convert((const float *)from->buf + (from == pairs ? of_pairs : of_spectra), turns->buf,
                             (float *)to->buf + (to == pairs ? of_pairs : of_spectra), (size_t)shape[1],
                             (size_t)shape[2], (size_t)stride);
        }
        Py_END_ALLOW_THREADS
    }
    return rsd_conclude(refusal, status);
}

static PyObject *unpair(PyObject *module, PyObject *args)
{
    static const rsd_spec specs[] = {
        {"pairs", COMPLEX64, 3, false}, {"turns", COMPLEX64, 1, false}, {"spectra", COMPLEX64, 3, true}};
    PyObject *objects[3];
    Py_buffer views[3];
    Py_ssize_t top;
    (void)module;
    if (!PyArg_ParseTuple(args, "OOOn:unpair", &objects[0], &objects[1], &objects[2], &top) ||
        !rsd_acquire(objects, views, specs, 3))
        return NULL;
    const bool success = call_pairing(rsd_unpair, &views[0], &views[2], &views[0], &views[1], &views[2], top);
    rsd_release(views, 3);
    return none_if(success);
}

static PyObject *pair(PyObject *module, PyObject *args)
{
    static const rsd_spec specs[] = {
        {"spectra", COMPLEX64, 3, false}, {"turns", COMPLEX64, 1, false}, {"pairs", COMPLEX64, 3, true}};
    PyObject *objects[3];
    Py_buffer views[3];
    Py_ssize_t top;
    (void)module;
    if (!PyArg_ParseTuple(args, "OnOO:pair", &objects[0], &top, &objects[1], &objects[2]) ||
        !rsd_acquire(objects, views, specs, 3))
        return NULL;
    const bool success = call_pairing(rsd_pair, &views[0], &views[2], &views[2], &views[1], &views[0], top);
    rsd_release(views, 3);
    return none_if(success);
}

typedef rsd_status transposition(const float *, rsd_layout, float *, rsd_layout, size_t, size_t, size_t);

/* The lines of `columns` are columns of `rows`, from `first` on, with `height` values each. */
static bool call_transposition(transposition *transpose, Py_buffer *from, Py_buffer *to, Py_buffer *rows,
                               Py_buffer *columns, Py_ssize_t first, Py_ssize_t height)
{
    const Py_ssize_t channels = rows->shape[0], count = columns->shape[1];
    const Py_ssize_t skipped = 2 * first;
    const char *refusal = NULL;
    rsd_status status = RSD_OK;
    if (columns->shape[0] != channels)
        refusal = "rows and columns must have the same channels";
    else if (!rsd_within(first, count, rows->shape[2]))
        refusal = "the columns from first on must lie within rows";
    else if (!rsd_within(0, height, rows->shape[1]) || !rsd_within(0, height, columns->shape[2]))
        refusal = "height must lie within rows and columns";
    else if (rsd_overlap(rows, columns))
        refusal = "rows and columns must not overlap";
    else {
        Py_BEGIN_ALLOW_THREADS
        status = transpose((const float *)from->buf + (from == rows ? skipped : 0), layout_of(from),
                           (float *)to->buf + (to == rows ? skipped : 0), layout_of(to), (size_t)channels,
                           (size_t)height, (size_t)count);
        Py_END_ALLOW_THREADS
    }
    return rsd_conclude(refusal, status);
}

static PyObject *rows_to_columns(PyObject *module, PyObject *args)
{
    static const rsd_spec specs[] = {{"rows", COMPLEX64, 3, false}, {"columns", COMPLEX64, 3, true}};
    PyObject *objects[2];
    Py_buffer views[2];
    Py_ssize_t first, height;
    (void)module;
    if (!PyArg_ParseTuple(args, "OnnO:rows_to_columns", &objects[0], &first, &height, &objects[1]) ||
        !rsd_acquire(objects, views, specs, 2))
        return NULL;
    const bool success =
        call_transposition(rsd_rows_to_columns, &views[0], &views[1], &views[0], &views[1], first, height);
    rsd_release(views, 2);
    return none_if(success);
}

static PyObject *columns_to_rows(PyObject *module, PyObject *args)
{
    static const rsd_spec specs[] = {{"columns", COMPLEX64, 3, false}, {"rows", COMPLEX64, 3, true}};
    PyObject *objects[2];
    Py_buffer views[2];
    Py_ssize_t first, height;
    (void)module;
    if (!PyArg_ParseTuple(args, "OOnn:columns_to_rows", &objects[0], &objects[1], &first, &height) ||
        !rsd_acquire(objects, views, specs, 2))
        return NULL;
    const bool success =
        call_transposition(rsd_columns_to_rows, &views[0], &views[1], &views[1], &views[0], first, height);
    rsd_release(views, 2);
    return none_if(success);
}

/* Whether the only slab is `columns` itself, whose lines are extended in place: no value that is read is faded. */
static bool in_place(const Py_buffer *columns, Py_ssize_t height, const Py_buffer *starts, const Py_buffer *fade,
                     const Py_buffer *slabs)
{
    return slabs->buf == columns->buf && slabs->shape[0] == 1 && slabs->shape[3] == columns->shape[2] &&
           *(const int32_t *)starts->buf == 0 && fade->shape[0] <= slabs->shape[3] - height;
}

static bool call_cut_lines(Py_buffer *columns, Py_ssize_t height, Py_buffer *starts, Py_buffer *fade, int periodic,
                           Py_buffer *slabs)
{
    const Py_ssize_t *shape = slabs->shape;
    const char *refusal = NULL;
    rsd_status status = RSD_OK;
    if (shape[1] != columns->shape[0] || shape[2] != columns->shape[1])
        refusal = "slabs and columns must have the same channels and columns";
    else if (starts->shape[0] != shape[0])
        refusal = "starts must have a value for each slab";
    else if (!rsd_within(0, height, columns->shape[2]))
        refusal = "height must lie within columns";
    else if (rsd_overlap(slabs, fade) || rsd_overlap(slabs, starts) ||
             (rsd_overlap(slabs, columns) && !in_place(columns, height, starts, fade, slabs)))
        refusal = "slabs must not overlap fade or starts, nor columns unless the only one is the same array, starts "
                  "at 0 and fades only values from height on";
    else {
        const rsd_layout layout = {(size_t)(shape[2] * shape[3]), (size_t)shape[3]};
        rsd_tile tile = {.length = layout.line, .fade = fade->buf, .taper = (size_t)fade->shape[0],
                         .periodic = periodic};
        Py_BEGIN_ALLOW_THREADS
        for (Py_ssize_t b = 0; status == RSD_OK && b < shape[0]; b++) {
            tile.start = ((const int32_t *)starts->buf)[b];
            status = rsd_cut_lines(columns->buf, layout_of(columns), (size_t)height, tile,
                                   (float *)slabs->buf + 2 * b * shape[1] * shape[2] * shape[3], layout,
                                   (size_t)shape[1], (size_t)shape[2]);
        }
        Py_END_ALLOW_THREADS
    }
    return rsd_conclude(refusal, status);
}

static PyObject *cut_lines(PyObject *module, PyObject *args)
{
    static const rsd_spec specs[] = {{"columns", COMPLEX64, 3, false},
                                     {"starts", INT32, 1, false},
                                     {"fade", FLOAT32, 1, false},
                                     {"slabs", COMPLEX64, 4, true}};
    PyObject *objects[4];
    Py_buffer views[4];
    Py_ssize_t height;
    int periodic;
    (void)module;
    if (!PyArg_ParseTuple(args, "OnOOpO:cut_lines", &objects[0], &height, &objects[1], &objects[2], &periodic,
                          &objects[3]) ||
        !rsd_acquire(objects, views, specs, 4))
        return NULL;
    const bool success = call_cut_lines(&views[0], height, &views[1], &views[2], periodic, &views[3]);
    rsd_release(views, 4);
    return none_if(success);
}

typedef rsd_status shrinking(rsd_picture, size_t, size_t, rsd_shrinkage, float *, float *);

static bool call_shrinking(shrinking *shrink, Py_buffer *picture, Py_ssize_t top, Py_ssize_t rows, float threshold,
                           Py_buffer *polynomial, int periodic, Py_buffer *workspace, Py_buffer *out)
{
    const Py_ssize_t *shape = picture->shape, *planes = workspace->shape;
    const char *refusal = NULL;
    rsd_status status = RSD_OK;
    if (out->shape[0] != shape[0] || out->shape[1] != shape[1] || out->shape[2] != shape[2])
        refusal = "out must have the shape of picture";
    else if (!rsd_within(top, rows, shape[0]))
        refusal = "the rows from top on must lie within picture";
    else if (polynomial->shape[0] != RSD_SHRINK_TERMS)
        refusal = "polynomial must have 9 coefficients";
    else if (planes[0] != RSD_SHRINK_PLANES || planes[1] != shape[2] || planes[2] - 2 != shape[1])
        refusal = "workspace must have 10 planes of each channel, two values wider than picture";
    else if (rsd_overlap(out, picture) || rsd_overlap(out, polynomial) || rsd_overlap(out, workspace) ||
             rsd_overlap(workspace, picture) || rsd_overlap(workspace, polynomial))
        refusal = "out and workspace must not overlap each other or another array";
    else {
        const rsd_picture read = {picture->buf, (size_t)shape[0], (size_t)shape[1], (size_t)shape[2], periodic};
        Py_BEGIN_ALLOW_THREADS
        status = shrink(read, (size_t)top, (size_t)rows, (rsd_shrinkage){threshold, polynomial->buf}, workspace->buf,
                        out->buf);
        Py_END_ALLOW_THREADS
    }
    return rsd_conclude(refusal, status);
}

static PyObject *bind_shrinking(shrinking *shrink, const char *format, PyObject *args)
{
    static const rsd_spec specs[] = {{"picture", FLOAT32, 3, false},
                                     {"polynomial", FLOAT32, 1, false},
                                     {"workspace", FLOAT32, 3, true},
                                     {"out", FLOAT32, 3, true}};
    PyObject *objects[4];
    Py_buffer views[4];
    Py_ssize_t top, rows;
    float threshold;
    int periodic;
    if (!PyArg_ParseTuple(args, format, &objects[0], &top, &rows, &threshold, &objects[1], &periodic, &objects[2],
                          &objects[3]) ||
        !rsd_acquire(objects, views, specs, 4))
        return NULL;
    const bool success =
        call_shrinking(shrink, &views[0], top, rows, threshold, &views[1], periodic, &views[2], &views[3]);
    rsd_release(views, 4);
    return none_if(success);
}

static PyObject *shrunk_grad_adjoint(PyObject *module, PyObject *args)
{
    (void)module;
    return bind_shrinking(rsd_shrunk_grad_adjoint, "OnnfOpOO:shrunk_grad_adjoint", args);
}

static PyObject *shrunk_derivatives_adjoint(PyObject *module, PyObject *args)
{
    (void)module;
    return bind_shrinking(rsd_shrunk_derivatives_adjoint, "OnnfOpOO:shrunk_derivatives_adjoint", args);
}

PyDoc_STRVAR(multiply_doc, "multiply(spectra, responses, /)\n--\n\n");
PyDoc_STRVAR(blend_doc, "blend(accumulator, slabs, weights, spans, /)\n--\n\n");
PyDoc_STRVAR(unpair_doc, "unpair(pairs, turns, spectra, top, /)\n--\n\n");
PyDoc_STRVAR(pair_doc, "pair(spectra, top, turns, pairs, /)\n--\n\n");
PyDoc_STRVAR(picture_to_lines_doc, "picture_to_lines(picture, top, rows, start, fade, periodic, lines, /)\n--\n\n");
PyDoc_STRVAR(lines_to_picture_doc,
             "lines_to_picture(lines, rows, offset, weights, first, add, picture, top, /)\n--\n\n");
PyDoc_STRVAR(rows_to_columns_doc, "rows_to_columns(rows, first, height, columns, /)\n--\n\n");
PyDoc_STRVAR(columns_to_rows_doc, "columns_to_rows(columns, rows, first, height, /)\n--\n\n");
PyDoc_STRVAR(cut_lines_doc, "cut_lines(columns, height, starts, fade, periodic, slabs, /)\n--\n\n");
PyDoc_STRVAR(shrunk_grad_doc,
             "shrunk_grad_adjoint(picture, top, rows, threshold, polynomial, periodic, workspace, out, /)\n--\n\n");
PyDoc_STRVAR(
    shrunk_derivatives_doc,
    "shrunk_derivatives_adjoint(picture, top, rows, threshold, polynomial, periodic, workspace, out, /)\n--\n\n");
PyDoc_STRVAR(rowwise_doc, "See rsdeblur.kernels.rowwise.");

static PyMethodDef methods[] = {
    {"multiply", multiply, METH_VARARGS, multiply_doc},
    {"blend", blend, METH_VARARGS, blend_doc},
    {"unpair", unpair, METH_VARARGS, unpair_doc},
    {"pair", pair, METH_VARARGS, pair_doc},
    {"picture_to_lines", picture_to_lines, METH_VARARGS, picture_to_lines_doc},
    {"lines_to_picture", lines_to_picture, METH_VARARGS, lines_to_picture_doc},
    {"rows_to_columns", rows_to_columns, METH_VARARGS, rows_to_columns_doc},
    {"columns_to_rows", columns_to_rows, METH_VARARGS, columns_to_rows_doc},
    {"cut_lines", cut_lines, METH_VARARGS, cut_lines_doc},
    {"shrunk_grad_adjoint", shrunk_grad_adjoint, METH_VARARGS, shrunk_grad_doc},
    {"shrunk_derivatives_adjoint", shrunk_derivatives_adjoint, METH_VARARGS, shrunk_derivatives_doc},
    {"rowwise_forward", rsd_bind_rowwise_forward, METH_VARARGS, rowwise_doc},
    {"rowwise_adjoint", rsd_bind_rowwise_adjoint, METH_VARARGS, rowwise_doc},
    {"rowwise_solve", rsd_bind_rowwise_solve, METH_VARARGS, rowwise_doc},
    {"rowwise_assemble", rsd_bind_rowwise_assemble, METH_VARARGS, rowwise_doc},
    {"rowwise_solve_assembled", rsd_bind_rowwise_solve_assembled, METH_VARARGS, rowwise_doc},
    {"rowwise_workspace", rsd_bind_rowwise_workspace, METH_VARARGS, rowwise_doc},
    {"rowwise_assembled_size", rsd_bind_rowwise_assembled_size, METH_VARARGS, rowwise_doc},
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
