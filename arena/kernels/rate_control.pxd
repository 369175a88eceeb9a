# C types of rate_control.py: they make the compiled class fast and change no result.
cimport cython
from arena.kernels cimport limits

cdef double _INTEGRAL_CUTOFF

@cython.final
cdef class RateLaw:
    cdef double dt
    cdef readonly double[:, ::1] p, i_dt, d, integral_limit, low_pass
    cdef readonly double[:, ::1] omega_b, omega_sp, saturated, rate, accel, integral, torque
    cdef readonly double[::1] yaw_torque
    cdef double _torque(self, Py_ssize_t i, Py_ssize_t axis) except? -1.0
