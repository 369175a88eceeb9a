# C types of cascade.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels.attitude_control cimport AttitudeLaw
from arena.kernels.position_control cimport PositionLaw
from arena.kernels.rate_control cimport RateLaw

cdef Py_ssize_t ATTITUDE, POSITION

@cython.final
cdef class CascadeLaw:
    cdef readonly PositionLaw position
    cdef readonly AttitudeLaw attitude
    cdef readonly RateLaw rate
    cdef readonly long[::1] level
    cdef readonly double[:, ::1] q_nb, omega_b
    cdef readonly double[::1] thrust, yaw_rate, yaw_rate_ff, selected_thrust
    cdef int _select_attitude(self, Py_ssize_t i) except -1
