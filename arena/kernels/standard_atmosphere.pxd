# C types of standard_atmosphere.py: they make the compiled function fast and change no result.
from libc cimport math

cpdef double pressure_hpa(double height_m) except? -1.0
