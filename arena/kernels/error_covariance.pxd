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
    cdef double _period, _fx, _fy, _fz, _wx, _wy, _wz, _r00, _r01, _r02, _r10, _r11, _r12, _r20, _r21, _r22
    cdef int _predict(self, Py_ssize_t i) except -1
    cdef int _set_transition(self, Py_ssize_t i) except -1
    cdef (double, double, double, double, double, double, double, double, double) _advanced(self, (double, double, double) p, (double, double, double) v, (double, double, double) th, (double, double, double) bg, (double, double, double) ba) noexcept
    @cython.locals(total=double)
    cdef double variance(self, Py_ssize_t i, double[:, ::1] jacobian, Py_ssize_t row) except? -1.0
    cpdef void begin(self) except *
    @cython.locals(variance=double, left=double, gain=double)
    cpdef void correct(self, Py_ssize_t i, double[:, ::1] jacobian, Py_ssize_t row, double innovation, double noise) except *
    cpdef void repair(self, Py_ssize_t i) except *
