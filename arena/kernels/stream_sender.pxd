# C types of stream_sender.py: they make the compiled class fast and change no result.
cimport cython

from arena.kernels.payload_writer cimport PayloadWriter
from arena.kernels.stream_schedule cimport StreamSchedule
from arena.kernels.telemetry_packing cimport TelemetryPacking

@cython.final
cdef class StreamSender:
    cdef readonly StreamSchedule schedule
    cdef readonly TelemetryPacking packing
    cdef readonly list links, writers
    cdef readonly long[::1] system_ids, sequence
    cdef readonly unsigned char[::1] rare, needs_position
    cdef readonly unsigned char[:, ::1] silent
    cdef readonly double[::1] wake_s
    @cython.locals(first=double)
    cpdef bint has_output(self, double now) except -1
    @cython.locals(found=list, count=Py_ssize_t, datagram=bytes, wakes=bint)
    cpdef list step(self, double now)
    cpdef bint has_content(self, Py_ssize_t i, Py_ssize_t column) except -1
    @cython.locals(count=Py_ssize_t, schedule=StreamSchedule, row=Py_ssize_t, place=Py_ssize_t, column=Py_ssize_t)
    cdef bint _has_unpacked(self, Py_ssize_t i, double now) except -1
    @cython.locals(due=list, rare_count=Py_ssize_t, column=Py_ssize_t, needs=long, writer=PayloadWriter, packing=TelemetryPacking, seq=long)
    cdef bytes _datagram(self, Py_ssize_t i, Py_ssize_t row, double now)
