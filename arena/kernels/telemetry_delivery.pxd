# C types of telemetry_delivery.py: they make the compiled classes fast and change no result.
cimport cython

from arena.kernels.held_telemetry cimport HeldTelemetry, ProgramPlace
from arena.kernels.ordinary_datagrams cimport OrdinaryDatagrams

@cython.final
cdef class TelemetryPath:
    cdef readonly tuple receivers
    cdef readonly object closed
    cdef readonly str vehicle
    cdef readonly list places

@cython.final
cdef class TelemetryDelivery:
    cdef OrdinaryDatagrams _ordinary
    cdef HeldTelemetry _held
    cdef list _records, _paths
    cdef object _find_path
    cdef dict _links
    cdef readonly long bytes_out
    @cython.locals(k=Py_ssize_t, vehicle=Py_ssize_t, data=bytes, places=list, socket=long, sender=long, found=long, receivers=tuple, path=TelemetryPath, place=tuple, program=ProgramPlace)
    cpdef Py_ssize_t deliver(self, list messages, Py_ssize_t begin, object closed, double now) except -1
