# C types of ulog_records.py: they make the compiled class fast and change no result.
cimport cython

from arena.kernels.ulog_quantities cimport UlogQuantities

cdef Py_ssize_t _COLUMN, _COUNT, _AT, _SIZE, _IS_FLOAT, _FIRST_FIELD, _STATE_AT, _STATE_SIZE, _TOPIC, _RECORD_AT
cdef Py_ssize_t _FIRST_RECORD, _GROUPS, _FLOAT32_BYTES

@cython.final
cdef class UlogRecords:
    cdef readonly UlogQuantities quantities
    cdef readonly unsigned char[:, ::1] rows, state
    cdef readonly unsigned char[::1] is_logged
    cdef readonly long[:, ::1] fields, topics, records, steps
    cdef unsigned char[::1] _raw
    cdef float[::1] _float32
    cdef double[::1] _float64
    @cython.locals(i=Py_ssize_t, record=Py_ssize_t)
    cpdef void write(self, Py_ssize_t step, double now, double time_us) except *
    @cython.locals(source=Py_ssize_t, field=Py_ssize_t, k=Py_ssize_t, column=Py_ssize_t, size=Py_ssize_t, to=Py_ssize_t, is_float=bint)
    cdef void _write_record(self, Py_ssize_t i, Py_ssize_t topic, Py_ssize_t at) except *
    @cython.locals(k=Py_ssize_t)
    cdef void _store_float(self, Py_ssize_t i, Py_ssize_t at, double value, Py_ssize_t size) except *
    @cython.locals(k=Py_ssize_t, whole=long)
    cdef void _store_integer(self, Py_ssize_t i, Py_ssize_t at, double value, Py_ssize_t size) except *
