# C types of viewer_messages.py: they make the compiled classes fast and change no result.
cimport cython

cdef unsigned int _CDR_LITTLE_ENDIAN
cdef long _NS_PER_S
cdef double _H
cdef unsigned char _TIME, _POSE, _TRANSLATION, _ROTATION, _POSITION, _ORIENTATION, _SECONDS, _NANOSECONDS, _FIRST_NUMBER

cpdef (double, double, double) arena_position((double, double, double) p_n)
cpdef (double, double, double, double) arena_attitude((double, double, double, double) q_nb)

cdef class NumberMessages:
    cdef readonly Py_ssize_t count
    cdef object _payload
    cdef float[::1] _f32
    cpdef bytes pack(self, object values)
    cdef void set(self, Py_ssize_t k, double value) except *
    cdef bytes message(self)

cdef class PoseMessages:
    cdef bytes _root, _child
    cdef object _raw
    cdef dict _begins
    cdef unsigned char[::1] _u8
    cdef double[::1] _number
    cdef unsigned long long[::1] _bits
    cdef double _x, _y, _z, _qw, _qx, _qy, _qz
    cdef long _log_time
    cpdef void set(self, (double, double, double) p_n, (double, double, double, double) q_nb, long log_time) except *
    @cython.locals(u8=cython.uchar[::1], begin=Py_ssize_t, at=Py_ssize_t)
    cpdef bytes pose(self)
    @cython.locals(u8=cython.uchar[::1], at=Py_ssize_t)
    cpdef bytes transform(self)
    cdef bytes _first_bytes(self, Py_ssize_t size)
    @cython.locals(at=Py_ssize_t)
    cdef Py_ssize_t _put_head(self, unsigned char[::1] u8) except -1
    @cython.locals(end=Py_ssize_t)
    cdef Py_ssize_t _put_position(self, unsigned char[::1] u8, Py_ssize_t at, unsigned char field) except -1
    @cython.locals(end=Py_ssize_t)
    cdef Py_ssize_t _put_attitude(self, unsigned char[::1] u8, Py_ssize_t at, unsigned char field) except -1
    @cython.locals(bits=cython.ulonglong, k=Py_ssize_t)
    cdef Py_ssize_t _put_number(self, unsigned char[::1] u8, Py_ssize_t at, unsigned char field, double value) except -1

cdef Py_ssize_t _put_integer(unsigned char[::1] u8, Py_ssize_t at, unsigned char field, long value) except -1
@cython.locals(size=Py_ssize_t, k=Py_ssize_t)
cdef Py_ssize_t _put(unsigned char[::1] u8, Py_ssize_t at, bytes data) except -1
