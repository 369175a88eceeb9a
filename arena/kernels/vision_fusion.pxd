# C types of vision_fusion.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels cimport rotations
from arena.kernels.error_covariance cimport ErrorCovariance
from arena.kernels.strapdown cimport Strapdown

cdef double _INFINITE
cdef Py_ssize_t _USE_XY, _USE_Z, _USE_YAW, _YAW

@cython.final
cdef class VisionFusion:
    cdef readonly Strapdown state
    cdef readonly ErrorCovariance covariance
    cdef readonly long[::1] control, rejected
    cdef readonly double[::1] delay_s, rejected_since, last_xy, last_z, last_yaw
    cdef readonly double[:, ::1] least_variance, gate_squared, gate_var, test_ratio, innovation, innovation_var
    cdef double[:, ::1] _jacobian
    cdef double[::1] _noise
    @cython.locals(has_yaw=bint)
    cpdef void fuse(self, Py_ssize_t i, double[:, ::1] pose, Py_ssize_t row, double now) except *
    cdef int _set_measurement(self, Py_ssize_t i, double[:, ::1] pose, Py_ssize_t row, double age_s) except -1
    @cython.locals(consistent=bint, use_yaw=bint, use_xy=bint, use_z=bint, use=bint, past_states=Py_ssize_t)
    cdef int _gate(self, Py_ssize_t i, bint has_yaw, double now) except -1
    cdef double _ratio(self, Py_ssize_t i, Py_ssize_t k) except? -1.0
    cdef int _move_gate(self, Py_ssize_t i, Py_ssize_t k, bint passed) except -1
