# C types of lateness.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

cdef double _INF, _PROVEN_S, _SETTLED_S, _DRIFT, _MAX_PROCESSING_S, _ECHO_ERROR_S, _MAX_ROUND_TRIP_S
cdef long _SHIFT_COUNT, _PROOF_COUNT

cdef class Lateness:
    cdef double _stale_s, _low, _high, _now, _prompt_s, _processing_s, _late_since
    cdef long _early, _contradictions
    cdef object _echo
    cdef readonly long shifts
    cdef readonly double latency_s
    cpdef void reset(self) except *
    cpdef double measure_frame(self, object frame, double now, bint flying) except? -1.0
    @cython.locals(sent=double, elapsed_s=double, offset=double, processing_s=double, transit_s=double, late=double)
    cpdef double measure(self, double stamp_s, double now, bint flying, object sent_s=*) except? -1.0
    cdef double _offset(self) except? -1.0
    @cython.locals(elapsed_s=double)
    cdef double _drift(self, double now) except? -1.0
    cdef double _on_late_frame(self, double offset, double late, double now, bint flying) except? -1.0
    cdef double _shift(self, double offset) except? -1.0
    @cython.locals(sent=double, received=double, answered_s=double, low=double, high=double)
    cdef void _on_echo(self, object echo, double now) except *
