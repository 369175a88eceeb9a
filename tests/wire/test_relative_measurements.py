"""MAVLink messages of the emulated relative sensors, compared with pymavlink."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_ids import SENSORS_COMPONENT
from arena.wire.relative_measurements import (
    DEBUG_FLOAT_ARRAY,
    BeaconMeasurement,
    Measurement,
    NeighbourMeasurement,
    is_sensor_datagram,
    measurement_payload,
    measurements,
)

NEAR = NeighbourMeasurement(12.5, 4, (1.5, -2.25, 0.5), (0.125, -0.25, 0.75), 0.5, 0.0)
BEACON = BeaconMeasurement(0.004, 2, 3.5, -1.25, 0.5, 0.25, 0.125, (3.0, -1.5, -2.5))


def datagram(*found: Measurement, system: int = 7, component: int = SENSORS_COMPONENT) -> bytes:
    codec = Codec(system, component)
    return b"".join(codec.frame(DEBUG_FLOAT_ARRAY, measurement_payload(m)) for m in found)


def decoded(data: bytes) -> list[mavlink.MAVLink_message]:
    return mavlink.MAVLink(None).parse_buffer(bytearray(data))


def test_neighbour_is_a_debug_float_array_with_the_documented_fields() -> None:
    (m,) = decoded(datagram(NEAR))
    assert (m.get_type(), m.get_srcSystem(), m.get_srcComponent()) == ("DEBUG_FLOAT_ARRAY", 7, 158)
    assert (m.time_usec, m.name, m.array_id) == (12_500_000, "neighbour", 4)
    assert m.data[:8] == [1.5, -2.25, 0.5, 0.125, -0.25, 0.75, 0.5, 0.0]


def test_beacon_is_a_debug_float_array_with_the_documented_fields() -> None:
    (m,) = decoded(datagram(BEACON))
    assert (m.time_usec, m.name, m.array_id) == (4_000, "beacon", 2)
    assert m.data[:8] == [3.5, -1.25, 0.5, 0.25, 0.125, 3.0, -1.5, -2.5]


def test_measurements_are_read_back_in_order() -> None:
    data = datagram(NEAR, BEACON)
    assert is_sensor_datagram(data) and list(measurements(data, 7)) == [NEAR, BEACON]


def test_other_systems_components_and_names_are_ignored() -> None:
    other = mavlink.MAVLink_debug_float_array_message(0, b"my array", 1, [1.0] * 58)
    data = other.pack(mavlink.MAVLink(None, srcSystem=7, srcComponent=SENSORS_COMPONENT))
    assert list(measurements(data, 7)) == []
    assert list(measurements(datagram(NEAR), 8)) == []
    assert not is_sensor_datagram(datagram(NEAR, component=1))
    assert list(measurements(datagram(NEAR, component=1), 7)) == []


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_value_that_is_not_finite_is_ignored(bad: float) -> None:
    assert list(measurements(datagram(NEAR._replace(pos=(0.0, bad, 0.0))), 7)) == []


@pytest.mark.parametrize("data", [b"", b"\xfd", b"\xfd" * 7])
def test_short_datagrams_are_no_measurements(data: bytes) -> None:
    assert not is_sensor_datagram(data)
