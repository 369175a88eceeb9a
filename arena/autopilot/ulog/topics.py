"""ULog topics that are logged periodically: the period of each topic, and the quantity in each field.

The periods are those of PX4 v1.16's default profile on a flight controller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

Content = str | float
_NAN, _INF = math.nan, math.inf


@dataclass(frozen=True, kw_only=True)
class Topic:
    """ULog topic that is logged periodically: its period, and the quantity in each field.

    period_s: time between two records [s]; 0 records every sensor period
    fields: field, or an element such as `xyz[2]` -> its quantity (`arena.kernels.ulog_quantities`), or a constant. Fields without
        an entry are 0
    """

    period_s: float
    fields: dict[str, Content] = field(default_factory=dict)


_TIME: dict[str, Content] = {"timestamp": "now"}
_TIMES: dict[str, Content] = {"timestamp": "now", "timestamp_sample": "now"}
_STATE = Topic(period_s=0.5, fields=_TIME)
"""PX4 publishes these records at 2 Hz and at each change; `FlightState` writes the other fields."""
STATE = (
    "vehicle_status",
    "vehicle_control_mode",
    "vehicle_land_detected",
    "actuator_armed",
    "failsafe_flags",
    "takeoff_status",
)
"""Topics about mode, arming and failsafes."""
_INNOVATION_FIELDS = (
    "gps_hvel gps_vvel gps_hpos gps_vpos ev_hvel ev_vvel rng_vpos baro_vpos aux_hvel flow mag_field gravity drag airspeed beta"
    " hagl hagl_rate"
)


def _innovations(kind: str) -> Topic:
    """Return a log topic with the innovations of the estimator.

    kind: prefix of the quantities
    """
    return Topic(
        period_s=0.5,
        fields={
            **_TIMES,
            **dict.fromkeys(_INNOVATION_FIELDS.split(), _NAN),
            "ev_hpos": f"{kind}_xy",
            "ev_vpos": f"{kind}_z",
            "heading": f"{kind}_yaw",
        },
    )


PERIODIC: dict[str, Topic] = {
    "sensor_combined": Topic(
        period_s=0.0,
        fields={
            **_TIME,
            "gyro_rad": "gyro_b",
            "accelerometer_m_s2": "accel_b",
            "gyro_integral_dt": "period_us",
            "accelerometer_integral_dt": "period_us",
        },
    ),
    "vehicle_angular_velocity": Topic(
        period_s=0.02, fields={**_TIMES, "xyz": "omega_b", "xyz_derivative": "omega_dot_b"}
    ),
    "vehicle_rates_setpoint": Topic(
        period_s=0.02,
        fields={
            **_TIME,
            "roll": "omega_sp_x",
            "pitch": "omega_sp_y",
            "yaw": "omega_sp_z",
            "thrust_body[2]": "thrust_z",
        },
    ),
    "vehicle_thrust_setpoint": Topic(period_s=0.02, fields={**_TIMES, "xyz[2]": "thrust_z"}),
    "vehicle_torque_setpoint": Topic(period_s=0.02, fields={**_TIMES, "xyz": "torque"}),
    "vehicle_attitude": Topic(
        period_s=0.05,
        fields={**_TIMES, "q": "q_nb", "delta_q_reset[0]": 1.0, "quat_reset_counter": "resets"},
    ),
    "vehicle_attitude_setpoint": Topic(
        period_s=0.05,
        fields={**_TIME, "q_d": "q_sp", "yaw_sp_move_rate": "yaw_rate_ff", "thrust_body[2]": "thrust_z"},
    ),
    "vehicle_acceleration": Topic(period_s=0.05, fields={**_TIMES, "xyz": "force_b"}),
    "vehicle_local_position": Topic(
        period_s=0.1,
        fields={
            **_TIMES,
            "x": "north",
            "y": "east",
            "z": "down",
            "vx": "v_north",
            "vy": "v_east",
            "vz": "v_down",
            "z_deriv": "v_down",
            "ax": "a_north",
            "ay": "a_east",
            "az": "a_down",
            "heading": "heading",
            "heading_var": "heading_var",
            "unaided_heading": _NAN,
            "heading_good_for_control": "yaw_valid",
            "tilt_var": "tilt_var",
            "xy_valid": "xy_valid",
            "z_valid": "z_valid",
            "v_xy_valid": "xy_valid",
            "v_z_valid": "z_valid",
            **{f"{each}_reset_counter": "resets" for each in ("xy", "z", "vxy", "vz", "heading")},
            "xy_global": "has_origin",
            "z_global": "has_origin",
            "ref_lat": "lat0",
            "ref_lon": "lon0",
            "ref_alt": "alt0",
            "eph": "eph",
            "epv": "epv",
            "evh": "evh",
            "evv": "evv",
            "dist_bottom": _NAN,
            "dist_bottom_var": _NAN,
            **dict.fromkeys(("vxy_max", "vz_max", "hagl_min", "hagl_max_z", "hagl_max_xy"), _INF),
        },
    ),
    "vehicle_local_position_setpoint": Topic(
        period_s=0.1,
        fields={
            **_TIME,
            "x": "sp_north",
            "y": "sp_east",
            "z": "sp_down",
            "vx": "v_sp_north",
            "vy": "v_sp_east",
            "vz": "v_sp_down",
            "acceleration": "a_sp_n",
            "thrust": "thrust_n",
            "yaw": "yaw_held",
            "yawspeed": "yaw_rate_sp",
        },
    ),
    "trajectory_setpoint": Topic(
        period_s=0.2,
        fields={
            **_TIME,
            "position": "p_sp",
            "velocity": "v_sp",
            "acceleration": "a_sp",
            "jerk": _NAN,
            "yaw": "yaw_sp",
            "yawspeed": "yaw_rate_sp",
        },
    ),
    "actuator_motors": Topic(period_s=0.1, fields={**_TIMES, "control": "control"}),
    "vehicle_global_position": Topic(
        period_s=0.2,
        fields={
            **_TIMES,
            "lat": "lat",
            "lon": "lon",
            "alt": "alt",
            "alt_ellipsoid": "alt",
            "lat_lon_valid": "globe_valid",
            "alt_valid": "globe_valid",
            "eph": "eph",
            "epv": "epv",
            "terrain_alt": _NAN,
        },
    ),
    "vehicle_air_data": Topic(
        period_s=0.2,
        fields={
            **_TIMES,
            "baro_alt_meter": "baro_alt",
            "baro_pressure_pa": "pressure_pa",
            "ambient_temperature": _NAN,
            "rho": "air_density",
        },
    ),
    "vehicle_magnetometer": Topic(period_s=0.2, fields={**_TIMES, "magnetometer_ga": "mag_b"}),
    "battery_status": Topic(
        period_s=0.2,
        fields={
            **_TIME,
            "voltage_v": "voltage",
            "current_a": "current",
            "current_average_a": _NAN,
            "discharged_mah": "discharged_mah",
            "remaining": "remaining",
            "scale": 1.0,
            "time_remaining_s": _NAN,
            "temperature": _NAN,
            "volt_based_soc_estimate": _NAN,
            "warning": "battery_warning",
            "connected": 1,
            "id": 1,
        },
    ),
    "rate_ctrl_status": Topic(
        period_s=0.2,
        fields={
            **_TIME,
            "rollspeed_integ": "integral_x",
            "pitchspeed_integ": "integral_y",
            "yawspeed_integ": "integral_z",
        },
    ),
    "control_allocator_status": Topic(
        period_s=0.2,
        fields={
            **_TIME,
            "torque_setpoint_achieved": "torque_achieved",
            "thrust_setpoint_achieved": 1,
            "unallocated_torque": _NAN,
            "unallocated_thrust": _NAN,
        },
    ),
    "estimator_status": Topic(
        period_s=0.2,
        fields={
            **_TIMES,
            "output_tracking_error": _NAN,
            "control_mode_flags": "control_flags",
            "solution_status_flags": "solution_flags",
            "pos_horiz_accuracy": "eph",
            "pos_vert_accuracy": "epv",
            "hdg_test_ratio": "test_ratio_yaw",
            "pos_test_ratio": "test_ratio_position",
            "hgt_test_ratio": "ratio_z",
            **dict.fromkeys(("vel_test_ratio", "tas_test_ratio", "hagl_test_ratio", "beta_test_ratio"), _NAN),
            **dict.fromkeys(("mag_inclination_deg", "mag_inclination_ref_deg"), _NAN),
            **dict.fromkeys(("mag_strength_gs", "mag_strength_ref_gs"), _NAN),
            "reset_count_vel_ne": "resets",
            "reset_count_vel_d": "resets",
            "reset_count_pos_ne": "resets",
            "reset_count_pod_d": "resets",
            "reset_count_quat": "resets",
        },
    ),
    "estimator_status_flags": Topic(
        period_s=1.0,
        fields={
            **_TIMES,
            "cs_tilt_align": "aligned",
            "cs_yaw_align": "aligned",
            "cs_in_air": "in_air",
            "cs_baro_hgt": "fuses_baro",
            "cs_ev_pos": "fuses_xy",
            "cs_ev_hgt": "fuses_z",
            "cs_ev_yaw": "fuses_yaw",
            "cs_vehicle_at_rest": "at_rest",
            "reject_hor_pos": "rejects_position",
            "reject_ver_pos": "rejects_position",
            "reject_yaw": "rejects_yaw",
        },
    ),
    "estimator_innovations": _innovations("innovation"),
    "estimator_innovation_variances": _innovations("variance"),
    "estimator_innovation_test_ratios": _innovations("ratio"),
    "estimator_states": Topic(
        period_s=0.5,
        fields={**_TIMES, "states": "states", "covariances": "covariances", "n_states": 16},
    ),
    "estimator_sensor_bias": Topic(
        period_s=1.0,
        fields={
            **_TIMES,
            "gyro_bias": "gyro_bias",
            "gyro_bias_limit": _NAN,
            "gyro_bias_variance": "gyro_bias_variance",
            "gyro_bias_valid": "aligned",
            "accel_bias": "accel_bias",
            "accel_bias_limit": "accel_bias_limit",
            "accel_bias_variance": "accel_bias_variance",
            "accel_bias_valid": "aligned",
        },
    ),
    **dict.fromkeys(STATE, _STATE),
}
"""Topics that are recorded periodically, in the order of their msg_id."""

ON_ARRIVAL = ("vehicle_visual_odometry", "offboard_control_mode", "home_position")
"""Topics of which a record is written when a new value arrives. Their msg_id follows those of `PERIODIC`."""
TOPICS = (*PERIODIC, *ON_ARRIVAL)
