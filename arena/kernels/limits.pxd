# C types of limits.py: they make the compiled functions fast and change no result.
from libc cimport math

cdef double within(double x, double low, double high) noexcept
cdef double length(double x, double y) noexcept
cdef (double, double) shortened(double x, double y, double most)
cdef (double, double) sum_within(double x, double y, double dx, double dy, double most)
