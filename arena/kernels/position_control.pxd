# C types of position_control.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels cimport limits, rotations

cdef double _NAN, _G

cpdef (double, double, double, double) attitude_from_thrust(double north, double east, double down, double yaw)

@cython.final
cdef class PositionLaw:
    cdef double dt
    cdef readonly double[:, ::1] p, vp, vi_dt, vd
    cdef readonly double[::1] hover, thr_min, thr_max, margin, xy_max, up_max, down_max, tilt_air, low_pass
    cdef readonly double[::1] speed_up, tilt_max, sp_yaw, thrust
    cdef readonly double[:, ::1] p_n, v_n, q_nb, sp_p_n, sp_v_n, sp_a_n
    cdef readonly double[:, ::1] integral, v_last, v_dot, v_sp_n, a_sp_n, thrust_n, q_sp
    cdef double[::1] _error
    cdef int _set_velocity(self, Py_ssize_t i) except -1
    cdef double _from_position(self, Py_ssize_t i, Py_ssize_t axis) except? -1.0
    cdef double _feed_forward(self, Py_ssize_t i, Py_ssize_t axis) except? -1.0
    cdef bint _is_controlled(self, Py_ssize_t i, Py_ssize_t axis) except? -1
    cdef int _set_acceleration(self, Py_ssize_t i, Py_ssize_t axis) except -1
    cdef double _set_thrust(self, Py_ssize_t i) except? -1.0
    cdef int _integrate(self, Py_ssize_t i, double wanted_z) except -1
