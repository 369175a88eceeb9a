"""The plain records of what is said and heard often, against pymavlink's packing."""

from __future__ import annotations

import random
import struct

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.wire import mavlink_records
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import parse_frames

# What a record's field is in the dialect, where the name differs.
_P, _V, _A = "x y z", "vx vy vz", "afx afy afz"
_RATES, _Q = "rollspeed pitchspeed yawspeed", "q1 q2 q3 q4"
NAMES = {
    mavlink_records.HEARTBEAT: {"status": "system_status", "version": "mavlink_version"},
    mavlink_records.SYS_STATUS: {
        "present": "onboard_control_sensors_present",
        "enabled": "onboard_control_sensors_enabled",
        "health": "onboard_control_sensors_health",
        "voltage": "voltage_battery",
        "current": "current_battery",
        "errors": "drop_rate_comm errors_comm errors_count1 errors_count2 errors_count3 errors_count4",
        "remaining": "battery_remaining",
        "extended": "onboard_control_sensors_present_extended"
        " onboard_control_sensors_enabled_extended onboard_control_sensors_health_extended",
    },
    mavlink_records.SYSTEM_TIME: {},
    mavlink_records.ATTITUDE: {"rpy": "roll pitch yaw", "omega_b": _RATES},
    mavlink_records.ATTITUDE_QUATERNION: {"q_nb": _Q, "omega_b": _RATES, "offset_q": "repr_offset_q"},
    mavlink_records.LOCAL_POSITION_NED: {"p_n": _P, "v_n": _V},
    mavlink_records.GLOBAL_POSITION_INT: {"v_n": _V, "heading": "hdg"},
    mavlink_records.SERVO_OUTPUT_RAW: {
        "servos": " ".join(f"servo{k}_raw" for k in range(1, 9)),
        "more": " ".join(f"servo{k}_raw" for k in range(9, 17)),
    },
    mavlink_records.VFR_HUD: {},
    mavlink_records.ATTITUDE_TARGET: {
        "q_nb": "q",
        "omega_b": "body_roll_rate body_pitch_rate body_yaw_rate",
        "mask": "type_mask",
    },
    mavlink_records.POSITION_TARGET: {
        "values": f"{_P} {_V} {_A} yaw yaw_rate",
        "mask": "type_mask",
        "frame": "coordinate_frame",
    },
    mavlink_records.HIGHRES_IMU: {
        "accel_b": "xacc yacc zacc",
        "gyro_b": "xgyro ygyro zgyro",
        "mag_b": "xmag ymag zmag",
        "pressure": "abs_pressure",
        "difference": "diff_pressure",
        "altitude": "pressure_alt",
        "updated": "fields_updated",
    },
    mavlink_records.TIMESYNC: {},
    mavlink_records.ALTITUDE: {
        "heights": "altitude_monotonic altitude_amsl altitude_local altitude_relative altitude_terrain bottom_clearance",
    },
    mavlink_records.EXTENDED_SYS_STATE: {"vtol": "vtol_state", "landed": "landed_state"},
    mavlink_records.ODOMETRY: {
        "p_n": _P,
        "q_nb": "q",
        "v_n": _V,
        "omega_b": _RATES,
        "pose_variance": "pose_covariance",
        "velocity_variance": "velocity_covariance",
        "frame": "frame_id",
        "child": "child_frame_id",
        "estimator": "estimator_type",
    },
}


def drawn(msgid: int, rng: np.random.Generator) -> np.ndarray:
    """A record of random values, some of its fields zero or NaN."""
    found = mavlink_records.record(msgid)
    for name in found.dtype.names:
        kind, shape = found[name].dtype, found[name].shape
        if rng.random() < 0.3:
            continue
        if kind.kind == "f":
            found[name] = np.where(
                rng.random(shape) < 0.1, np.nan, rng.normal(0.0, 10.0 ** rng.integers(-3, 6), shape)
            )
        else:
            limits = np.iinfo(kind)
            found[name] = rng.integers(limits.min, limits.max, shape, kind, endpoint=True)
    return found


