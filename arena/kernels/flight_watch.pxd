# C types of flight_watch.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

@cython.final
cdef class FlightWatch:
    cdef readonly double step_s
    cdef readonly double[:, ::1] p_n, v_n, recent
    cdef readonly double[:, :, ::1] r_nb
    cdef readonly unsigned char[::1] floor, was_on_floor
    cdef readonly double[::1] min_cos_tilt, least_cos_tilt, least_down, airborne_s, speed
    @cython.locals(cos_tilt=double)
    cpdef bint step(self) except -1
    cpdef double speed_before(self, Py_ssize_t i) except -1
    cpdef void finish(self) except *
