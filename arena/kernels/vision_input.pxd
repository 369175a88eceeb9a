# C types of vision_input.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels cimport rotations
from arena.kernels.vision_fusion cimport VisionFusion

cdef Py_ssize_t _ACCEPTED, _REFUSED, _REPEATED, _Q, _VAR_P, _VAR_YAW
cdef double _MAX_DISTANCE_M, _LEAST_NORM, _MOST_NORM, _INFINITE, _NAN

cdef class VisionInput:
    cdef readonly VisionFusion fusion
    cdef readonly unsigned char[::1] at_rest, flying, failed, waiting, ignores_variances
    cdef readonly double[:, ::1] offset_b, pose, prepared
    cdef readonly double[::1] align_after_s
    cdef readonly long[:, ::1] counts
    @cython.locals(north=double, east=double, down=double, w=double, x=double, y=double, z=double, norm=double)
    cpdef void receive(self, Py_ssize_t i, (double, double, double) p_n, (double, double, double, double) q_nb, (double, double, double) var_p, double var_yaw) except *
    cpdef void refuse(self, Py_ssize_t i) except *
    cdef bint _is_last(self, Py_ssize_t i, (double, double, double) p, (double, double, double, double) q) except -1
    cpdef list waiting_rows(self)
    @cython.locals(unaligned=list)
    cpdef list fuse(self, double now)
    @cython.locals(q=(double, double, double, double), x=double, y=double, z=double)
    cdef void _prepare(self, Py_ssize_t i) except *
    cdef bint _must_align(self, Py_ssize_t i, double now) except -1

cdef double _variance(double given) except? -1.0
