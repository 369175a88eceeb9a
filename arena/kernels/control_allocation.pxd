# C types of control_allocation.py: they make the compiled class fast and change no result.
cimport cython
from arena.kernels cimport limits

cdef double YAW_MARGIN

@cython.final
cdef class ControlAllocation:
    cdef readonly double[:, :, ::1] weights
    cdef readonly unsigned char[:, ::1] present
    cdef readonly double[:, ::1] torque, motors, saturated
    cdef readonly double[::1] thrust
    cdef double[::1] _tilt, _yaw
    cdef int _allocate(self, Py_ssize_t i) except -1
    cdef double _add_yaw(self, Py_ssize_t i) except? -1.0
    cdef int _limit(self, Py_ssize_t i) except -1
