/*
 * rsdeblur._cext: checks buffers, releases the GIL, calls the kernels. All Python.h of the package is in the binding.
 *
 * The limited API (Python 3.11, set by the build) has the buffer protocol, so NumPy's C API is not needed.
 */
#include "binding.h"

#include <stdint.h>
#include <string.h>

static bool fits(const Py_buffer *view, wanted want)
{
    const bool is_complex = strcmp(want.format, COMPLEX64) == 0;
    const char *type = is_complex ? "complex64" : strcmp(want.format, INT32) == 0 ? "int32" : "float32";
    const Py_ssize_t itemsize = is_complex ? 8 : 4;
    if (view->format == NULL || strcmp(view->format, want.format) != 0 || view->itemsize != itemsize) {
        PyErr_Format(PyExc_TypeError, "%s must be %s, got a buffer of format '%s'", want.name, type,
                     view->format == NULL ? "B" : view->format);
        return false;
    }
    if (view->ndim != want.ndim) {
        PyErr_Format(PyExc_ValueError, "%s must have %d dimensions, got %d", want.name, want.ndim, view->ndim);
        return false;
    }
    if (!PyBuffer_IsContiguous(view, 'C')) {
        PyErr_Format(PyExc_ValueError, "%s must be C-contiguous", want.name);
        return false;
    }
    if ((uintptr_t)view->buf % sizeof(float) != 0) {
        PyErr_Format(PyExc_ValueError, "%s must be aligned to %d bytes", want.name, (int)sizeof(float));
        return false;
    }
    if (want.writable && view->readonly) {
        PyErr_Format(PyExc_ValueError, "%s is changed in place and must be writable", want.name);
        return false;
    }
    return true;
}

bool rsd_acquire(PyObject *object, Py_buffer *view, wanted want)
{
    if (PyObject_GetBuffer(object, view, PyBUF_STRIDES | PyBUF_FORMAT) < 0)
        return false;
    if (fits(view, want))
        return true;
    PyBuffer_Release(view);
    return false;
}

bool rsd_overlap(const Py_buffer *a, const Py_buffer *b)
{
    const uintptr_t a0 = (uintptr_t)a->buf, b0 = (uintptr_t)b->buf;
    return a0 < b0 + (uintptr_t)b->len && b0 < a0 + (uintptr_t)a->len;
}

PyObject *rsd_conclude(const char *refusal, rsd_status status)
{
    if (refusal == NULL && status != RSD_OK)
        refusal = rsd_status_message(status);
    if (refusal == NULL)
        Py_RETURN_NONE;
    PyErr_SetString(PyExc_ValueError, refusal);
    return NULL;
}

static PyObject *multiply_views(Py_buffer *spectra, Py_buffer *transfer)
{
    const Py_ssize_t *shape = spectra->shape;
    const char *refusal = NULL;
    rsd_status status = RSD_OK;
    if (transfer->shape[0] != shape[1] || transfer->shape[1] != shape[2])
        refusal = "transfer must have the shape of one channel of spectra";
    else if (rsd_overlap(spectra, transfer))
        refusal = "spectra and transfer must not overlap";
    else {
        Py_BEGIN_ALLOW_THREADS
        status = rsd_spectral_multiply(spectra->buf, transfer->buf, (size_t)shape[0], (size_t)(shape[1] * shape[2]));
        Py_END_ALLOW_THREADS
    }
    return rsd_conclude(refusal, status);
}

static PyObject *multiply(PyObject *module, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"spectra", "transfer", NULL};
    PyObject *spectra_object, *transfer_object, *result = NULL;
    Py_buffer spectra, transfer;
    (void)module;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OO:multiply", names, &spectra_object, &transfer_object))
        return NULL;
    if (!rsd_acquire(spectra_object, &spectra, (wanted){"spectra", COMPLEX64, 3, true}))
        return NULL;
    if (rsd_acquire(transfer_object, &transfer, (wanted){"transfer", COMPLEX64, 2, false})) {
        result = multiply_views(&spectra, &transfer);
        PyBuffer_Release(&transfer);
    }
    PyBuffer_Release(&spectra);
    return result;
}

