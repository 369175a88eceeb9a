# C types of free_flight.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels cimport limits

cdef double _G, _MOST_SPEED, _MOST_TURN, _SMALL_RATE, _SERIES, _HALF_ROOT

@cython.final
cdef class FreeFlight:
    cdef readonly double step_s
    cdef readonly unsigned char[::1] free
    cdef readonly double[::1] mass, height
    cdef readonly double[:, ::1] inertia, place_w, quat, speed_w, rate_w, wind_n, force_b, torque_b
    cdef readonly double[:, ::1] p_n, v_n, q_nb, omega_b, air_b, accel_b, mean_accel_b
    cdef readonly double[:, :, ::1] r_nb
    cdef double[:, :, ::1] _r_wf
    cpdef void average(self, Py_ssize_t steps) except *
    @cython.locals(sign=double)
    cpdef void publish(self, Py_ssize_t i) except *
    cdef int _accelerate(self, Py_ssize_t i) except -1
    cdef int _add(self, Py_ssize_t i, double[:, ::1] velocity, (double, double, double) accel) except -1
    @cython.locals(size=double, scale=double)
    cdef int _move(self, Py_ssize_t i) except -1
    cdef int _set_air(self, Py_ssize_t i) except -1
    cdef int _set_matrix(self, Py_ssize_t i) except -1

cdef (double, double, double, double, double, double, double, double, double) matrix_of(double[:, :, ::1] matrices, Py_ssize_t i)
cdef (double, double, double) rotated((double, double, double, double, double, double, double, double, double) r, (double, double, double) v) noexcept
cdef (double, double, double) rotated_back((double, double, double, double, double, double, double, double, double) r, (double, double, double) v) noexcept
cdef (double, double, double) cross((double, double, double) a, (double, double, double) b) noexcept
cdef double sine_share(double rate, double h)
