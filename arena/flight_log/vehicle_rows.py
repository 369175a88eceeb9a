"""Computes the rows of one vehicle's log from its recorded messages, poses and true states, with numpy.

A row of a log belongs to one instant. Measurements are interpolated for that instant, by the time stamps of their senders.
Setpoints and states are held, because they change in steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from arena.constants import MAX_ROTORS
from arena.errors import InputError
from arena.flight_log.assembly import States, make_flight
from arena.flight_log.columns import BATTERY_MAX_AGE_S, SETPOINT_MAX_AGE_S, STATE_MAX_AGE_S
from arena.flight_log.flight import Flight
from arena.flight_log.mavlink_messages import Messages, MessageSeries
from arena.flight_log.resample import (
    advancing,
    attitude,
    held,
    held_values,
    linear,
    position_velocity,
    sender_times,
)
from arena.flight_log.vehicle_record import VehicleRecord
from arena.geometry import Array
from arena.wire.px4_mode import mode_words
from arena.wire.telemetry import GAUSS_T, HIGHRES_BARO, HIGHRES_MAG, pressures_pa

_LOCAL, _ATTITUDE = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION
_IMU, _ATTITUDE_TARGET = mavlink.MAVLINK_MSG_ID_HIGHRES_IMU, mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET
_TARGET = mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED
_SERVOS = mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW
_CONTROLS = mavlink.MAVLINK_MSG_ID_ACTUATOR_CONTROL_TARGET
_HEARTBEAT, _EXTENDED = mavlink.MAVLINK_MSG_ID_HEARTBEAT, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
_STATUS, _ESTIMATOR = mavlink.MAVLINK_MSG_ID_SYS_STATUS, mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS
_WIND = mavlink.MAVLINK_MSG_ID_WIND_COV
_UNKNOWN_MV = 65535
_ALMOST = 1e-6  # of a row: multiples of the period are not exact in binary
_YAW_BIT = 10  # of type_mask


def make_flight_of(record: VehicleRecord, row_hz: float, ulogs: Sequence[Path] = ()) -> Flight | None:
    """Return the log of a vehicle, or None if no message of its autopilot was recorded.

    The function `flights_of` explains the arguments.
    """
    at = _row_times(record, row_hz)
    if not at.size:
        return None
    down = record.down
    groups = {
        **_estimate(down, at),
        **_sensors(down, at),
        **_poses(record, at),
        **_position_reference(record, at),
        **_attitude_reference(down, at),
        **_outputs(down, at),
        **_health(down, at),
        **_truth(record, at),
    }
    for path in ulogs:
        with suppress(InputError):  # the columns of a damaged ULog are empty
            for name, values in _of_ulog(path, down, at).items():
                known = groups.get(name, np.full_like(values, np.nan))
                groups[name] = np.where(np.isfinite(values), values, known)
    return make_flight(record.vehicle.name, at, groups, _states(down, at))


def _row_times(record: VehicleRecord, row_hz: float) -> Array:
    """Return the times of the log's rows [s] (n,), from the first MAVLink message on.

    With true states, these are their times. Without true states, these are multiples of 1 / row_hz.
    """
    first = record.down.first_s
    if first is None:
        return np.zeros(0)
    true = record.truth[0]
    if true.size:
        return true[advancing(true) & (true >= first)]
    numbers = np.arange(np.ceil(first * row_hz - _ALMOST), np.floor(record.end_s * row_hz + _ALMOST) + 1)
    return np.asarray(numbers / row_hz, np.float64)


def _estimate(down: MessageSeries, at: Array) -> dict[str, Array]:
    local, turning = down.messages(_LOCAL), down.messages(_ATTITUDE)
    times = local.sent()
    newer = advancing(times)
    moved = position_velocity(times[newer], local.values("x y z vx vy vz")[newer], at)
    times = turning.sent()
    newer = advancing(times)
    names = "q1 q2 q3 q4 rollspeed pitchspeed yawspeed"
    turned = attitude(times[newer], turning.values(names)[newer], at)
    return {
        "ekf.pos": moved[:, :3],
        "ekf.vel": moved[:, 3:],
        "ekf.att_q": turned[:, :4],
        "ekf.ang_vel": turned[:, 4:],
    }


def _sensors(down: MessageSeries, at: Array) -> dict[str, Array]:
    imu = down.messages(_IMU)
    times, updated = imu.sent("time_usec", 1e-6), imu.numbers("fields_updated")
    newer = advancing(times)

    def of(names: str, field: int | None = None) -> Array:
        """Return fields of HIGHRES_IMU, interpolated at the times of the rows (n, k).

        field: bit of fields_updated that marks new values; None: all values are new.
        """
        known = newer.copy()
        if field is not None:
            known[1:] &= (updated[1:] & field) != 0
        return linear(times[known], imu.values(names)[known], at)

    air = of("abs_pressure temperature pressure_alt", HIGHRES_BARO)
    return {
        "imu.acc_body": of("xacc yacc zacc"),
        "imu.ang_vel": of("xgyro ygyro zgyro"),
        "imu.mag": of("xmag ymag zmag", HIGHRES_MAG) * GAUSS_T,
        "baro.pressure": pressures_pa(air[:, 0]),
        "baro.temperature": air[:, 1],
        "baro.alt": air[:, 2],
    }


def _poses(record: VehicleRecord, at: Array) -> dict[str, Array]:
    poses = record.poses
    times = sender_times(poses[:, 1], poses[:, 0])
    newer = advancing(times)
    posed = attitude(times[newer], poses[newer, 2:], at)
    return {"mocap.pos": posed[:, 4:], "mocap.att_q": posed[:, :4]}


def _truth(record: VehicleRecord, at: Array) -> dict[str, Array]:
    if not record.vehicle.simulated:
        return {}
    times, states = record.truth
    newer = advancing(times)
    times, states = times[newer], states[newer]
    moved = position_velocity(times, states[:, :6], at)
    turned = attitude(times, states[:, 6:], at)
    return {
        "truth.pos": moved[:, :3],
        "truth.vel": moved[:, 3:],
        "truth.att_q": turned[:, :4],
        "truth.ang_vel": turned[:, 4:],
    }


def _position_reference(record: VehicleRecord, at: Array) -> dict[str, Array]:
    """Return the wanted position, velocity and yaw: from the user program, or else the autopilot's setpoints."""
    setpoint = _held_target(record.down.messages(_TARGET), at)
    published = _held_target(record.program.messages(_TARGET), at)
    wanted = np.where(np.isfinite(published), published, setpoint)
    return {"pos_ref": wanted[:, :3], "vel_ref": wanted[:, 3:6], "pos_ref.yaw": wanted[:, 6]}


