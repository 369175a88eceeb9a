# C types of ulog_quantities.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels cimport estimate_validity, global_coordinates, rotations, standard_atmosphere
from arena.kernels.attitude_control cimport AttitudeLaw
from arena.kernels.cascade cimport CascadeLaw
from arena.kernels.control_allocation cimport ControlAllocation
from arena.kernels.estimate_validity cimport EstimateValidity
from arena.kernels.position_control cimport PositionLaw
from arena.kernels.rate_control cimport RateLaw
from arena.kernels.strapdown cimport Strapdown
from arena.kernels.vision_fusion cimport VisionFusion

cdef Py_ssize_t MOTORS
cdef long _IMU, _RATES, _ATTITUDE, _POSITION, _ACCURACY, _SETPOINT, _MOTORS, _VEHICLE, _GLOBE, _AIR, _BATTERY
cdef long _ESTIMATOR, _INNOVATIONS, _STATES, _BIASES
cdef Py_ssize_t _NOW, _PERIOD, _GYRO, _ACCEL, _OMEGA, _OMEGA_DOT, _OMEGA_SP, _TORQUE, _THRUST_Z, _ACHIEVED, _INTEGRAL
cdef Py_ssize_t _Q, _Q_SP, _YAW_RATE_FF, _FORCE, _RESETS, _P, _V, _A, _HEADING, _EPH, _P_HELD, _V_HELD, _A_HELD
cdef Py_ssize_t _THRUST_N, _YAW_HELD, _YAW_RATE, _P_SP, _V_SP, _A_SP, _YAW_SP, _CONTROL, _XY_VALID, _HAS_ORIGIN
cdef Py_ssize_t _LAT, _BARO_ALT, _MAG, _VOLTAGE, _TEST_RATIO, _REJECTS, _ALIGNED, _FUSES_BARO, _CONTROL_FLAGS
cdef Py_ssize_t _INNOVATION, _VARIANCE, _RATIO, _STATE, _COVARIANCE, _GYRO_BIAS, _GYRO_VARIANCE, _ACCEL_BIAS
cdef Py_ssize_t _ACCEL_VARIANCE, _BIAS_LIMIT, _ARMED, _ATTITUDE_VALID, _IN_XY_VALID, _LAT0, _LEVEL_POSITION
cdef double _NAN, _INF, _RECENTLY_S, _GAS_DENSITY

@cython.final
cdef class UlogQuantities:
    cdef readonly EstimateValidity validity
    cdef readonly CascadeLaw cascade
    cdef readonly ControlAllocation allocation
    cdef readonly Strapdown state
    cdef readonly VisionFusion vision
    cdef readonly double now, earth_m
    cdef readonly Py_ssize_t rotors
    cdef readonly double[::1] values, consumed_mah, baro_alt, battery_v, battery_a, battery
    cdef readonly double[::1] sp_yaw, sp_yaw_rate, yaw_rate_ff, low, critical, emergency, bias_limit
    cdef double[::1] _bits
    cdef readonly double[:, ::1] inputs, mag_b, motors, sp_p_n, sp_v_n, sp_a_n
    cdef readonly double[:, :, ::1] cov
    cdef readonly long[::1] resets, level
    cdef readonly unsigned char[::1] landed, at_rest, flying
    cpdef void set_time(self, double now, double time_us) except *
    cpdef void compute(self, Py_ssize_t i, long groups) except *
    cdef void _compute_rare(self, Py_ssize_t i, long groups) except *
    cdef void _compute_imu(self, Py_ssize_t i) except *
    @cython.locals(rate=RateLaw, achieved=double)
    cdef void _compute_rates(self, Py_ssize_t i) except *
    cdef void _compute_attitude(self, Py_ssize_t i) except *
    cdef void _compute_position(self, Py_ssize_t i) except *
    cdef void _compute_accuracy(self, Py_ssize_t i) except *
    @cython.locals(by_position=bint, position=PositionLaw, held=double)
    cdef void _compute_setpoint(self, Py_ssize_t i) except *
    @cython.locals(armed=bint, shown=bint)
    cdef void _compute_motors(self, Py_ssize_t i) except *
    cdef void _copy_vehicle(self, Py_ssize_t i) except *
    cdef bint _has_origin(self, Py_ssize_t i) except -1
    cdef void _compute_globe(self, Py_ssize_t i) except *
    cdef void _compute_air(self, Py_ssize_t i) except *
    @cython.locals(warning=double)
    cdef void _compute_battery(self, Py_ssize_t i) except *
    @cython.locals(aligned=bint, found=double)
    cdef void _compute_estimator(self, Py_ssize_t i) except *
    @cython.locals(limit=double, square=double, variance=double, innovation=double)
    cdef void _compute_innovations(self, Py_ssize_t i) except *
    cdef void _compute_states(self, Py_ssize_t i) except *
    cdef void _compute_biases(self, Py_ssize_t i) except *
