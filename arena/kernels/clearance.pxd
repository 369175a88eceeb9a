# C types of clearance.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

cdef double _MARGIN_M, _RETURN_M, _SPEED_CHANGE

@cython.final
cdef class Clearance:
    cdef readonly double period_s
    cdef readonly unsigned char[::1] free
    cdef readonly double[:, ::1] place_w, speed_w, boxes
    cdef readonly double[::1] radius
    cdef double[::1] _reach, _need
    cdef double _spare
    @cython.locals(most=double, speed=double)
    cpdef bint check(self) except -1
    @cython.locals(spare=double)
    cdef int _measure(self) except -1
    cdef int _use(self, Py_ssize_t i, double spare) except -1
    cdef double _apart(self, Py_ssize_t i, Py_ssize_t j) except? -1.0
    @cython.locals(least=double, gap=double)
    cdef double _room(self, Py_ssize_t i) except? -1.0
