# C types of sensor_readings.py: they make the compiled classes fast and change no result.
cimport cython

@cython.final
cdef class TrueMotion:
    cdef readonly double[:, :] accel_b, omega_b, p_n
    cdef readonly double[:, :, :] r_nb
    cpdef void add_inertial(self, double[:, :] noise) except *
    cpdef void add_field(self, double[:, :] noise, double north, double east, double down) except *
    cpdef void add_altitude(self, double[:, :] noise, double origin_m) except *

@cython.final
cdef class ReadingLimits:
    cdef readonly double[:, :] most
    cpdef void limit(self, double[:, :] readings, Py_ssize_t width) except *
