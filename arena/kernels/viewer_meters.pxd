# C types of viewer_meters.py: they make the compiled classes fast and change no result.
cimport cython
from libc cimport math

from arena.kernels.mavlink_framing cimport may_contain

cdef double _NAN, _INFINITY, _EARLY_S, _PATH_PERIOD_S, _MIN_STEP_M, _LONGEST_NS
cdef long _SEQUENCES, _MAX_JUMP

@cython.locals(exact=double, whole=double, rest=double, found=long)
cpdef long nanoseconds(double time_s) except? -1

cdef class Throttle:
    cdef double _period_s, _next_s
    @cython.locals(began_again=bint)
    cpdef bint due(self, double time_s) except -1
    cpdef bint is_due(self, double time_s) except -1

cdef class Period:
    cdef double _period_s, _began_s
    cdef readonly double elapsed_s
    @cython.locals(elapsed_s=double, first=bint)
    cpdef bint ended(self, double time_s) except -1

cdef class TrafficMeter:
    cdef long _down, _up, _down_bytes, _up_bytes, _lost, _sequence
    cpdef void count(self, bint up, Py_ssize_t size) except *
    @cython.locals(missing=long)
    cpdef void sequence(self, long first, long last) except *
    cpdef list take(self, double period_s)

cdef class DatagramCounter:
    cdef (long, long) _messages
    cdef readonly long down, up
    cdef readonly double first_s
    cpdef bint count(self, bint up, bytes data, double time_s) except -1

@cython.locals(counter=DatagramCounter, vehicle=str, up=bint, data=bytes, time_s=double, found=list)
cpdef list count_datagrams(list datagrams, dict counters)

cdef class GapMeter:
    cdef readonly double newest_s
    cdef readonly long count
    cdef double _gap_s
    cpdef void add(self, double time_s) except *
    cpdef tuple take(self, double period_s)

@cython.locals(meter=GapMeter)
cpdef void count_poses(object poses, dict meters, double time_s) except *

cdef class PathPieces:
    cdef readonly long pieces
    cdef list _points
    cdef double _newest_s
    @cython.locals(p_n=tuple)
    cpdef void add(self, double north, double east, double down, double time_s) except *
    cpdef list take(self)
