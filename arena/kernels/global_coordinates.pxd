# C types of global_coordinates.py: they make the compiled functions fast and change no result.
from libc cimport math

from arena.kernels cimport limits

cdef double _DEG, _RAD

cpdef (double, double) latitude_longitude(double north, double east, double heading, double lat0, double lon0, double earth_m)
cpdef (double, double) global_position(double north, double east, double heading, double lat0, double lon0, double earth_m)
cpdef double rounded(double x) except? -1.0
