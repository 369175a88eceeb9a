# C types of mavlink_framing.py: they make the compiled functions fast and change no result.
cimport cython

cdef long _V1, _V2, _V1_HEAD, _V2_HEAD, _CRC, _SIGNATURE, _SIGNED

@cython.final
cdef class FrameParser:
    cdef readonly dict seeds, targets
    cdef readonly long tries
    cpdef object parse(self, bytes data)
    @cython.locals(frames=list, frame=tuple, size=Py_ssize_t, at=Py_ssize_t, used=Py_ssize_t, bad_crc=long, unknown=long, tries=long, known=bint)
    cpdef object search(self, bytes data, object wanted, long sysid, long compid)
    @cython.locals(magic=long, length=long, flags=long, payload=Py_ssize_t, end=Py_ssize_t, sysid=long, compid=long, msgid=long, target_sys=long, target_comp=long, place=tuple, system=long, component=long)
    cpdef tuple frame_at(self, bytes data, Py_ssize_t at, Py_ssize_t size)
    @cython.locals(at=Py_ssize_t)
    cpdef bint crc_fits(self, bytes data, tuple frame) except -1

cpdef long checksum(bytes data, Py_ssize_t start, Py_ssize_t end, bytes seed) except -1

@cython.locals(end=Py_ssize_t)
cpdef bint plausible(bytes data, tuple frame, bint clean, Py_ssize_t size) except -1

@cython.locals(at=Py_ssize_t, size=Py_ssize_t)
cpdef bint may_contain(bytes data, unsigned char first, unsigned char second) except -1

@cython.locals(size=Py_ssize_t, head=bytes, body=bytes)
cpdef bytes pack(bytes payload, long msgid, bytes seed, long seq, long sysid, long compid)

cdef unsigned short[:, ::1] _crcs

@cython.locals(part=long)
cdef long _next_crc(long crc, long byte) except -1

@cython.locals(k=Py_ssize_t, first=long, second=long, crc=long)
cpdef long crc_of_buffer(unsigned char[::1] data, Py_ssize_t begin, Py_ssize_t end) except -1
