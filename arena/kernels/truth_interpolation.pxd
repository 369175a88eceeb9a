# C types of truth_interpolation.py: they make the compiled class and functions fast and change no result.
cimport cython

from arena.kernels cimport rotations

cdef double _NEARLY_ONE
cdef Py_ssize_t _ATTITUDE, _DOUBLE_BYTES

cpdef object new_row(Py_ssize_t width)

cdef class TruthRing:
    cdef const double[::1] _page
    cdef double[::1] _before, _after
    cdef Py_ssize_t _begin, _width, _ring, _per_vehicle
    @cython.locals(held=Py_ssize_t, oldest=Py_ssize_t, i=Py_ssize_t, before=Py_ssize_t, after=Py_ssize_t)
    cpdef bint find(self, double time_s, Py_ssize_t count) except -1
    cpdef object interpolated(self, double time_s)
    cdef Py_ssize_t _row(self, Py_ssize_t number) except -1

@cython.locals(low=Py_ssize_t, high=Py_ssize_t, middle=Py_ssize_t)
cpdef Py_ssize_t sample_before(const double[::1] page, Py_ssize_t begin, Py_ssize_t width, Py_ssize_t ring, Py_ssize_t oldest, Py_ssize_t newest, double time_s) except? -1

@cython.locals(fraction=double, at=Py_ssize_t, i=Py_ssize_t, k=Py_ssize_t)
cpdef void interpolate(double[::1] before, double[::1] after, double time_s, Py_ssize_t width, double[::1] out) except *
