# C types of flight_period.py: they make the compiled class fast and change no result.
cimport cython

from arena.kernels.free_flight cimport FreeFlight
from arena.kernels.rotor_dynamics cimport RotorDynamics

@cython.final
cdef class FlightPeriod:
    cdef readonly RotorDynamics rotors
    cdef readonly FreeFlight bodies
    @cython.locals(to="double[:, ::1]", command=double)
    cpdef void set_motors(self, double[:, :] motors) except *
    @cython.locals(rotors=RotorDynamics, bodies=FreeFlight)
    cpdef void step(self, Py_ssize_t count) except *