static PyObject *blend_views(Py_buffer *accumulator, Py_buffer *slab, Py_buffer *weights, Py_ssize_t to_position,
                             Py_ssize_t from_position)
{
    const Py_ssize_t n = weights->shape[0], accumulator_length = accumulator->shape[2], slab_length = slab->shape[2];
    const char *refusal = NULL;
    rsd_status status = RSD_OK;
    if (accumulator->shape[0] != slab->shape[0] || accumulator->shape[1] != slab->shape[1])
        refusal = "accumulator and slab must have the same channels and columns";
    else if (to_position < 0 || n > accumulator_length || to_position > accumulator_length - n)
        refusal = "the positions from to_position on must lie within accumulator";
    else if (from_position < 0 || n > slab_length || from_position > slab_length - n)
        refusal = "the positions from from_position on must lie within slab";
    else if (rsd_overlap(accumulator, slab) || rsd_overlap(accumulator, weights))
        refusal = "accumulator must not overlap slab or weights";
    else {
        Py_BEGIN_ALLOW_THREADS
        status = rsd_blend_lines((float *)accumulator->buf + 2 * to_position, (const float *)slab->buf + 2 * from_position,
                                 weights->buf, (size_t)(slab->shape[0] * slab->shape[1]), (size_t)n,
                                 (size_t)accumulator_length, (size_t)slab_length);
        Py_END_ALLOW_THREADS
    }
    return rsd_conclude(refusal, status);
}

static PyObject *blend(PyObject *module, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"accumulator", "slab", "weights", "to_position", "from_position", NULL};
    PyObject *accumulator_object, *slab_object, *weights_object, *result = NULL;
    Py_buffer accumulator, slab, weights;
    Py_ssize_t to_position, from_position;
    (void)module;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOO$nn:blend", names, &accumulator_object, &slab_object,
                                     &weights_object, &to_position, &from_position))
        return NULL;
    if (!rsd_acquire(accumulator_object, &accumulator, (wanted){"accumulator", COMPLEX64, 3, true}))
        return NULL;
    if (rsd_acquire(slab_object, &slab, (wanted){"slab", COMPLEX64, 3, false})) {
        if (rsd_acquire(weights_object, &weights, (wanted){"weights", FLOAT32, 1, false})) {
            result = blend_views(&accumulator, &slab, &weights, to_position, from_position);
            PyBuffer_Release(&weights);
        }
        PyBuffer_Release(&slab);
    }
    PyBuffer_Release(&accumulator);
    return result;
}

static int add_constants(PyObject *module)
{
    return PyModule_AddStringConstant(module, "SIMD", rsd_simd_level());
}

PyDoc_STRVAR(multiply_doc, "multiply(spectra, transfer)\n--\n\nSee rsdeblur.kernels.spectral.multiply_numpy.");
PyDoc_STRVAR(blend_doc, "blend(accumulator, slab, weights, *, to_position, from_position)\n--\n\n"
                        "See rsdeblur.kernels.spectral.blend_numpy.");
PyDoc_STRVAR(rowwise_doc, "See rsdeblur.kernels.rowwise.");

/* C99 has no other way to store a function with keyword arguments in a PyCFunction. */
static PyMethodDef methods[] = {
    {"multiply", (PyCFunction)(void (*)(void))multiply, METH_VARARGS | METH_KEYWORDS, multiply_doc},
    {"blend", (PyCFunction)(void (*)(void))blend, METH_VARARGS | METH_KEYWORDS, blend_doc},
    {"rowwise_forward", rsd_bind_rowwise_forward, METH_VARARGS, rowwise_doc},
    {"rowwise_adjoint", rsd_bind_rowwise_adjoint, METH_VARARGS, rowwise_doc},
    {"rowwise_solve", rsd_bind_rowwise_solve, METH_VARARGS, rowwise_doc},
    {"rowwise_workspace", rsd_bind_rowwise_workspace, METH_VARARGS, rowwise_doc},
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
    if (module != NULL && add_constants(module) < 0) {
        Py_DECREF(module);
        return NULL;
    }
    return module;
}
