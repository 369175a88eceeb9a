# C types of rotations.py: they make the compiled functions fast and change no result.
from libc cimport math

cpdef (double, double, double, double) product((double, double, double, double) a, (double, double, double, double) b)
cdef (double, double, double, double) between((double, double, double, double) a, (double, double, double, double) b)
cpdef (double, double, double, double) from_euler(double roll, double pitch, double yaw)
cdef double yaw((double, double, double, double) q)
cdef (double, double, double, double) conjugate((double, double, double, double) q)
cdef (double, double, double, double) normalized((double, double, double, double) q)
cdef (double, double, double, double) from_rotation_vector(double x, double y, double z)
cdef double angle_about_z((double, double, double, double) q)
cdef int store_matrix(double[:, :, ::1] matrices, Py_ssize_t i, (double, double, double, double) q) except -1
cpdef (double, double, double) euler((double, double, double, double) q)
cpdef (double, double, double) rotated((double, double, double, double) q, (double, double, double) v)
cpdef (double, double, double) rotated_back((double, double, double, double) q, (double, double, double) v)
cpdef (double, double, double) rotation_vector((double, double, double, double) a, (double, double, double, double) b)
cpdef (double, double, double, double) slerp((double, double, double, double) a, (double, double, double, double) b, double fraction)
