# C types of land_detection.py: they make the compiled classes fast and change no result.
cimport cython
from libc cimport math

from arena.kernels cimport limits

cdef Py_ssize_t _NONE, _POSITION
cdef double _NAN, _G, _UPWARD, _LOW_THRUST, _FREEFALL_M_S2, _REST_M_S2

@cython.final
cdef class LandDetection:
    cdef readonly unsigned char[::1] landed, contact, at_rest, xy_valid, climbing
    cdef readonly double[:, ::1] v_n, omega_b
    cdef readonly double[::1] force, thrust, sink, z_vel_max, xy_vel_max, rot_max, trigger_s, thr_min, thr_hover, land_speed
    cdef readonly double[::1] since, at_rest_since
    @cython.locals(resting=bint, low=bint)
    cpdef void step(self, double now) except *
    @cython.locals(vertical=bint, slow=bint, pressed=bint)
    cdef bint _is_resting(self, Py_ssize_t i) except -1
    @cython.locals(fastest=double)
    cdef bint _is_quiet(self, Py_ssize_t i) except -1
    cdef bint _has_low_thrust(self, Py_ssize_t i) except -1

@cython.final
cdef class ClimbRequest:
    cdef readonly double[:, ::1] p_n, v_sp_n, sp_p_n, sp_v_n
    cdef readonly unsigned char[::1] armed, climbing
    cdef readonly double[::1] sink, thr_min, thr_hover, sp_thrust
    cdef readonly long[::1] level
    @cython.locals(positioned=bint)
    cpdef void update(self) except *
    cdef bint _is_upward(self, Py_ssize_t i) except -1
    cdef bint _has_thrust(self, Py_ssize_t i) except -1

@cython.final
cdef class RampLaw:
    cdef readonly unsigned char[::1] flying, landed, climbing, offboard
    cdef readonly double[::1] armed_since, full, full_offboard, spoolup_s, ramp_s, start, begun, climb_rate
    @cython.locals(spooled=bint, go=bint, done=bint)
    cpdef void update(self, double now) except *
    @cython.locals(part=double, full=double)
    cpdef void limit(self, double now) except *
