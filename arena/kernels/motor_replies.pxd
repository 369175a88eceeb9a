# C types of motor_replies.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels cimport limits
from arena.kernels.mavlink_framing cimport FrameParser

cdef long _LOCKSTEP, _ARMED
cdef Py_ssize_t _BYTES, _FIRST, _MODE

@cython.final
cdef class MotorReplies:
    cdef FrameParser _parser
    cdef long _number
    cdef readonly double[::1] motors
    cdef readonly unsigned long long time_usec
    cdef readonly bint armed, lockstep
    @cython.locals(size=Py_ssize_t, frame=tuple)
    cpdef bint read(self, bytes data) except -1
    @cython.locals(values=tuple, k=Py_ssize_t, command=double, wanted=bint)
    cpdef void read_payload(self, bytes data, Py_ssize_t at, Py_ssize_t size) except *