def told(msgid: int, record: np.ndarray) -> mavlink.MAVLink_message:
    """The same message by pymavlink, given by the names of its fields."""
    values = {}
    for name in record.dtype.names:
        value, names = record[name][0].tolist(), NAMES[msgid].get(name, name).split()
        values |= {names[0]: value} if len(names) == 1 else dict(zip(names, value, strict=True))
    return mavlink.mavlink_map[msgid](**values)


@pytest.mark.parametrize("msgid", mavlink_records.LAYOUTS)
def test_frames_are_pymavlinks_to_the_byte(msgid):
    rng, ours, theirs = np.random.default_rng(msgid), Codec(7, 1), Codec(7, 1)
    for _ in range(300):
        record = drawn(msgid, rng)
        assert ours.frame(msgid, *mavlink_records.payloads(record)) == theirs.pack(told(msgid, record))


def test_records_of_many_vehicles_become_one_payload_each():
    records = mavlink_records.record(mavlink_records.EXTENDED_SYS_STATE, vtol=3).repeat(3)
    records["landed"] = [1, 2, 4]
    assert mavlink_records.payloads(records) == [bytes((3, 1)), bytes((3, 2)), bytes((3, 4))]


def real(rng: random.Random) -> float:
    value: float = struct.unpack(
        "<f", struct.pack("<f", rng.choice((0.0, rng.gauss(0, 5), rng.gauss(0, 1e4))))
    )[0]
    return value


def test_odometry_is_read_as_pymavlink_reads_it():
    rng = random.Random(1)
    for _ in range(300):
        sent = mavlink.MAVLink_odometry_message(
            rng.getrandbits(64),
            rng.getrandbits(8),
            rng.getrandbits(8),
            *(real(rng) for _ in range(3)),
            [real(rng) for _ in range(4)],
            *(real(rng) for _ in range(6)),
            [real(rng) for _ in range(21)],
            [real(rng) for _ in range(21)],
            rng.getrandbits(8),
            rng.choice((0, rng.getrandbits(8))),
            rng.choice((0, 50)),
        )
        data = Codec(9, 197).pack(sent)
        heard = mavlink_records.Odometry.read(data, parse_frames(data).frames[0])
        assert heard.p_n == (sent.x, sent.y, sent.z)
        assert heard.q == tuple(sent.q)
        assert heard.variances == tuple(sent.pose_covariance[k] for k in (0, 6, 11, 15, 18, 20))
        assert (heard.frame_id, heard.estimator_type) == (sent.frame_id, sent.estimator_type)


def test_a_shortened_odometry_reads_as_zero():
    data = Codec(9, 197).pack(
        mavlink.MAVLink_odometry_message(1, 0, 0, 2.0, 0, 0, [0] * 4, *[0] * 6, [0] * 21, [0] * 21)
    )
    assert mavlink_records.Odometry.read(data, parse_frames(data).frames[0]) == (
        (2.0, 0.0, 0.0),
        (0.0,) * 4,
        (0.0,) * 6,
        0,
        0,
    )


@pytest.mark.parametrize("version", [1, 2])
def test_a_position_target_is_read_as_pymavlink_reads_it(version):
    rng = random.Random(version)
    for _ in range(300):
        sent = mavlink.MAVLink_set_position_target_local_ned_message(
            rng.getrandbits(32),
            rng.getrandbits(8),
            rng.getrandbits(8),
            rng.choice((0, 1, 8)),
            rng.getrandbits(16),
            *(real(rng) for _ in range(11)),
        )
        data = sent.pack(mavlink.MAVLink(None), force_mavlink1=version == 1)
        heard = mavlink_records.PositionTarget.read(data, parse_frames(data).frames[0])
        assert heard._asdict() == {name: getattr(sent, name) for name in heard._fields}
