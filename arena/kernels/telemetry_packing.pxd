# C types of telemetry_packing.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels cimport estimate_validity, global_coordinates, limits, payload_writer, rotations, standard_atmosphere
from arena.kernels.payload_writer cimport PayloadWriter

cdef Py_ssize_t _TIME_MS, _TIME_US, _TIME_US_32, _TIME_NS, _RPY, _Q, _OMEGA, _P, _V
cdef Py_ssize_t _POSE_COVARIANCE, _VELOCITY_COVARIANCE, _RESETS, _ACCEL, _GYRO, _MAG, _PRESSURE, _BARO_ALT
cdef Py_ssize_t _LAT, _LON, _ALT_MM, _RELATIVE_MM, _VELOCITY_CM_S, _HEADING_CDEG, _SPEED, _ALT, _CLIMB
cdef Py_ssize_t _HEADING_DEG, _THROTTLE, _HEIGHTS, _Q_SP, _OMEGA_SP, _THRUST, _SETPOINT, _IGNORED, _SERVOS
cdef Py_ssize_t _VOLTAGE, _CURRENT, _REMAINING, _STATUS, _ARMED, _LAT0, _LON0, _ALT0, _HEADING, _HOME_D
cdef Py_ssize_t _PRESENT, _HEALTH, _PRESENT_LOST, _HEALTH_LOST
cdef Py_ssize_t _POSITION
cdef Py_ssize_t _ESC_COUNTER, _ESC_FIRST, _ESC_COUNT, _ESC_ONLINE, _ESC_RPM, _ESC_VOLTAGE, _ESC_CURRENT, _ESCS, _HEAD
cdef Py_ssize_t _UNIX_US, _TIME_US_HIGH, _PING_NUMBER, _CHARGE_STATE, _CONSUMED, _ESTIMATOR_FLAGS, _RATIOS, _ACCURACIES
cdef Py_ssize_t _MODES, _ALIGNED, _BAT_LOW
cdef Py_ssize_t _STATUS_INPUTS, _RARE_INPUTS
cdef long _ANGLES, _COVARIANCE, _SENSORS, _POWER, _ALTITUDES, _GLOBAL, _SETPOINTS, _ESC, _PING, _RARE
cdef double _DEG, _NAN, _FULL_SPEED_RPM, _MOST_FLOAT32, _CHARGE_OK

@cython.final
cdef class TelemetryPacking:
    cdef readonly dict writers
    cdef object _bytes
    cdef dict _begins
    cdef Py_ssize_t _end
    cdef unsigned char[::1] _datagram
    cdef readonly Py_ssize_t rotors
    cdef readonly double earth_m, boot_unix_us
    cdef readonly double[::1] values, baro_alt, battery_v, battery_a, battery, thrust, escs, sp_yaw, sp_yaw_rate
    cdef readonly double[::1] consumed_mah
    cdef readonly double[:, ::1] rare_inputs, test_ratio
    cdef readonly double[:, ::1] inputs, accel_b, gyro_b, mag_b, motors
    cdef readonly double[:, ::1] p_n, v_n, q_nb, omega_b, sp_p_n, v_sp_n, a_sp_n, q_sp, omega_sp
    cdef readonly double[:, :, ::1] r_nb, cov
    cdef readonly long[::1] resets, level, pings
    cdef readonly unsigned char[::1] xy_valid, z_valid
    @cython.locals(low=double)
    cpdef void set_time(self, double time_ms, double time_us, double time_ns) except *
    @cython.locals(count=long, number=long)
    cpdef long frame_count(self, Py_ssize_t i, list message_ids) except -1
    cdef long _parts(self, Py_ssize_t i, PayloadWriter writer) except -1
    @cython.locals(count=double, total=double, amperes=double, command=double, exists=bint, k=Py_ssize_t)
    cdef int _compute_escs(self, Py_ssize_t i, Py_ssize_t first) except -1
    @cython.locals(needs=long, writers=list, writer=PayloadWriter)
    cpdef bytes pack(self, Py_ssize_t i, list message_ids, Py_ssize_t link, long seq, long sysid, long compid)
    cdef int begin(self, Py_ssize_t i, long needs) except -1
    @cython.locals(part=Py_ssize_t, size=Py_ssize_t, k=Py_ssize_t)
    cdef long append(self, Py_ssize_t i, PayloadWriter writer, Py_ssize_t link, long seq, long sysid, long compid) except -1
    cdef bytes datagram(self)
    @cython.locals(k=Py_ssize_t)
    cdef int _compute_common(self, Py_ssize_t i) except -1
    cdef int _compute_angles(self, Py_ssize_t i) except -1
    @cython.locals(k=Py_ssize_t, state=double)
    cdef int _compute_rare(self, Py_ssize_t i) except -1
    @cython.locals(at=Py_ssize_t)
    cdef int _compute_covariance(self, Py_ssize_t i) except -1
    cdef int _compute_sensors(self, Py_ssize_t i) except -1
    @cython.locals(k=Py_ssize_t)
    cdef int _compute_power(self, Py_ssize_t i) except -1
    cdef int _compute_heights(self, Py_ssize_t i) except -1
    cdef int _compute_global(self, Py_ssize_t i) except -1
    @cython.locals(by_position=bint)
    cdef int _compute_setpoints(self, Py_ssize_t i) except -1
