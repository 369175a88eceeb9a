# C types of ordinary_messages.py: they make the compiled class fast and change no result.
cimport cython

from arena.kernels cimport mavlink_framing
from arena.kernels.offboard_setpoints cimport OffboardSetpoints
from arena.kernels.vision_input cimport VisionInput

cdef long _ODOMETRY, _SET_POSITION_TARGET, _V2, _HEAD, _CRC, _AUTOPILOT
cdef long _P, _Q, _VAR_N, _VAR_E, _VAR_D, _VAR_YAW, _FRAME_ID, _ESTIMATOR
cdef long _TARGET, _MASK, _SYSTEM, _COMPONENT, _FRAME, _LOCAL_NED, _LOCAL_FRD, _UNKNOWN, _VISION, _VIO

cdef class OrdinaryMessages:
    cdef readonly long[::1] system_ids
    cdef readonly VisionInput vision
    cdef readonly OffboardSetpoints offboard
    cdef bytes _odometry_seed, _setpoint_seed
    cdef frozenset _links
    cdef list _passes_setpoint
    cdef long _payload, _length
    cdef unsigned char[::1] _bytes
    cdef float[::1] _float
    @cython.locals(data=bytes, msgid=long, length=long)
    cpdef bint receive(self, Py_ssize_t i, str link, object datagram, double now) except -1
    @cython.locals(size=Py_ssize_t, msgid=long, own=long, system=long, component=long)
    cdef long _message_id(self, Py_ssize_t i, bytes data) except -2
    cdef bint _crc_fits(self, bytes data, Py_ssize_t end, bytes seed) except -1
    @cython.locals(frame=long, estimator=long, north=double, east=double, down=double, w=double, x=double, y=double, z=double, var_n=double, var_e=double, var_d=double, var_yaw=double)
    cpdef void read_pose(self, Py_ssize_t i, bytes data, long payload, long length) except *
    @cython.locals(target="double[::1]", mask=long)
    cpdef str read_setpoint(self, Py_ssize_t i, bytes data, long payload, long length, double now)
    cdef long _byte_at(self, bytes data, long offset) except -1
    cdef double _float_at(self, bytes data, long offset) except? -1.0
