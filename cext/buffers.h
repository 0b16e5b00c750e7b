/* Buffers of Python objects, checked before a kernel uses them. */
#ifndef RSDEBLUR_BUFFERS_H
#define RSDEBLUR_BUFFERS_H

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
} rsd_spec;

/* Acquire the buffers of `n` objects, checked against `specs`. On failure, set an exception and hold no buffer. */
bool rsd_acquire(PyObject *const *objects, Py_buffer *views, const rsd_spec *specs, int n);

void rsd_release(Py_buffer *views, int n);

bool rsd_overlap(const Py_buffer *a, const Py_buffer *b);

/* Whether the `n` positions from `first` on lie within 0 to `length` - 1. */
bool rsd_within(Py_ssize_t first, Py_ssize_t n, Py_ssize_t length);

/* Return true on success, else false with a ValueError set. `refusal` is the binding's own reason, or NULL. */
bool rsd_conclude(const char *refusal, rsd_status status);

/* The functions of binding_rowwise.c. */
PyObject *rsd_bind_rowwise_forward(PyObject *module, PyObject *args);
PyObject *rsd_bind_rowwise_adjoint(PyObject *module, PyObject *args);
PyObject *rsd_bind_rowwise_solve(PyObject *module, PyObject *args);
PyObject *rsd_bind_rowwise_assemble(PyObject *module, PyObject *args);
PyObject *rsd_bind_rowwise_solve_assembled(PyObject *module, PyObject *args);
PyObject *rsd_bind_rowwise_assembled_size(PyObject *module, PyObject *args);
PyObject *rsd_bind_rowwise_workspace(PyObject *module, PyObject *args);

#endif
