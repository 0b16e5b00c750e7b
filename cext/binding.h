/* What the two halves of the binding share. */
#ifndef RSDEBLUR_BINDING_H
#define RSDEBLUR_BINDING_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <stdbool.h>

#include "rsdeblur_kernels.h"

#define COMPLEX64 "Zf"
#define FLOAT32 "f"
#define INT32 "i"

typedef struct {
    const char *name;
    const char *format; /* COMPLEX64, FLOAT32 or INT32 */
    int ndim;
    bool writable;
} wanted;

/* Fill `view` with a buffer that is as wanted, or set an exception and hold nothing. */
bool rsd_acquire(PyObject *object, Py_buffer *view, wanted want);

bool rsd_overlap(const Py_buffer *a, const Py_buffer *b);

/* None on success; otherwise null with an exception set, `refusal` being the binding's own, if any. */
PyObject *rsd_conclude(const char *refusal, rsd_status status);

PyObject *rsd_bind_rowwise_forward(PyObject *module, PyObject *args);
PyObject *rsd_bind_rowwise_adjoint(PyObject *module, PyObject *args);
PyObject *rsd_bind_rowwise_solve(PyObject *module, PyObject *args);
PyObject *rsd_bind_rowwise_workspace(PyObject *module, PyObject *args);

#endif
