# C types of stream_schedule.py: they make the compiled class fast and change no result.
cimport cython

cdef double _NEVER, _CATCH_UP_S, _ROUNDING_S, _JOIN_S

@cython.final
cdef class StreamSchedule:
    cdef readonly long[::1] ids
    cdef readonly double[:, ::1] interval_s, due_s
    cdef readonly long[:, ::1] order
    cdef readonly double[::1] next_s
    @cython.locals(place=Py_ssize_t)
    cpdef void set_interval(self, Py_ssize_t link, Py_ssize_t column, double interval_s, double first_s) except *
    cpdef bint is_due(self, Py_ssize_t link, double now) except -1
    @cython.locals(first=double)
    cpdef bint is_any_due(self, Py_ssize_t begin, Py_ssize_t end, double now) except -1
    cpdef bint is_stream_due(self, Py_ssize_t link, Py_ssize_t column, double now) except -1
    @cython.locals(column=Py_ssize_t)
    cpdef Py_ssize_t due_column(self, Py_ssize_t link, Py_ssize_t place, double now) except -2
    @cython.locals(column=Py_ssize_t, again=double)
    cpdef Py_ssize_t take_next(self, Py_ssize_t link, double now) except -2
    @cython.locals(due=list, column=Py_ssize_t)
    cpdef list take_due(self, Py_ssize_t link, double now)
    @cython.locals(order="long[:, ::1]", column=Py_ssize_t)
    cdef int _set_due(self, Py_ssize_t link, Py_ssize_t place, double due_s) except -1
    @cython.locals(other_s=double)
    cdef bint _is_after(self, Py_ssize_t link, Py_ssize_t other, double due_s, Py_ssize_t column) except -1
    @cython.locals(due_s="double[:, ::1]", order="long[:, ::1]", fastest=Py_ssize_t, column=Py_ssize_t, place=Py_ssize_t, latest_s=double)
    cdef double _next_datagram_s(self, Py_ssize_t link) except? -1
