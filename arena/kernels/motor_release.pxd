# C types of motor_release.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels.cascade cimport CascadeLaw
from arena.kernels.land_detection cimport RampLaw
from arena.kernels.motor_outputs cimport MotorOutputs
from arena.kernels.position_control cimport PositionLaw
from arena.kernels.rate_control cimport RateLaw

cdef Py_ssize_t _NONE
cdef double _IDLE

@cython.final
cdef class MotorRelease:
    cdef readonly MotorOutputs outputs
    cdef readonly RampLaw ramp
    cdef readonly unsigned char[::1] armed, still, at_rest
    cdef readonly long[::1] level
    cdef readonly double[::1] armed_since, spoolup_s, tilt_landed
    @cython.locals(outputs=MotorOutputs, ramp=RampLaw, cascade=CascadeLaw, started=bint, on=bint)
    cpdef void update(self) except *
    @cython.locals(position=PositionLaw, rate=RateLaw)
    cdef int _clear(self, Py_ssize_t i) except -1
