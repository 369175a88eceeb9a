# C types of estimate_validity.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels cimport limits
from arena.kernels.strapdown cimport Strapdown
from arena.kernels.vision_fusion cimport VisionFusion

cdef long _USE_YAW
cdef double _ATTITUDE, _HORIZONTAL, _VERTICAL, _GLOBAL

@cython.locals(found=double)
cdef double status_flags(bint attitude, bint horizontal, bint vertical, bint has_origin)

@cython.final
cdef class EstimateValidity:
    cdef readonly Strapdown state
    cdef readonly VisionFusion vision
    cdef readonly double[:, :, ::1] cov
    cdef readonly double[::1] limits, timeout_s, aligned_at, last_baro, tilt
    cdef readonly double settle_s
    cdef readonly unsigned char[::1] xy, z, yaw, rejected
    @cython.locals(state=Strapdown, vision=VisionFusion, timeout=double, aligned=bint, height=double, unused=bint)
    cpdef void update(self, double now) except *
    cdef bint _has_converged(self, Py_ssize_t i, double now) except -1
