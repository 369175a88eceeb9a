# C types of setpoint_rows.py: they make the compiled class fast and change no result.
cimport cython

@cython.final
cdef class SetpointRows:
    cdef readonly long[::1] level
    cdef readonly double[:, ::1] p_n, v_n, a_n, q_nb, omega_b
    cdef readonly double[::1] yaw, yaw_rate, thrust, yaw_rate_ff
    cpdef void set_position(self, Py_ssize_t i, long level, (double, double, double) p_n, (double, double, double) v_n, (double, double, double) a_n, double yaw, double yaw_rate) except *
    cpdef void set_attitude(self, Py_ssize_t i, (double, double, double, double) q_nb, (double, double, double) omega_b, double thrust, double yaw_rate_ff) except *
