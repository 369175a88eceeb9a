# C types of ordinary_datagrams.py: they make the compiled class fast and change no result.
cimport cython

cdef long _V1, _V2, _SIGNED, _V1_HEAD, _V2_HEAD, _CRC, _SIGNATURE, _AUTOPILOT, _NO_VEHICLE, _Z, _BATTERY_REMAINING, _LANDED_STATE
cdef long _SETPOINT, _POSITION, _NOT_FROM_AUTOPILOT, _NOT_FROM_CLIENT, _BATTERY, _LANDED, _MAX_SENDERS, _SEED_SHIFT, _TARGET_SHIFT

@cython.final
cdef class OrdinaryDatagrams:
    cdef readonly long max_bytes
    cdef readonly list receivers
    cdef readonly long[::1] versions
    cdef public long from_vehicles, to_clients, from_clients, to_vehicles, bytes_in
    cdef list _passes_setpoint
    cdef long[::1] _messages, _ids, _link_of, _remote, _client_of, _next_client
    cdef long[::1] _owner, _address, _senders, _receiver_counts, _z_bits, _charge, _landed, _is_vehicle
    cdef long _sysid, _compid, _kind, _target, _payload, _length
    cpdef long take_z_bits(self, Py_ssize_t v) except? -2
    @cython.locals(v=long, client=long)
    cpdef long find(self, long socket, long sender, const unsigned char[::1] data, long start, long end, double now) except? -2
    @cython.locals(receivers=long, frames=long, at=long, z=long, kind=long)
    cdef long _from_vehicle(self, long v, const unsigned char[::1] data, long start, long end) except? -2
    @cython.locals(v=long, frames=long, at=long, kind=long, setpoint=bint)
    cdef long _from_client(self, long client, const unsigned char[::1] data, long start, long end, double now) except? -2
    @cython.locals(sender=long, first=long, known=long, i=long)
    cdef bint _knows_sender(self, long client) except -1
    @cython.locals(magic=long, signature=long, msgid=long, crc_at=long, message=long, crc=long, target=long)
    cdef long _read_frame(self, const unsigned char[::1] data, long at, long end) except? -2
    @cython.locals(crc=long, byte=long, i=long)
    cdef long _crc(self, const unsigned char[::1] data, long start, long end, long seed) except? -2
    @cython.locals(number=long, byte=long, i=long)
    cdef long _number_at(self, const unsigned char[::1] data, long offset) except? -2
