# C types of payload_writer.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels cimport limits, mavlink_framing

cdef Py_ssize_t HEAD, _PAYLOAD, _UINT8, _INT8, _UINT16, _INT16, _UINT32, _INT32, _UINT64, _INT64, _FLOAT32

@cython.final
cdef class PayloadWriter:
    cdef readonly long number, needs
    cdef readonly bytes seed
    cdef readonly Py_ssize_t size, end
    cdef readonly unsigned char[::1] frame
    cdef readonly long[:, ::1] fields
    cdef readonly double[:, ::1] ranges
    cdef unsigned char[::1] u8
    cdef signed char[::1] i8
    cdef unsigned short[::1] u16
    cdef short[::1] i16
    cdef unsigned int[::1] u32
    cdef int[::1] i32
    cdef unsigned long long[::1] u64
    cdef long long[::1] i64
    cdef float[::1] f32
    @cython.locals(k=Py_ssize_t, size=Py_ssize_t, end=Py_ssize_t, crc=long, frame="unsigned char[::1]", value=double, kind=Py_ssize_t, at=Py_ssize_t)
    cpdef Py_ssize_t write(self, double[::1] values, long seq, long sysid, long compid) except -1
    @cython.locals(whole=long)
    cdef int _store_whole(self, double value, Py_ssize_t kind, Py_ssize_t at) except -1
