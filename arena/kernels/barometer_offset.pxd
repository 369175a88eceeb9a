# C types of barometer_offset.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels.strapdown cimport Strapdown
from arena.kernels.vision_fusion cimport VisionFusion

cdef double _FRESH_S, _OFFSET_S

@cython.final
cdef class BarometerOffset:
    cdef readonly Strapdown state
    cdef readonly VisionFusion vision
    cdef readonly unsigned char[::1] seen, lost
    cdef readonly double[::1] altitude, after_s, offset
    cdef readonly double updated_at
    @cython.locals(state=Strapdown, vision=VisionFusion, share=double, any_lost=bint, age=double, offset=double)
    cpdef bint update(self, double now) except -1
