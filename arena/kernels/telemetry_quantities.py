"""Table of the quantities that telemetry messages contain, such as the position, in groups that are computed together.

The kernel `telemetry_packing` computes the quantities; `arena.autopilot.mavlink.packed_messages` puts them into messages.
"""

from __future__ import annotations

STATUS = ("mav_type", "custom_mode", "base_mode", "status", "landed", "present", "health")
PLACE = ("armed", "lat0", "lon0", "alt0", "heading", "home_d")
LOST = ("present_lost", "health_lost")
"""Inputs of a vehicle, each one number. alt0: NaN if the origin is not set. home_d: NaN if home is not set.
present_lost, health_lost: sent instead of present and health while the horizontal position is invalid."""
MODES = ("intended_mode", "standard_mode", "aligned", "bat_low", "bat_crit", "bat_emergen")
HOME = ("home_lat", "home_lon", "home_alt_mm", "home_north", "home_east")
EVENTS = ("event_sequence", "event_flags")
"""Further inputs of a vehicle, which only rare messages contain, each one number. aligned: 1 if the estimator is aligned, else 0.
bat_low, bat_crit, bat_emergen: BAT_LOW_THR, BAT_CRIT_THR and BAT_EMERGEN_THR 0..1. home_lat, home_lon: [1e-7 deg].
home_alt_mm: altitude AMSL [mm]. home_north, home_east: [m]. event_sequence: number of the newest event."""
STATUS_INPUTS, RARE_INPUTS = STATUS + PLACE + LOST, MODES + HOME + EVENTS
GROUPS: dict[str, dict[str, int]] = {
    "time": dict.fromkeys(("time_ms", "time_us", "time_us_32", "time_us_high", "time_ns", "unix_us"), 1),
    "motion": {"q_nb": 4, "omega_b": 3, "p_n": 3, "v_n": 3},
    "angles": {"rpy": 3, "heading_deg": 1, "heading_cdeg": 1},
    "covariance": {"pose_covariance": 21, "velocity_covariance": 21, "reset_counter": 1},
    "sensors": {"accel_b": 3, "gyro_b": 3, "mag_b": 3, "pressure_hpa": 1, "baro_alt": 1},
    "power": {"voltage_mv": 1, "current_ca": 1, "remaining": 1, "servos": 8},
    "heights": {"heights": 4, "alt": 1, "speed": 1, "climb": 1, "throttle": 1},
    "global": {"lat": 1, "lon": 1, "alt_mm": 1, "relative_alt_mm": 1, "velocity_cm_s": 3},
    "setpoints": {"q_sp": 4, "omega_sp": 3, "thrust": 1, "setpoint": 11, "ignored": 1},
    "escs": {
        **{"esc_counter": 1, "esc_first": 1, "esc_count": 1, "esc_online": 1},
        **{"esc_rpm": 4, "esc_voltage": 4, "esc_current": 4},
    },
    "ping": {"ping": 1},
    "status": dict.fromkeys(STATUS_INPUTS, 1),
    "rare": {
        **{"charge_state": 1, "consumed_mah": 1, "estimator_flags": 1},
        **{"ratio_position": 1, "ratio_yaw": 1, "accuracies": 2},
        **dict.fromkeys(RARE_INPUTS, 1),
    },
}
"""Group -> quantity -> number of its values. Quantities of a group are computed together, if a message contains one of them;
those of `time`, `motion` and `status` always. The constant values of messages follow after the last quantity."""
BITS = {group: 1 << k for k, group in enumerate(GROUPS)}
"""Group -> the bit that stands for the group in a set of groups."""
SIZES = {name: size for quantities in GROUPS.values() for name, size in quantities.items()}
GROUP_OF = {name: group for group, quantities in GROUPS.items() for name in quantities}
COLUMNS = {name: sum(list(SIZES.values())[:k]) for k, name in enumerate(SIZES)}
"""Quantity -> position of its first value."""
VALUES = sum(SIZES.values())
