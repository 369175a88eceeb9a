# C types of battery_discharge.py: they make the compiled class fast and change no result.
cimport cython

@cython.final
cdef class BatteryDischarge:
    cdef readonly Py_ssize_t rotors
    cdef readonly double[:, ::1] spin
    cdef readonly double[::1] idle, per_square, used_per_a, override, empty, span, resistance, supply_per_volt
    cdef readonly double[::1] remaining, current, voltage, supply
    @cython.locals(least=double, squares=double, remaining=double, used=double)
    cpdef double step(self) except? -1.0
