/* Arguments of Python calls: a table describes those of a function, and all are checked before a kernel uses them. */
#ifndef RSDEBLUR_ARGUMENTS_H
#define RSDEBLUR_ARGUMENTS_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <stdbool.h>

#include "rsdeblur_kernels.h"

typedef enum {
    /* Arrays: C-contiguous buffers. */
    COMPLEX64, FLOAT32, FLOAT64, INT32,
    /* Numbers. */
    INTEGER, REAL, TRUTH,
    /* No arguments but what the function returns, in the last row of its table. */
    RETURNED_INTEGER, RETURNED_TRUTH
} rsd_type;

/* A written array overlaps no other argument, but a SHARED one as far as the function itself allows. */
typedef enum { READ, WRITTEN, SHARED } rsd_access;

typedef struct {
    const char *name;
    rsd_type type;
    int ndim; /* 0 of numbers */
    rsd_access access;
} rsd_parameter;

/* Rows of every table; those beyond the last parameter are zero. */
#define RSD_MOST_PARAMETERS 13
typedef rsd_parameter rsd_parameters[RSD_MOST_PARAMETERS];

typedef union {
    Py_buffer array;
    Py_ssize_t integer; /* INTEGER, TRUTH and what is returned */
    double real;
} rsd_value;

/* Check the values against each other and call a kernel. Return NULL, or a message if either refuses them. */
typedef const char *rsd_function(rsd_value *given);

/* Call `function` with the values of `args`, which fit `parameters`, while other threads may run. */
PyObject *rsd_call(PyObject *args, const rsd_parameters parameters, rsd_function *function);

bool rsd_overlap(const Py_buffer *a, const Py_buffer *b);

/* Whether the `n` positions from `first` on lie within 0 to `length` - 1. */
bool rsd_within(Py_ssize_t first, Py_ssize_t n, Py_ssize_t length);

/* Return NULL for RSD_OK, else the message of a status. */
const char *rsd_refusal(rsd_status status);

/* Functions of the module that binding.c does not define, each for PyMethodDef. */
PyObject *rsd_bind_fit_tiles(PyObject *module, PyObject *args);
PyObject *rsd_bind_rowwise_forward(PyObject *module, PyObject *args);
PyObject *rsd_bind_rowwise_adjoint(PyObject *module, PyObject *args);
PyObject *rsd_bind_rowwise_solve(PyObject *module, PyObject *args);
PyObject *rsd_bind_rowwise_assemble(PyObject *module, PyObject *args);
PyObject *rsd_bind_rowwise_solve_assembled(PyObject *module, PyObject *args);
PyObject *rsd_bind_rowwise_assembled_size(PyObject *module, PyObject *args);
PyObject *rsd_bind_rowwise_workspace(PyObject *module, PyObject *args);

#endif
