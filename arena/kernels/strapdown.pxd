# C types of strapdown.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels cimport limits, rotations

cdef double _G

@cython.final
cdef class Strapdown:
    cdef readonly double dt, mean_share
    cdef readonly Py_ssize_t steps
    cdef readonly unsigned char[::1] aligned
    cdef readonly double[::1] bias_limit, past_p
    cdef readonly double[:, ::1] sensed_accel_b, sensed_gyro_b, p_n, v_n, a_n, q_nb, omega_b, force_b
    cdef readonly double[:, ::1] gyro_bias, accel_bias, accel_mean
    cdef readonly double[:, :, ::1] r_nb, ring_p, ring_q
    cdef int _turn(self, Py_ssize_t i) except -1
    cdef double _mean_rate(self, Py_ssize_t i, Py_ssize_t axis) except? -1.0
    cdef (double, double, double) _force_n(self, Py_ssize_t i)
    cdef int _set_attitude(self, Py_ssize_t i, (double, double, double, double) q) except -1
    cdef int _move(self, Py_ssize_t i) except -1
    @cython.locals(periods=double, part=double, whole=Py_ssize_t, size=Py_ssize_t, newer=Py_ssize_t, older=Py_ssize_t)
    cdef (double, double, double, double) find_past(self, Py_ssize_t i, double age_s)
    @cython.locals(size=Py_ssize_t, age=Py_ssize_t, at=Py_ssize_t)
    cpdef void correct(self, Py_ssize_t i, double[::1] error, Py_ssize_t past_states) except *
