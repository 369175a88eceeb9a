# C types of truth_interpolation.py: they make the compiled function fast and change no result.
cimport cython

from arena.kernels cimport rotations

cdef double _NEARLY_ONE
cdef Py_ssize_t _ATTITUDE

@cython.locals(fraction=double, at=Py_ssize_t, i=Py_ssize_t, k=Py_ssize_t)
cpdef void interpolate(double[::1] before, double[::1] after, double time_s, Py_ssize_t width, double[::1] out) except *
