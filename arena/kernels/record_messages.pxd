# C types of record_messages.py: they make the compiled classes fast and change no result.
cimport cython

cdef unsigned int _CDR_LITTLE_ENDIAN
cdef Py_ssize_t _HEAD, _DATA, _NUMBER, _SIMULATED, _EXPOSED, _SENT, _COUNT, _BODIES, _POSE_BYTES
cdef double _NAN

cdef class FrameMessages:
    cdef object _message
    cdef Py_ssize_t _count
    cdef unsigned char[::1] _u8
    cdef unsigned int[::1] _u32
    cdef double[::1] _f64
    cdef long[::1] _places
    @cython.locals(k=Py_ssize_t)
    cpdef bytes pack(self, long number, double exposed_s, double sent_s, bint simulated, object poses)
    @cython.locals(f64=double[::1])
    cdef void _put(self, Py_ssize_t at, (double, double, double) p_n, (double, double, double, double) q_nb) except *

cdef class StateMessages:
    cdef object _message
    cdef double[::1] _f64
    @cython.locals(f64=double[::1])
    cpdef bytes pack(self, (double, double, double) p_n, (double, double, double) v_n, (double, double, double, double) q_nb, (double, double, double) omega_b)
