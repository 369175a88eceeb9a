"""A program's own reference, as the logger receives it."""

from __future__ import annotations

import socket

import pytest

from arena.recorder.recorder import Recorder

from .conftest import make_uav


def test_reference_arrives_at_the_logger(autopilot, address):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as logger:
        logger.bind(("127.0.0.1", 0))
        logger.settimeout(5.0)
        with make_uav(address, log=logger.getsockname()) as uav:
            uav.reference(p=[1, 2, -3], yaw=0.5)
        data = logger.recv(2048)
    recorder = Recorder(1, None)
    recorder.receive(data, 1.0)
    found = recorder._program.reference
    assert found is not None and found.pos.tolist() == [1.0, 2.0, -3.0] and found.yaw == pytest.approx(0.5)


def test_reference_without_a_logger_is_not_sent(autopilot, uav):
    uav.reference(p=[1, 2, -3])
    assert uav._connection.unsent == 0
