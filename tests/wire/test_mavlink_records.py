"""The fast packer of poses, compared with pymavlink's packing."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import common as mavlink

from arena.wire import mavlink_records
from arena.wire.mavlink_codec import Codec


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
