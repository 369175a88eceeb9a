"""Reads a PX4 log file (ULog, `.ulg`) as a `Flight`, with the package pyulog.

PX4 versions 1.9 to 1.16 were checked.

PX4's topics already have the frames and units of a `Flight`: local NED, FRD, SI, quaternions wxyz. Exceptions are converted
here: gauss, and outputs in microseconds of PWM. The origin is the origin of PX4's estimate; in an arena this is the origin of the room.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from arena.constants import MAX_ROTORS
from arena.errors import InputError
from arena.flight_log.assembly import States, make_flight
from arena.flight_log.columns import BATTERY_MAX_AGE_S, SETPOINT_MAX_AGE_S, STATE_MAX_AGE_S
from arena.flight_log.flight import Flight
from arena.flight_log.resample import advancing, attitude, held, held_values, linear, position_velocity
from arena.geometry import Array, local_from_globe
from arena.wire.ulog import MAGIC

if TYPE_CHECKING:
    from pyulog import ULog

ROW_HZ = 50.0
"""Rows per second of a flight that is read from a ULog."""
_GAUSS_T = 1e-4
_ARMED = 2
_MODES = {
    0: "MANUAL",
    1: "ALTCTL",
    2: "POSCTL",
    3: "AUTO.MISSION",
    4: "AUTO.LOITER",
    5: "AUTO.RTL",
    10: "ACRO",
    12: "AUTO.LAND",  # DESCEND: PX4 reports this number over MAVLink as AUTO.LAND
    13: "TERMINATION",
    14: "OFFBOARD",
    15: "STABILIZED",
    16: "RATTITUDE",
    17: "AUTO.TAKEOFF",
    18: "AUTO.LAND",
    19: "AUTO.FOLLOW_TARGET",
    20: "AUTO.PRECLAND",
    22: "AUTO.VTOL_TAKEOFF",
}
"""nav_state of the topic vehicle_status -> name of the mode as PX4 reports it over MAVLink."""
_STATE_S = 3600.0  # PX4 logs a state when it changes, and it is valid until then
_NEEDED = "vehicle_local_position"
_EV_NED, _EV_FRD = 1, 2  # pose_frame of vehicle_visual_odometry


class _Topics:
    """Topics of a ULog, as {topic: {field: values (m,)}}.

    Only the first instance of each topic is used.
    """

    def __init__(self, data: Mapping[str, Mapping[str, NDArray[Any]]]) -> None:
        self._data = data

    def __contains__(self, topic: str) -> bool:
        return topic in self._data

    def times(self, topic: str) -> Array:
        """Return the time of each message of a topic [s] (m,).

        This is the time of the measurement if the topic has it (timestamp_sample), else the time of
        publication.
        """
        fields = self._data[topic]
        stamps = np.asarray(fields["timestamp"], float)
        sampled = np.asarray(fields.get("timestamp_sample", np.zeros(stamps.size)), float)
        return np.asarray(np.where(sampled > 0, sampled, stamps) * 1e-6)

    def values(self, topic: str, *names: str) -> Array:
        """Return fields of a topic as one array (m, k).

        A field that this version of PX4 does not have is NaN.
        """
        fields = self._data[topic]
        missing = np.full(len(fields["timestamp"]), np.nan)
        return np.stack([np.asarray(fields.get(name, missing), float) for name in names], axis=1)

    def has(self, topic: str, field: str) -> bool:
        return field in self._data.get(topic, {})

    def first(self, topic: str, field: str) -> float:
        return float(self._data[topic][field][0])


def read_ulog_flight(path: Path, row_hz: float = ROW_HZ) -> Flight:
    """Return the log in a ULog file as a `Flight`, with `row_hz` rows per second.

    The column `time.seconds` is the time since PX4 booted.

    Raises InputError if the file is not a ULog, or has no estimate of the position.
    """
    topics = read_topics(path)
    times = topics.times(_NEEDED)
    stamps = times[0] + np.arange(int((times[-1] - times[0]) * row_hz) + 1) / row_hz
    groups = {
        **_estimate(topics, stamps),
        **_sensors(topics, stamps),
        **_references(topics, stamps),
        **estimator_health(topics, stamps),
        **_truth(topics, stamps),
    }
    return make_flight(path.stem, stamps, groups, _states(topics, stamps))


def load_ulog(path: Path) -> ULog:
    """Return a ULog file as an object of the package pyulog.

    Raises InputError if the file is not a ULog or is damaged.
    """
    with path.open("rb") as file:
        head = file.read(len(MAGIC))
    if head != MAGIC:
        raise InputError(
            f"{path}: got a file that begins with {head.hex(' ').upper() or 'nothing'}, expected a PX4 log (ULog), which begins"
            f" with {MAGIC.hex(' ').upper()}: is this the right file?"
        )
    from pyulog import ULog

    try:
        return ULog(str(path))
    except Exception as error:  # pyulog raises many types, such as TypeError and struct.error
        raise InputError(f"{path}: the PX4 log (ULog) is damaged and cannot be read: {error}") from error


def read_topics(path: Path) -> _Topics:
    """Return the topics of a ULog file.

    Raises InputError if the file is not a ULog, or has no position estimate.
    """
    log = load_ulog(path)
    data = {found.name: found.data for found in reversed(log.data_list) if len(found.data["timestamp"])}
    if _NEEDED not in data:
        topics = ", ".join(sorted(data)) or "none"
        raise InputError(
            f"{path}: the PX4 log has no topic {_NEEDED}, which contains the estimated position; its topics are: {topics}."
            " Set PX4's parameter SDLOG_PROFILE to 1 (default)."
        )
    return _Topics(data)


def _held(
    topics: _Topics, stamps: Array, topic: str, *names: str, age_s: float = SETPOINT_MAX_AGE_S
) -> Array:
    return held_values(topics.times(topic), topics.values(topic, *names), stamps, age_s)


def _xyz(name: str, count: int = 3, first: int = 0) -> tuple[str, ...]:
    return tuple(f"{name}[{k}]" for k in range(first, first + count))


def _linear(topics: _Topics, stamps: Array, topic: str, *names: str) -> Array:
    times = topics.times(topic)
    newer = advancing(times)
    return linear(times[newer], topics.values(topic, *names)[newer], stamps)


def _estimate(topics: _Topics, stamps: Array) -> dict[str, Array]:
    times, values = topics.times(_NEEDED), topics.values(_NEEDED, "x", "y", "z", "vx", "vy", "vz")
    for flag, columns in (
        ("xy_valid", [0, 1]),
        ("z_valid", [2]),
        ("v_xy_valid", [3, 4]),
        ("v_z_valid", [5]),
    ):
        invalid = np.flatnonzero(topics.values(_NEEDED, flag)[:, 0] == 0)
        for column in columns:
            values[invalid, column] = np.nan
    newer = advancing(times)
    moved = position_velocity(times[newer], values[newer], stamps)
    found = {"ekf.pos": moved[:, :3], "ekf.vel": moved[:, 3:]}
    if "vehicle_attitude" in topics:
        times, q_nb = topics.times("vehicle_attitude"), topics.values("vehicle_attitude", *_xyz("q", 4))
        newer = advancing(times)
        found["ekf.att_q"] = attitude(times[newer], q_nb[newer], stamps)
    if "vehicle_angular_velocity" in topics:
        found["ekf.ang_vel"] = _linear(topics, stamps, "vehicle_angular_velocity", *_xyz("xyz"))
    elif topics.has("vehicle_attitude", "rollspeed"):  # up to v1.9
        found["ekf.ang_vel"] = _linear(
            topics, stamps, "vehicle_attitude", "rollspeed", "pitchspeed", "yawspeed"
        )
    return found


def _sensors(topics: _Topics, stamps: Array) -> dict[str, Array]:
    found: dict[str, Array] = {}
    if "sensor_combined" in topics:
        found["imu.acc_body"] = _linear(topics, stamps, "sensor_combined", *_xyz("accelerometer_m_s2"))
        found["imu.ang_vel"] = _linear(topics, stamps, "sensor_combined", *_xyz("gyro_rad"))
    if "vehicle_magnetometer" in topics:
        found["imu.mag"] = (
            _linear(topics, stamps, "vehicle_magnetometer", *_xyz("magnetometer_ga")) * _GAUSS_T
        )
    if "vehicle_air_data" in topics:
        air = "vehicle_air_data"
        warm = "ambient_temperature" if topics.has(air, "ambient_temperature") else "baro_temp_celcius"
        values = _linear(topics, stamps, air, "baro_pressure_pa", warm, "baro_alt_meter")
        found |= {
            "baro.pressure": values[:, 0],
            "baro.temperature": values[:, 1],
            "baro.alt": values[:, 2],
        }
    return found | _external_vision(topics, stamps) | _outputs(topics, stamps) | _battery(topics, stamps)


def _external_vision(topics: _Topics, stamps: Array) -> dict[str, Array]:
    topic = "vehicle_visual_odometry"
    if topic not in topics:
        return {}
    names = _xyz("position") if topics.has(topic, "position[0]") else ("x", "y", "z")  # x, y, z up to v1.13
    values = np.concatenate([topics.values(topic, *_xyz("q", 4)), topics.values(topic, *names)], axis=1)
    times, known = topics.times(topic), np.asarray(np.isfinite(values).all(axis=1))
    if topics.has(topic, "pose_frame"):
        known &= np.isin(topics.values(topic, "pose_frame")[:, 0], (_EV_NED, _EV_FRD))
    times, values = times[known], values[known]
    newer = advancing(times)
    posed = attitude(times[newer], values[newer], stamps)
    return {"mocap.att_q": posed[:, :4], "mocap.pos": posed[:, 4:]}


def _outputs(topics: _Topics, stamps: Array) -> dict[str, Array]:
    if "actuator_motors" in topics:
        output = _held(topics, stamps, "actuator_motors", *_xyz("control", MAX_ROTORS))
    elif "actuator_outputs" in topics:  # up to v1.12: microseconds of PWM
        output = (_held(topics, stamps, "actuator_outputs", *_xyz("output", MAX_ROTORS)) - 1000.0) / 1000.0
    else:
        return {}
    known = np.asarray(np.isfinite(output).any(axis=1))
    output = np.clip(np.nan_to_num(output), 0.0, 1.0)  # an unused output is 0
    return {"act.output": np.where(known[:, None], output, np.nan)}


def _battery(topics: _Topics, stamps: Array) -> dict[str, Array]:
    if "battery_status" not in topics:
        return {}
    names = ("voltage_v", "current_a")
    measured = _held(topics, stamps, "battery_status", *names, age_s=BATTERY_MAX_AGE_S)
    current = np.where(measured[:, 1] < 0, np.nan, measured[:, 1])  # -1: not measured
    return {"bat.voltage": measured[:, 0], "bat.current": current}


def _references(topics: _Topics, stamps: Array) -> dict[str, Array]:
    found: dict[str, Array] = {}
    if "vehicle_local_position_setpoint" in topics:
        topic = "vehicle_local_position_setpoint"
        wanted = _held(topics, stamps, topic, "x", "y", "z", "vx", "vy", "vz", "yaw")
        found |= {"pos_ref": wanted[:, :3], "vel_ref": wanted[:, 3:6], "pos_ref.yaw": wanted[:, 6]}
    if "vehicle_attitude_setpoint" in topics:
        topic = "vehicle_attitude_setpoint"
        wanted = _held(topics, stamps, topic, *_xyz("q_d", 4), "thrust_body[2]")
        found |= {"att_q_ref": wanted[:, :4], "thrust_ref": -wanted[:, 4]}
    if "vehicle_rates_setpoint" in topics:
        topic = "vehicle_rates_setpoint"
        wanted = _held(topics, stamps, topic, "roll", "pitch", "yaw", "thrust_body[2]")
        found |= {"ang_vel_ref": wanted[:, :3], "thrust_ref": -wanted[:, 3]}
    return found


def estimator_health(topics: _Topics, stamps: Array) -> dict[str, Array]:
    """Return quantities about the health of PX4's estimator: innovations, test ratios, biases, wind.

    stamps: times of the rows, by the clock of the log file [s] (n,).
    """
    found: dict[str, Array] = {}
    if "estimator_status" in topics:
        yaw = "hdg_test_ratio" if topics.has("estimator_status", "hdg_test_ratio") else "mag_test_ratio"
        names = (
            "vel_test_ratio",
            "pos_test_ratio",
            "hgt_test_ratio",
            yaw,
            "pos_horiz_accuracy",
            "pos_vert_accuracy",
        )
        values = _held(topics, stamps, "estimator_status", *names, age_s=STATE_MAX_AGE_S)
        found |= {"ekf.test_ratio": values[:, :4], "ekf.accuracy": values[:, 4:]}
    found |= _innovations(topics, stamps)
    if "estimator_sensor_bias" in topics:
        biases = (*_xyz("gyro_bias"), *_xyz("accel_bias"))
        bias = _held(topics, stamps, "estimator_sensor_bias", *biases, age_s=BATTERY_MAX_AGE_S)
        found |= {"ekf.gyro_bias": bias[:, :3], "ekf.acc_bias": bias[:, 3:]}
    for topic in ("wind", "estimator_wind", "wind_estimate"):
        if topic in topics:
            found["wind"] = _held(
                topics, stamps, topic, "windspeed_north", "windspeed_east", age_s=STATE_MAX_AGE_S
            )
            break
    return found


def _innovations(topics: _Topics, stamps: Array) -> dict[str, Array]:
    if "estimator_innovations" in topics:
        topic, heading = "estimator_innovations", "heading"
        aid = _position_aid(topics)
        pos: tuple[str, ...] = (f"{aid}_hpos[0]", f"{aid}_hpos[1]", f"{aid}_vpos")
        vel: tuple[str, ...] = (f"{aid}_hvel[0]", f"{aid}_hvel[1]", f"{aid}_vvel")
    elif "ekf2_innovations" in topics:  # up to v1.10
        topic, heading = "ekf2_innovations", "heading_innov"
        pos, vel = _xyz("vel_pos_innov", first=3), _xyz("vel_pos_innov")
    else:
        return {}
    values = _held(topics, stamps, topic, *pos, *vel, heading, age_s=STATE_MAX_AGE_S)
    return {
        "ekf.innov_pos": values[:, :3],
        "ekf.innov_vel": values[:, 3:6],
        "ekf.innov_yaw": values[:, 6],
    }


def _position_aid(topics: _Topics) -> str:
    """Return the prefix of the innovation fields for the position: `ev` for external vision, else `gps`."""
    seen = topics.values("estimator_innovations", "ev_hpos[0]")
    return "ev" if (np.nan_to_num(seen) != 0).any() else "gps"


def _truth(topics: _Topics, stamps: Array) -> dict[str, Array]:
    """Return the true state that a simulator sent to PX4, as {quantity: values (n, k)}.

    Positions are relative to the origin of the estimate. stamps: times of the rows [s] (n,).
    """
    topic, turning = "vehicle_local_position_groundtruth", "vehicle_attitude_groundtruth"
    if topic not in topics or turning not in topics:
        return {}
    times, values = topics.times(topic), topics.values(topic, "x", "y", "z", "vx", "vy", "vz")
    values[:, :3] += _origin_of_truth(topics)
    newer = advancing(times)
    moved = position_velocity(times[newer], values[newer], stamps)
    times, q_nb = topics.times(turning), topics.values(turning, *_xyz("q", 4))
    newer = advancing(times)
    found = {
        "truth.pos": moved[:, :3],
        "truth.vel": moved[:, 3:],
        "truth.att_q": attitude(times[newer], q_nb[newer], stamps),
    }
    if "vehicle_angular_velocity_groundtruth" in topics:
        topic = "vehicle_angular_velocity_groundtruth"
        found["truth.ang_vel"] = _linear(topics, stamps, topic, *_xyz("xyz"))
    return found


def _origin_of_truth(topics: _Topics) -> Array:
    """Return the origin of the true positions, relative to the origin of the estimate [m] [NED] (3,).

    PX4 measures the true position from the first one that it received. The heights of both origins above sea level cannot be
    compared, because arena sets the height of the estimate's origin to zero. So the first heights of both are equal.
    """
    topic = "vehicle_local_position_groundtruth"
    origins = []
    for source in (_NEEDED, topic):
        place = topics.values(source, "ref_lat", "ref_lon")
        known = place[np.isfinite(place).all(axis=1) & (place != 0.0).any(axis=1)]
        origins.append(known[-1] if len(known) else None)
    north, east = (0.0, 0.0)
    if origins[0] is not None and origins[1] is not None:
        north, east = local_from_globe(*origins[0], *origins[1])
    start = topics.values(_NEEDED, "z")[topics.values(_NEEDED, "z_valid")[:, 0] != 0, 0]
    down = start[0] - topics.values(topic, "z")[0, 0] if start.size else 0.0
    return np.array([north, east, down])


def _states(topics: _Topics, stamps: Array) -> States:
    unknown = np.full(stamps.size, np.nan)
    mode, armed, landed, battery = [""] * stamps.size, unknown, unknown, unknown
    if "vehicle_status" in topics:
        times = topics.times("vehicle_status")
        numbers = topics.values("vehicle_status", "nav_state", "arming_state")
        index, valid = held(times, stamps, _STATE_S)
        mode = [
            _MODES.get(int(numbers[k, 0]), f"mode {int(numbers[k, 0])}") if known else ""
            for k, known in zip(index, valid, strict=True)
        ]
        armed = np.where(valid, numbers[index, 1] == _ARMED, np.nan)
    if "vehicle_land_detected" in topics:
        landed = _held(topics, stamps, "vehicle_land_detected", "landed", age_s=_STATE_S)[:, 0]
    if "battery_status" in topics:
        left = _held(topics, stamps, "battery_status", "remaining", age_s=BATTERY_MAX_AGE_S)[:, 0]
        battery = np.where(left < 0, np.nan, 100.0 * left)
    return States(mode=mode, armed=armed, landed=landed, battery=battery)
