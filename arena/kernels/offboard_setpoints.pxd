# C types of offboard_setpoints.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels cimport rotations

cdef long _NONE, _RATE, _ATTITUDE, _POSITION, _HAS_VELOCITY, _HAS_ACCELERATION, _HAS_ATTITUDE, _HAS_RATES
cdef long _LOCAL_NED, _BODY_NED, _FORCE, _YAW_IGNORED, _YAW_RATE_IGNORED
cdef Py_ssize_t _V, _A, _YAW, _YAW_RATE, _VALUES
cdef double _MAX_ABS, _NEVER, _NAN

cdef class OffboardSetpoints:
    cdef readonly double[:, ::1] q_nb, p_n, v_n, a_n, attitude, omega_b
    cdef readonly double[::1] target, yaw, yaw_rate, thrust, received_at
    cdef readonly long[::1] level, contents
    cdef long[::1] _to_level
    cdef double[:, ::1] _to_p_n, _to_v_n, _to_a_n, _to_q_nb, _to_omega_b
    cdef double[::1] _to_yaw, _to_yaw_rate, _to_thrust, _to_yaw_rate_ff
    @cython.locals(q=(double, double, double, double))
    cpdef str set_local_target(self, Py_ssize_t i, long mask, long frame, double now)
    cpdef str set_global_target(self, Py_ssize_t i, long mask, double heading, double now)
    cpdef void set_attitude(self, Py_ssize_t i, (double, double, double, double) q_nb, double yaw_rate, double thrust, double now) except *
    cpdef void set_rates(self, Py_ssize_t i, (double, double, double) omega_b, double thrust, double now) except *
    cdef void _begin(self, Py_ssize_t i, long level, long contents, double now) except *
    cdef void _ignore_axes(self, long mask) except *
    cdef void _ignore(self, Py_ssize_t first, long axes) except *
    @cython.locals(x=double, y=double, c=double, s=double)
    cdef void _turn(self, Py_ssize_t first, double angle) except *
    @cython.locals(a=double, b=double, c=double, w=double, x=double, y=double, z=double, tx=double, ty=double, tz=double)
    cdef void _rotate(self, Py_ssize_t first, (double, double, double, double) q) except *
    @cython.locals(contents=long)
    cdef str _set_position(self, Py_ssize_t i, long mask, double now)
    @cython.locals(found=long, k=Py_ssize_t)
    cdef long _contents_of_target(self) except -1
    cdef str _refusal(self, long mask, long contents)
    @cython.locals(given=long, every_axis=bint, k=Py_ssize_t)
    cdef bint _is_complete(self) except -1
    @cython.locals(level=long)
    cpdef void copy(self, Py_ssize_t i) except *
