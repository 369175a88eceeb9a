# C types of held_telemetry.py: they make the compiled classes fast and change no result.
cimport cython

cdef double _MAX_HELD_S

@cython.final
cdef class ProgramPlace:
    cdef readonly long socket
    cdef readonly object address
    cdef readonly str program
    cdef bytearray held

@cython.final
cdef class HeldTelemetry:
    cdef object _asleep
    cdef readonly object send
    cdef Py_ssize_t _max_bytes
    cdef dict _places, _of_program
    cdef list _waiting
    cdef double _since
    cpdef ProgramPlace place(self, long socket, object to)
    @cython.locals(held=bytearray, size=Py_ssize_t)
    cpdef bint hold(self, ProgramPlace place, object data, double now, bint join) except -1
    @cython.locals(place=ProgramPlace)
    cpdef void before_wake(self, str program) except *
    cpdef void step(self, double now) except *
    cpdef void close(self) except *
    @cython.locals(held=bytearray)
    cdef void _flush(self, ProgramPlace place) except *
