# C types of truth_interpolation.py: they make the compiled function fast and change no result.
cimport cython

from arena.kernels cimport rotations

cdef double _NEARLY_ONE
cdef Py_ssize_t _ATTITUDE

@cython.locals(low=Py_ssize_t, high=Py_ssize_t, middle=Py_ssize_t)
cpdef Py_ssize_t sample_before(const double[::1] page, Py_ssize_t begin, Py_ssize_t width, Py_ssize_t ring, Py_ssize_t oldest, Py_ssize_t newest, double time_s) except? -1

@cython.locals(fraction=double, at=Py_ssize_t, i=Py_ssize_t, k=Py_ssize_t)
cpdef void interpolate(double[::1] before, double[::1] after, double time_s, Py_ssize_t width, double[::1] out) except *