def _held_target(targets: Messages, at: Array) -> Array:
    """Return position, velocity and yaw (n, 7) of POSITION_TARGET_LOCAL_NED; NaN for fields that type_mask ignores."""
    values = targets.values("x y z vx vy vz yaw")
    mask = targets.numbers("type_mask").astype(int)
    for column, bit in enumerate((0, 1, 2, 3, 4, 5, _YAW_BIT)):
        values[(mask & 1 << bit) != 0, column] = np.nan
    return held_values(targets.sent(), values, at, SETPOINT_MAX_AGE_S)


def _attitude_reference(down: MessageSeries, at: Array) -> dict[str, Array]:
    targets = down.messages(_ATTITUDE_TARGET)
    names = "q body_roll_rate body_pitch_rate body_yaw_rate thrust"
    wanted = held_values(targets.sent(), targets.values(names), at, SETPOINT_MAX_AGE_S)
    return {"att_q_ref": wanted[:, :4], "ang_vel_ref": wanted[:, 4:7], "thrust_ref": wanted[:, 7]}


def _outputs(down: MessageSeries, at: Array) -> dict[str, Array]:
    servos, controls = down.messages(_SERVOS), down.messages(_CONTROLS)
    raw = servos.values(" ".join(f"servo{k + 1}_raw" for k in range(MAX_ROTORS)))
    own = servos.numbers("port") == _port_of_rotors(raw, servos.numbers("port"))
    output = np.concatenate([np.clip((raw[own] - 1000.0) / 1000.0, 0.0, 1.0), controls.values("controls")])
    times = np.concatenate([servos.received[own], controls.received])
    order = np.argsort(times, kind="stable")
    return {"act.output": held_values(times[order], output[order], at, SETPOINT_MAX_AGE_S)}


