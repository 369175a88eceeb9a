# C types of socket_waits.py: they make the compiled class fast and change no result.
cimport cython
@cython.final
cdef class SocketWaits:
    cdef public const double[::1] world_s
    cdef readonly double limit_s
    cdef readonly long[::1] limited
    cdef readonly double[::1] empty_at, empty_world_s
    cdef long[::1] _reported
    cdef long _poll
    cdef double _now, _last, _world_now, _last_world
    cpdef long before_poll(self, double now) except -1
    cpdef bint may_be_old(self, Py_ssize_t i, double now) except -1
    cpdef bint is_old(self, Py_ssize_t i, double now) except -1
