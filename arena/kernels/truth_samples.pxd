# C types of truth_samples.py: they make the compiled class fast and change no result.
cimport cython

@cython.final
cdef class TruthSamples:
    cdef readonly double[::1] page
    cdef readonly Py_ssize_t per_vehicle, rotors
    cdef readonly double[:, :] p_n, q_nb, v_n, omega_b, accel_b, motors
    @cython.locals(page="double[::1]", at=Py_ssize_t, i=Py_ssize_t, k=Py_ssize_t)
    cpdef void write(self, Py_ssize_t begin, double time_s) except *
