# C types of motor_outputs.py: they make the compiled class fast and change no result.
cimport cython

from arena.kernels.cascade cimport CascadeLaw
from arena.kernels.control_allocation cimport ControlAllocation
from arena.kernels.position_control cimport PositionLaw
from arena.kernels.strapdown cimport Strapdown

@cython.final
cdef class MotorOutputs:
    cdef readonly Strapdown state
    cdef readonly Py_ssize_t rotors
    cdef readonly CascadeLaw cascade
    cdef readonly ControlAllocation allocation
    cdef readonly double[::1] up_from, thrust
    cdef readonly double[:, ::1] idle, motors
    @cython.locals(cascade=CascadeLaw, allocation=ControlAllocation, up=bint)
    cpdef void step(self, double now, bint with_position) except *
    @cython.locals(state=Strapdown, cascade=CascadeLaw)
    cpdef void read_estimates(self, bint with_position) except *
    @cython.locals(state=Strapdown, position=PositionLaw)
    cdef int _read_position(self, Py_ssize_t i) except -1
