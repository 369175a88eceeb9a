# C types of mcap_messages.py: they make the compiled classes fast and change no result.
cimport cython

from arena.kernels.viewer_meters cimport nanoseconds

cdef unsigned char _MESSAGE
cdef Py_ssize_t _RECORD_HEAD, _MESSAGE_HEAD, _OPCODE, _SIZE, _CHANNEL, _SEQUENCE, _LOG_TIME, _PUBLISH_TIME, _DATA, _NUMBER_BYTES
cdef long _LATEST

cdef class MessageBuffer:
    cdef object _define, _head
    cdef unsigned short[::1] _u16
    cdef unsigned int[::1] _u32
    cdef unsigned long long[::1] _u64
    cdef bytearray _records
    cdef long _first, _last
    cdef bint _is_open
    @cython.locals(size=Py_ssize_t)
    cdef void add(self, long channel, long sequence, bytes data, long log_time) except *
    cpdef tuple take(self)
    cpdef void stop(self) except *

cdef class MessageChannel:
    cdef MessageBuffer _buffer
    cdef readonly long number, count
    cpdef void log(self, bytes data, long log_time) except *

@cython.locals(is_up=bint, time_s=double)
cpdef void log_datagrams(list datagrams, dict down, dict up) except *

@cython.locals(ends=long[::1], begins=long[::1], entries=long[::1], at=Py_ssize_t, size=Py_ssize_t, channel=long, entry=long, total=long, k=Py_ssize_t)
cpdef list message_index(bytes records, long channels)
@cython.locals(found=long, k=Py_ssize_t, part=long)
cdef long _number(bytes data, Py_ssize_t at, Py_ssize_t size) except? -1
cdef long[::1] _integers(Py_ssize_t count)
