"""Telemetry that is decoded when it is read."""

from __future__ import annotations

import copy

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_codec import Codec
from arena.wire.telemetry import Telemetry, pressures_pa


def position(codec: Codec, north: float) -> bytes:
    return codec.pack(mavlink.MAVLink_local_position_ned_message(1000, north, 0, 0, 0, 0, 0))


def imu(codec: Codec, fields: int, mag: float) -> bytes:
    values = [0.0] * 6 + [mag, 0.0, 0.0] + [1000.0, 0.0, 0.0, 20.0]
    return codec.pack(mavlink.MAVLink_highres_imu_message(1_000_000, *values, fields))


def test_only_the_newest_frame_of_a_value_is_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    telemetry, codec, decoded = Telemetry(1), Codec(1, 1), []
    store = telemetry._handlers[mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED]
    handlers = {mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: lambda *given: decoded.append(1) or store(*given)}
    monkeypatch.setattr(telemetry, "_handlers", handlers)
    for i in range(50):
        assert telemetry.on_datagram(position(codec, i), 0.1 * i)
    assert decoded == [] and telemetry.received_at == pytest.approx(4.9)
    assert telemetry.local is not None
    assert telemetry.local.pos[0] == 49.0 and telemetry.local.received_at == pytest.approx(4.9)
    assert len(decoded) == 1


def test_magnetic_field_of_an_older_imu_message_is_not_lost() -> None:
    telemetry, codec = Telemetry(1), Codec(1, 1)
    telemetry.on_datagram(imu(codec, 0x1FFF, 0.5), 1.0)
    telemetry.on_datagram(imu(codec, 0x003F, 9.0), 2.0)
    assert telemetry.mag is not None and telemetry.imu is not None
    assert telemetry.mag.received_at == 1.0 and telemetry.imu.received_at == 2.0


def test_values_that_an_imu_message_does_not_contain_are_not_zero() -> None:
    """PX4 that flies without a magnetometer sends zeros, and says by `fields_updated` that they are no measurement."""
    telemetry, codec = Telemetry(1), Codec(1, 1)
    telemetry.on_datagram(imu(codec, 0x003F, 0.0), 1.0)
    assert telemetry.imu is not None and telemetry.mag is None and telemetry.baro is None


def test_copy_of_telemetry_does_not_change_any_more() -> None:
    telemetry, codec = Telemetry(1), Codec(1, 1)
    telemetry.on_datagram(position(codec, 1.0), 1.0)
    kept = copy.copy(telemetry)
    telemetry.on_datagram(position(codec, 2.0), 2.0)
    assert kept.local is not None and kept.local.pos[0] == 1.0
    assert telemetry.local is not None and telemetry.local.pos[0] == 2.0


def test_pressure_is_pascal_also_from_px4_that_sends_pascal():
    assert pressures_pa([1013.25, 101325.0]) == pytest.approx([101325.0, 101325.0])
