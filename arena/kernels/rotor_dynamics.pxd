# C types of rotor_dynamics.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels cimport limits

cdef double MIN_THRUST_SHARE

@cython.final
cdef class RotorDynamics:
    cdef readonly Py_ssize_t rotors, cells, ground_cells
    cdef readonly double[:, ::1] motors, spin, spin_up, air_b, thrust_table, speed_table, ground_table
    cdef readonly double[:, ::1] drag, body_drag, force, torque
    cdef readonly double[::1] height, supply, rise, fall, ground_scale, ground_reach, speed_loss, per_weight
    cdef readonly double[:, :, ::1] wrench
    @cython.locals(share=double, tx=double, ty=double, tz=double, fz=double, gained=double, speed=double)
    cdef (double, double, double, double, double, double) _wrench_of(self, Py_ssize_t i, double ax, double ay, double az, double height)
    cdef double _ground_share(self, Py_ssize_t i, double height) except? -1.0
    @cython.locals(cell=Py_ssize_t, low=double)
    cdef double _at(self, double[:, ::1] table, Py_ssize_t i, double place, Py_ssize_t cells) except? -1.0
