# C types of downwash_wind.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

cdef double _SPEED, _SPREAD, _ORIGIN, _SHAPE, _END, _TAIL

@cython.final
cdef class DownwashWind:
    cdef readonly double[::1] factor, length, radius, rotors_out2
    cdef readonly double[:, ::1] wind_n
    cdef double _n, _e, _d, _axis_n, _axis_e, _axis_d, _above, _along
    @cython.locals(upper=Py_ssize_t, lower=Py_ssize_t)
    cpdef bint reaches(self, double[:, ::1] p_n, double[:, :, ::1] r_nb) except -1
    @cython.locals(upper=Py_ssize_t, lower=Py_ssize_t, root=double, shape=double, s=double, speed=double)
    cpdef void compute(self, double[:, ::1] p_n, double[:, :, ::1] r_nb, double[::1] thrust) except *
    cdef bint _set_jet(self, double[:, ::1] p_n, double[:, :, ::1] r_nb, Py_ssize_t upper) except -1
    @cython.locals(north=double, east=double, down=double, along=double, aside2=double, half=double, bell=double)
    cdef double _shape(self, double[:, ::1] p_n, Py_ssize_t lower) except? -1.0
