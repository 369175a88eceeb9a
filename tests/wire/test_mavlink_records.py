"""The plain records of what is received often, against pymavlink's packing."""

from __future__ import annotations

import math
import random
import struct

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.wire import mavlink_records
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import parse_frames


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


def test_odometry_payload_is_that_of_pymavlink():
    covariance = [0.1 * k for k in range(21)]
    packer = mavlink_records.OdometryPacker(covariance)
    for resets, time_us, p_n, q_nb in (
        (0, 0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
        (255, 1_234_567_890_123, (1.25, -2.1, -3.3), (0.5, -0.5, 0.1, 0.7)),
    ):
        message = mavlink.MAVLink_odometry_message(
            *(time_us, mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_FRD, *p_n, q_nb),
            *(math.nan,) * 6,
            *(covariance, [math.nan] * 21, resets, mavlink.MAV_ESTIMATOR_TYPE_VISION, 100),
        )
        expected = message.pack(mavlink.MAVLink(None, srcSystem=3, srcComponent=197))
        payload = packer.payload(time_us, p_n, q_nb, resets)
        assert Codec(3, 197).frame(mavlink_records.ODOMETRY, payload) == expected
