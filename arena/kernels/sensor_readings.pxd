# C types of sensor_readings.py: they make the compiled functions fast and change no result.
cimport cython

cpdef void add_inertial(double[:, :] noise, double[:, :] accel_b, double[:, :] omega_b) except *
cpdef void add_field(double[:, :] noise, double[::1] field_n, double[:, :, ::1] r_nb) except *
cpdef void add_altitude(double[:, :] noise, double origin_m, double[:, :] p_n) except *
cpdef void limit(double[:, :] readings, double[:, ::1] most, Py_ssize_t width) except *
