# C types of natnet_bodies.py: they make the compiled class fast and change no result.
cimport cython

cdef Py_ssize_t _BODY_BYTES

cdef class BodyEncoder:
    cdef short _tracking_valid
    cdef unsigned char[::1] _bytes
    cdef int[::1] _i32
    cdef float[::1] _f32
    cdef short[::1] _i16
    @cython.locals(out=bytearray, at=Py_ssize_t, k=Py_ssize_t, body="float[::1]")
    cpdef bytes encode(self, object bodies)
