# C types of attitude_control.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels cimport limits, rotations

@cython.final
cdef class AttitudeLaw:
    cdef readonly double[:, ::1] gain, rate_limit, q_nb, q_sp, rates
    cdef readonly double[:, :, ::1] r_nb
    cdef readonly double[::1] yaw_weight, yaw_rate
    cdef int _update(self, Py_ssize_t i) except -1
    cdef int _set_rate(self, Py_ssize_t i, Py_ssize_t axis, double error, double feed) except -1
