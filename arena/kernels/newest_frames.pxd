# C types of newest_frames.py: they make the compiled class fast and change no result.
cimport cython

from arena.kernels.mavlink_framing cimport FrameParser, checksum

cdef long _V2, _HEAD, _CRC, _SIGNATURE, _SIGNED, _KEYS

@cython.final
cdef class NewestFrames:
    cdef FrameParser _parser
    cdef frozenset _wanted
    cdef dict _slots
    cdef long _system, _component, _keyed, _offset, _mask
    cdef readonly dict waiting
    @cython.locals(newest=dict, rare=list, at=Py_ssize_t, size=Py_ssize_t, end=Py_ssize_t, found=bint, msgid=long, code=long)
    cpdef object receive(self, bytes data, double now)
    @cython.locals(crc_at=Py_ssize_t, end=Py_ssize_t, seed=bytes)
    cdef Py_ssize_t _end(self, bytes data, Py_ssize_t at, Py_ssize_t size) except? -2
    @cython.locals(rare=list)
    cdef object _search(self, bytes data, double now)
    @cython.locals(low=long, high=long)
    cdef long _key(self, long slot, bytes data, Py_ssize_t payload, Py_ssize_t length) except -1
    cdef object _frame(self, bytes data, Py_ssize_t at, Py_ssize_t size)
    @cython.locals(waiting=dict)
    cdef void _store(self, long slot, long key, bytes data, object frame, double now) except *
