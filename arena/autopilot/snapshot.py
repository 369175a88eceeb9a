"""What the telemetry of one step is made of: plain Python numbers, one entry per vehicle, taken from the arrays once a step."""

from __future__ import annotations

from dataclasses import dataclass

Row = list[float]


@dataclass(slots=True, kw_only=True)
class Snapshot:
    """now_s: [s] since boot.  p_n, v_n [m], [m/s] [NED]; q_nb wxyz; rpy [rad]; omega_b, gyro_b [rad/s], accel_b [m/s2] [FRD];

    mag_b [gauss]; baro_alt_m [m]; p_sp, v_sp, a_sp [NED] with NaN where free; q_sp wxyz; omega_sp [rad/s]; thrust 0..1;
    motors 0..1; battery volts, amperes, 0..1; var: position variance n, velocity variance, yaw variance (summary of the filter).
    """

    now_s: float
    p_n: list[Row]
    v_n: list[Row]
    q_nb: list[Row]
    rpy: list[Row]
    omega_b: list[Row]
    gyro_b: list[Row]
    accel_b: list[Row]
    mag_b: list[Row]
    baro_alt_m: Row
    p_sp: list[Row]
    v_sp: list[Row]
    a_sp: list[Row]
    yaw_sp: Row
    yaw_rate_sp: Row
    q_sp: list[Row]
    omega_sp: list[Row]
    thrust: Row
    motors: list[Row]
    battery_v: Row
    battery_a: Row
    battery: Row
    xy_valid: list[bool]
    z_valid: list[bool]
    yaw_valid: list[bool]
    variance: list[Row]
    test_ratio: list[Row]
    reset_counter: list[int]
