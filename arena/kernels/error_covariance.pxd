# C types of error_covariance.py: they make the compiled class fast and change no result.
cimport cython

from arena.kernels cimport limits

cdef double _SMALL_VARIANCE, _MOST_VARIANCE

@cython.final
cdef class ErrorCovariance:
    cdef readonly double dt
    cdef readonly Py_ssize_t samples, summed
    cdef readonly double[:, :, ::1] r_nb, cov
    cdef readonly double[:, ::1] force_b, omega_b, growth, force_sum, omega_sum
    cdef readonly double[::1] error
    cdef double[::1] _column
    cdef void _predict(self, Py_ssize_t i) except *
    cdef void _advance_error(self, Py_ssize_t i) except *
    @cython.locals(total=double)
    cdef double variance(self, Py_ssize_t i, double[:, ::1] jacobian, Py_ssize_t row) except? -1.0
    cpdef void begin(self) except *
    @cython.locals(variance=double, left=double, gain=double)
    cpdef void correct(self, Py_ssize_t i, double[:, ::1] jacobian, Py_ssize_t row, double innovation, double noise) except *
    cpdef void repair(self, Py_ssize_t i) except *
