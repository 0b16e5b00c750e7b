#include "arguments.h"

#include <stdint.h>
#include <string.h>

/* Types of arrays, in the order of rsd_type. */
static const struct {
    const char *name, *format;
    Py_ssize_t size, alignment;
} types[] = {{"complex64", "Zf", 8, 4}, {"float32", "f", 4, 4}, {"float64", "d", 8, 8}, {"int32", "i", 4, 4}};

static bool is_array(rsd_parameter parameter)
{
    return parameter.ndim > 0;
}

static bool fits(const Py_buffer *view, rsd_parameter wanted)
{
    const char *name = wanted.name;
    if (view->format == NULL || strcmp(view->format, types[wanted.type].format) != 0 ||
        view->itemsize != types[wanted.type].size)
        PyErr_Format(PyExc_TypeError, "%s must be %s, got a buffer of format '%s'", name, types[wanted.type].name,
                     view->format == NULL ? "B" : view->format);
    else if (view->ndim != wanted.ndim)
        PyErr_Format(PyExc_ValueError, "%s must have %d dimensions, got %d", name, wanted.ndim, view->ndim);
    else if (!PyBuffer_IsContiguous(view, 'C'))
        PyErr_Format(PyExc_ValueError, "%s must be C-contiguous", name);
    else if ((uintptr_t)view->buf % (uintptr_t)types[wanted.type].alignment != 0)
        PyErr_Format(PyExc_ValueError, "%s must be aligned to %d bytes", name, (int)types[wanted.type].alignment);
    else if (wanted.access == WRITTEN && view->readonly)
        PyErr_Format(PyExc_ValueError, "%s is changed in place and must be writable", name);
    else
        return true;
    return false;
}

/* Convert an argument. On failure, set an exception and hold no buffer. */
static bool convert(PyObject *argument, rsd_parameter wanted, rsd_value *value)
{
    if (is_array(wanted)) {
        if (PyObject_GetBuffer(argument, &value->array, PyBUF_STRIDES | PyBUF_FORMAT) < 0)
            return false;
        if (fits(&value->array, wanted))
            return true;
        PyBuffer_Release(&value->array);
        return false;
    }
    if (wanted.type == REAL)
        value->real = PyFloat_AsDouble(argument);
    else if (wanted.type == TRUTH)
        value->integer = PyObject_IsTrue(argument);
    else
        value->integer = PyNumber_AsSsize_t(argument, PyExc_OverflowError);
    return PyErr_Occurred() == NULL;
}

/* Whether no written array overlaps another argument; if one does, set an exception. */
static bool are_apart(const rsd_parameter *parameters, const rsd_value *given, int count)
{
    for (int a = 0; a < count; a++)
        for (int b = 0; b < count; b++)
            if (a != b && parameters[a].access == WRITTEN && is_array(parameters[b]) &&
                parameters[b].access != SHARED && rsd_overlap(&given[a].array, &given[b].array)) {
                PyErr_Format(PyExc_ValueError, "%s must not overlap %s", parameters[a].name, parameters[b].name);
                return false;
            }
    return true;
}

static void release(const rsd_parameter *parameters, rsd_value *given, int count)
{
    for (int i = 0; i < count; i++)
        if (is_array(parameters[i]))
            PyBuffer_Release(&given[i].array);
}

PyObject *rsd_call(PyObject *args, const rsd_parameters parameters, rsd_function *function)
{
    rsd_value given[RSD_MOST_PARAMETERS];
    const char *refusal = NULL;
    int count = 0, converted = 0;
    while (count < RSD_MOST_PARAMETERS && parameters[count].name != NULL && parameters[count].type < RETURNED_INTEGER)
        count++;
    if (PyTuple_Size(args) != count)
        return PyErr_Format(PyExc_TypeError, "%d arguments are needed, got %zd", count, PyTuple_Size(args));
    while (converted < count &&
           convert(PyTuple_GetItem(args, converted), parameters[converted], &given[converted]))
        converted++;
    const bool called = converted == count && are_apart(parameters, given, count);
    if (called) {
        Py_BEGIN_ALLOW_THREADS
        refusal = function(given);
        Py_END_ALLOW_THREADS
    }
    release(parameters, given, converted);
    if (refusal != NULL)
        PyErr_SetString(PyExc_ValueError, refusal);
    if (!called || refusal != NULL)
        return NULL;
    if (count == RSD_MOST_PARAMETERS || parameters[count].name == NULL)
        Py_RETURN_NONE;
    return parameters[count].type == RETURNED_TRUTH ? PyBool_FromLong(given[count].integer != 0)
                                                    : PyLong_FromSsize_t(given[count].integer);
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

const char *rsd_refusal(rsd_status status)
{
    return status == RSD_OK ? NULL : rsd_status_message(status);
}
