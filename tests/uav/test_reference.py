"""A program's own reference, as the recorder receives it."""

from __future__ import annotations

import socket

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.wire.telemetry import Telemetry

from .conftest import make_uav


def test_reference_arrives_at_the_recorder(autopilot, address):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as logger:
        logger.bind(("127.0.0.1", 0))
        logger.settimeout(60.0)
        with make_uav(address, log=logger.getsockname()) as uav:
            uav.reference(p=[1, 2, -3], yaw=0.5)
        data = logger.recv(2048)
    telemetry = Telemetry(1, component_id=mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
    telemetry.on_datagram(data, 1.0)
    found = telemetry.reference
    assert found is not None and found.pos.tolist() == [1.0, 2.0, -3.0] and found.yaw == pytest.approx(0.5)


def test_reference_without_a_recorder_is_not_sent(autopilot, uav):
    uav.reference(p=[1, 2, -3])
    assert uav._connection.unsent == 0
