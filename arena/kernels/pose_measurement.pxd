# C types of pose_measurement.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels cimport rotations

cdef double _H
cdef Py_ssize_t _ATTITUDE

@cython.final
cdef class PoseMeasurement:
    cdef readonly list numbers
    cdef readonly long[::1] rows
    cdef readonly double[:, :, ::1] noise
    cdef readonly double sigma_m, sigma_rad
    cdef readonly Py_ssize_t per_vehicle
    cdef readonly double[:, ::1] offset_n, rotation
    @cython.locals(found=list, sigma=double, at=Py_ssize_t, q=Py_ssize_t, north=double, east=double, down=double, i=Py_ssize_t, x=double, y=double, z=double, w=double)
    cpdef list measure(self, double[::1] states, Py_ssize_t frame)
    @cython.locals(sigma=double, a=double, b=double, c=double, d=double)
    cdef (double, double, double, double) _quat_xyzw_wf(self, Py_ssize_t i, (double, double, double, double) q_nb, Py_ssize_t frame)