def _port_of_rotors(raw: Array, ports: Array) -> int:
    """Return the output port of the rotors in SERVO_OUTPUT_RAW: the port whose outputs change most.

    An autopilot can have several output ports.

    raw: outputs [us] (m, MAX_ROTORS).  ports: port of each message (m,).
    """
    found = sorted({int(port) for port in ports})
    return max(found, key=lambda port: float(raw[ports == port].std(axis=0).sum()), default=0)


def _health(down: MessageSeries, at: Array) -> dict[str, Array]:
    status, estimator, wind = down.messages(_STATUS), down.messages(_ESTIMATOR), down.messages(_WIND)
    power = status.values("voltage_battery current_battery")
    power = np.where(power == (_UNKNOWN_MV, -1.0), np.nan, power) * (1e-3, 1e-2)
    power = held_values(status.received, power, at, BATTERY_MAX_AGE_S)
    names = "vel_ratio pos_horiz_ratio pos_vert_ratio mag_ratio pos_horiz_accuracy pos_vert_accuracy"
    health = held_values(estimator.received, estimator.values(names), at, STATE_MAX_AGE_S)
    return {
        "bat.voltage": power[:, 0],
        "bat.current": power[:, 1],
        "ekf.test_ratio": health[:, :4],
        "ekf.accuracy": health[:, 4:],
        "wind": held_values(wind.received, wind.values("wind_x wind_y"), at, STATE_MAX_AGE_S),
    }


def _of_ulog(path: Path, down: MessageSeries, at: Array) -> dict[str, Array]:
    """Return the health of PX4's estimator (innovations, biases ...) from a ULog, at the times of the rows.

    The ULog has the same clock as the autopilot's MAVLink messages.
    """
    from arena.flight_log.px4_ulog import (  # imported only here: pyulog is needed only here
        estimator_health,
        read_topics,
    )

    local = down.messages(_LOCAL)
    offset = float(np.median(local.sent() - local.numbers("time_boot_ms") * 1e-3)) if local.size else 0.0
    return estimator_health(read_topics(path), at - offset)


def _states(down: MessageSeries, at: Array) -> States:
    hearts, grounds, status = down.messages(_HEARTBEAT), down.messages(_EXTENDED), down.messages(_STATUS)
    index, valid = held(hearts.received, at, STATE_MAX_AGE_S)
    modes = [mode_words(int(number)) for number in hearts.numbers("custom_mode")]
    armed = (hearts.numbers("base_mode") & mavlink.MAV_MODE_FLAG_SAFETY_ARMED) != 0
    landed = (grounds.numbers("landed_state") == mavlink.MAV_LANDED_STATE_ON_GROUND).astype(float)
    remaining = status.values("battery_remaining")
    remaining[remaining < 0] = np.nan
    return States(
        mode=[modes[k] if known else "" for k, known in zip(index, valid, strict=True)],
        armed=held_values(hearts.received, armed[:, None].astype(float), at, STATE_MAX_AGE_S)[:, 0],
        landed=held_values(grounds.received, landed[:, None], at, STATE_MAX_AGE_S)[:, 0],
        battery=held_values(status.received, remaining, at, BATTERY_MAX_AGE_S)[:, 0],
    )
