# C types of viewer_telemetry.py: they make the compiled classes fast and change no result.
cimport cython
from libc cimport math

from arena.kernels cimport rotations
from arena.kernels.mavlink_framing cimport FrameParser
from arena.kernels.viewer_messages cimport NumberMessages, PoseMessages
from arena.kernels.viewer_meters cimport PathPieces, Period, Throttle, TrafficMeter, nanoseconds

cdef long _UINT8, _INT8, _UINT16, _INT16, _UINT32, _INT32, _UINT64, _INT64
cdef long _LOCAL, _ATTITUDE, _POSITION_TARGET, _ATTITUDE_TARGET, _SERVOS, _CONTROLS, _IMU, _RARE, _IGNORED
cdef long _V2, _HEAD, _CRC, _SIGNATURE, _SIGNED, _NO_YAW, _MESSAGES
cdef double _PWM_MIN_US, _PWM_SPAN_US, _HPA_PER_PA, _NAN

cdef class NumberOutput:
    cdef readonly Throttle due
    cdef readonly object log
    cdef readonly NumberMessages messages
    cpdef void send(self, long log_time) except *

cdef class PoseOutput:
    cdef readonly Throttle due
    cdef object _log, _log_transform
    cdef PoseMessages _messages
    @cython.locals(messages=PoseMessages)
    cpdef void send(self, (double, double, double) p_n, (double, double, double, double) q_nb, long log_time) except *

cdef class PayloadReader:
    cdef readonly long number
    cdef Py_ssize_t _size, _count
    cdef long[::1] _kinds, _places
    cdef readonly double[::1] values
    cdef unsigned char[::1] _u8
    cdef signed char[::1] _i8
    cdef unsigned short[::1] _u16
    cdef short[::1] _i16
    cdef unsigned int[::1] _u32
    cdef int[::1] _i32
    cdef unsigned long long[::1] _u64
    cdef long long[::1] _i64
    cdef float[::1] _f32
    @cython.locals(k=Py_ssize_t)
    cdef double[::1] read(self, bytes data, Py_ssize_t at, Py_ssize_t size)
    cdef double _number(self, long kind, Py_ssize_t at) except? -1.0

cdef class ViewerTelemetry:
    cdef readonly TrafficMeter traffic
    cdef readonly PathPieces flown, desired
    cdef long _system, _component
    cdef FrameParser _frames
    cdef list _readers
    cdef long[::1] _kinds
    cdef NumberOutput _local, _attitude, _position_setpoint, _program, _attitude_setpoint, _actuators, _imu
    cdef PoseOutput _pose, _setpoint_pose
    cdef object _on_rare, _pressure_pa, _on_up
    cdef frozenset _up_messages
    cdef bint _has_position
    cdef (double, double, double) _position
    cdef (double, double, double, double) _q_nb
    @cython.locals(size=Py_ssize_t, at=Py_ssize_t, last=Py_ssize_t, end=Py_ssize_t, wanted=bint, number=long)
    cpdef void on_datagram(self, bytes data, double time_s) except *
    cpdef void on_datagram_up(self, bytes data, double time_s) except *
    @cython.locals(size=Py_ssize_t, number=long)
    cdef bint _may_be_for_viewers(self, bytes data) except -1
    cpdef void on_reference(self, bytes data, Py_ssize_t at, Py_ssize_t size, double time_s) except *
    @cython.locals(end=Py_ssize_t)
    cdef Py_ssize_t _end(self, bytes data, Py_ssize_t at, Py_ssize_t size) except -2
    cdef long _kind(self, long number) except -1
    cdef bint _is_from_autopilot(self, long system, long component) except -1
    @cython.locals(kind=long)
    cdef bint _is_wanted(self, bytes data, Py_ssize_t at, double time_s) except -1
    cdef Throttle _limit(self, long kind)
    @cython.locals(frame=tuple)
    cdef bint _crc_fits(self, bytes data, Py_ssize_t at, Py_ssize_t size) except -1
    cdef void _take_frames(self, bytes data, double time_s) except *
    @cython.locals(kind=long, log_time=long, reader=PayloadReader, values=double[::1], k=Py_ssize_t)
    cdef void _publish(self, bytes data, Py_ssize_t start, Py_ssize_t at, Py_ssize_t size, long number, double time_s) except *
    @cython.locals(k=Py_ssize_t)
    cdef void _send_all(self, NumberOutput output, double[::1] values, long log_time) except *
    cdef void _send_local(self, double[::1] values, double time_s, long log_time) except *
    cdef void _send_attitude(self, double[::1] values, double time_s, long log_time) except *
    cdef void _send_attitude_target(self, double[::1] values, long log_time) except *
    @cython.locals(k=Py_ssize_t)
    cdef void _store_attitude(self, NumberOutput output, double[::1] values) except *
    @cython.locals(reader=PayloadReader, values=double[::1], mask=long, log_time=long, k=Py_ssize_t, yaw=double, north=double, east=double, down=double)
    cdef void _send_target(self, NumberOutput output, bytes data, Py_ssize_t at, Py_ssize_t size, double time_s) except *

@cython.locals(telemetry=ViewerTelemetry, up=bint, data=bytes, time_s=double)
cpdef void publish_datagrams(list datagrams, dict vehicles, Period period, object on_period) except *

cdef double _motor_output(double pwm_us) except? -1.0
cdef long _sequence(bytes data, Py_ssize_t start) except -1
