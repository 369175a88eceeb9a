# C types of pose_measurement.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels cimport rotations

cdef double _H

@cython.final
cdef class PoseMeasurement:
    cdef readonly long[::1] rows
    cdef readonly double[:, :, ::1] noise
    cdef readonly double sigma_m, sigma_rad
    cdef readonly double[:, ::1] offset_n, rotation, position_w, quat_xyzw_wf
    @cython.locals(row=Py_ssize_t, north=double, east=double, down=double, i=Py_ssize_t)
    cpdef void measure(self, double[:, :] p_n, double[:, :] q_nb, Py_ssize_t frame) except *
    @cython.locals(sigma=double, a=double, b=double, c=double, d=double)
    cdef void _turn(self, Py_ssize_t i, (double, double, double, double) q_nb, Py_ssize_t frame) except *
