# C types of standstill.py: they make the compiled class fast and change no result.
cimport cython

from arena.kernels.free_flight cimport FreeFlight
from arena.kernels.rotor_dynamics cimport RotorDynamics

cdef double _SLOW_M_S, _SLOW_RAD_S, _STOPPED, _STILL_S

@cython.final
cdef class Standstill:
    cdef readonly RotorDynamics rotors
    cdef readonly FreeFlight bodies
    cdef readonly Py_ssize_t still_periods
    cdef Py_ssize_t _needed_periods
    cdef double[:, ::1] _wind_n
    cpdef void end(self)
    @cython.locals(still=bint)
    cpdef bint check(self) except? True
    @cython.locals(bodies=FreeFlight, rotors=RotorDynamics, still=bint)
    cdef bint _is_still(self, Py_ssize_t i) except? True
