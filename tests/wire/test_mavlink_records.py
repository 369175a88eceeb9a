"""The fast packer of poses, compared with pymavlink's packing."""

from __future__ import annotations

import math
import random
import struct
from types import ModuleType
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.wire import mavlink_records
from tests.kernels.kernel_versions import compiled_modules, interpreted_modules, needs_compiled

NAME = "odometry_frames"
COVARIANCE = [0.1 * k for k in range(21)]
VERSIONS = [
    pytest.param(interpreted_modules(NAME)[NAME], id="interpreted"),
    pytest.param(compiled_modules(NAME)[NAME], id="compiled", marks=needs_compiled),
]


def messages() -> list[tuple[Any, ...]]:
    """Return (time [us], position, attitude, reset counter) of messages, without and with usual values."""
    rng = random.Random(1)
    found: list[tuple[Any, ...]] = [
        (0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), 0),
        (1_234_567_890_123_456, (1.25, -2.1, -3.3), (0.5, -0.5, 0.1, 0.7), 255),
    ]
    for k in range(300):
        p_n, q_nb = (tuple(rng.gauss(0.0, 3.0) for _ in range(size)) for size in (3, 4))
        found.append((4000 * k, p_n, q_nb, k % 3))
    return found


@pytest.mark.parametrize("kernel", VERSIONS)
def test_odometry_frame_is_that_of_pymavlink(kernel: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mavlink_records, "OdometryFrames", kernel.OdometryFrames)
    packer = mavlink_records.odometry_frames(COVARIANCE, 3, 197)
    sender = mavlink.MAVLink(None, srcSystem=3, srcComponent=197)
    for k, (time_us, p_n, q_nb, resets) in enumerate(messages()):
        message = mavlink.MAVLink_odometry_message(
            *(time_us, mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_FRD, *p_n, q_nb),
            *(math.nan,) * 6,
            *(COVARIANCE, [math.nan] * 21, resets, mavlink.MAV_ESTIMATOR_TYPE_VISION, 100),
        )
        sender.seq = k % 256
        assert packer.frame(k % 256, time_us, p_n, q_nb, resets) == message.pack(sender)


def test_poses_are_rounded_to_float32() -> None:
    frame = mavlink_records.odometry_frames(COVARIANCE, 3, 197).frame(
        0, 0, (0.1, 0.2, 0.3), (1.0, 0.0, 0.0, 0.0), 0
    )
    assert frame[18:30] == struct.pack("<3f", 0.1, 0.2, 0.3)
