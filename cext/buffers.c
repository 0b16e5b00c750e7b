#include "buffers.h"

#include <stdint.h>
#include <string.h>

static bool fits(const Py_buffer *view, rsd_spec spec)
{
    const bool is_complex = strcmp(spec.format, COMPLEX64) == 0;
    const char *type = is_complex ? "complex64" : strcmp(spec.format, INT32) == 0 ? "int32" : "float32";
    const Py_ssize_t itemsize = is_complex ? 8 : 4;
    if (view->format == NULL || strcmp(view->format, spec.format) != 0 || view->itemsize != itemsize) {
        PyErr_Format(PyExc_TypeError, "%s must be %s, got a buffer of format '%s'", spec.name, type,
                     view->format == NULL ? "B" : view->format);
        return false;
    }
    if (view->ndim != spec.ndim) {
        PyErr_Format(PyExc_ValueError, "%s must have %d dimensions, got %d", spec.name, spec.ndim, view->ndim);
        return false;
    }
    if (!PyBuffer_IsContiguous(view, 'C')) {
        PyErr_Format(PyExc_ValueError, "%s must be C-contiguous", spec.name);
        return false;
    }
    if ((uintptr_t)view->buf % sizeof(float) != 0) {
        PyErr_Format(PyExc_ValueError, "%s must be aligned to %d bytes", spec.name, (int)sizeof(float));
        return false;
    }
    if (spec.writable && view->readonly) {
        PyErr_Format(PyExc_ValueError, "%s is changed in place and must be writable", spec.name);
        return false;
    }
    return true;
}

bool rsd_acquire(PyObject *const *objects, Py_buffer *views, const rsd_spec *specs, int n)
{
    for (int i = 0; i < n; i++) {
        if (PyObject_GetBuffer(objects[i], &views[i], PyBUF_STRIDES | PyBUF_FORMAT) < 0) {
            rsd_release(views, i);
            return false;
        }
        if (!fits(&views[i], specs[i])) {
            rsd_release(views, i + 1);
            return false;
        }
    }
    return true;
}

void rsd_release(Py_buffer *views, int n)
{
    for (int i = 0; i < n; i++)
        PyBuffer_Release(&views[i]);
}

bool rsd_overlap(const Py_buffer *a, const Py_buffer *b)
{
    const uintptr_t a0 = (uintptr_t)a->buf, b0 = (uintptr_t)b->buf;
    return a0 < b0 + (uintptr_t)b->len && b0 < a0 + (uintptr_t)a->len;
}

bool rsd_within(Py_ssize_t first, Py_ssize_t n, Py_ssize_t length)
{
    return first >= 0 && n >= 0 && n <= length && first <= length - n;
}

bool rsd_conclude(const char *refusal, rsd_status status)
{
    if (refusal == NULL && status != RSD_OK)
        refusal = rsd_status_message(status);
    if (refusal != NULL)
        PyErr_SetString(PyExc_ValueError, refusal);
    return refusal == NULL;
}
