# C types of odometry_frames.py: they make the compiled class fast and change no result.
cimport cython

cdef long _V2
cdef Py_ssize_t _START, _SEQUENCE, _PAYLOAD, _POSE, _RESETS

cdef class OdometryFrames:
    cdef object _frame, _checked
    cdef unsigned char[::1] _u8
    cdef unsigned long long[::1] _u64
    cdef float[::1] _f32
    cdef bytes _seed
    cdef Py_ssize_t _end
    @cython.locals(u8=cython.uchar[::1], f32=float[::1], at=Py_ssize_t, crc=long)
    cpdef bytes frame(self, long sequence, long time_us, (double, double, double) p_n, (double, double, double, double) q_nb, long resets)
