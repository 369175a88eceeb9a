# C types of steady_flight.py: they make the compiled class fast and change no result.
cimport cython

from arena.kernels.estimate_validity cimport EstimateValidity
from arena.kernels.offboard_setpoints cimport OffboardSetpoints

@cython.final
cdef class SteadyFlight:
    cdef readonly OffboardSetpoints offboard
    cdef readonly EstimateValidity validity
    cdef readonly unsigned char[::1] landed, flying, steady
    cdef readonly double[::1] decide_at, max_tilt, min_battery, max_setpoint_age
    cpdef void set_steady(self, Py_ssize_t i, double now, double battery) except *
    cpdef list rows_to_decide(self, double now, double[::1] battery)
    @cython.locals(validity=EstimateValidity)
    cdef bint _holds(self, Py_ssize_t i, double now, double battery) except -1
