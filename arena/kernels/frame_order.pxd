# C types of frame_order.py: they make the compiled class fast and change no result.

cdef long _RESTART_COUNT

cdef class FrameOrder:
    cdef bint _begun
    cdef long long _newest, _old
    cdef long _run
    cpdef str place(self, long long number)
