"""Telemetry streams of a flying vehicle: which of them the kernels send without Python, and their order in a datagram."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.mavlink.mavlink_interface import MavlinkInterface
from arena.autopilot.mavlink.packed_messages import FREQUENT, RARE
from arena.autopilot.mavlink.streams import LINK_RATES
from arena.wire.mavlink_frame import parse_frames
from tests.autopilot.flight import Flight

NEVER_IN_OFFBOARD = {
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS,  # no radio
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT,  # no AUTO mode
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
    mavlink.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS,  # no orbit
}
PERIOD_S = 11.0  # every default stream is sent: the slowest has 0.1 Hz


class Hovering(Flight):
    """A vehicle that hovers in OFFBOARD, and all datagrams that it sends while `recorded` is a list."""

    def __init__(self) -> None:
        super().__init__(1)
        self.recorded: list[tuple[str, bytes]] | None = None
        transmit = self.pilots.transmit

        def recording() -> list[tuple[int, str, bytes]]:
            sent = transmit()
            if self.recorded is not None:
                self.recorded += [(link, data) for _, link, data in sent]
            return sent

        self.pilots.transmit = recording  # type: ignore[method-assign]
        self.send(0, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), "ground")
        self.send(0, mavlink.MAVLink_set_gps_global_origin_message(1, 387_000_000, -91_000_000, 100_000))
        self.until(lambda f: f.pilots.vehicles[0].ready_to_arm, 20, self.hover)
        self.run(0.1, self.hover)
        assert self.offboard(0) == 0 and self.arm(0) == 0
        self.run(6.0, self.hover)
        assert abs(self.position(0)[2] + 1.5) < 0.2

    @staticmethod
    def hover(flight: Flight) -> None:
        flight.setpoint(0, (0.0, 0.0, -1.5))

    def datagrams(self, seconds: float) -> list[tuple[str, bytes]]:
        """Return (link, datagram) of all datagrams of some seconds of hovering."""
        self.recorded = sent = []
        self.run(seconds, self.hover)
        self.recorded = None
        return sent


@pytest.fixture(scope="module")
def shared() -> Hovering:
    return Hovering()


@pytest.fixture
def flight(shared: Hovering) -> Iterator[Hovering]:
    shared.recorded = None
    yield shared


def ids_of(data: bytes) -> list[int]:
    return [frame.msgid for frame in parse_frames(data).frames]


def test_default_streams_of_a_hovering_vehicle_need_no_python(flight, monkeypatch):
    calls: list[Any] = []
    monkeypatch.setattr(MavlinkInterface, "transmit", lambda *_: calls.append(_) or [])
    flight.pilots._telemetry.wake_s[:] = np.inf  # without the progress of missions, which is no stream
    found: dict[str, set[int]] = {}
    for link, data in flight.datagrams(PERIOD_S):
        found.setdefault(link, set()).update(ids_of(data))
    assert not calls
    assert found == {link: rates.keys() - NEVER_IN_OFFBOARD for link, rates in LINK_RATES.items()}
    flight.pilots._telemetry.wake_s[:] = 0.0


@pytest.mark.parametrize("by_python", [False, True])
def test_rare_messages_are_the_first_in_a_datagram(flight, by_python):
    def wake(_: Any) -> None:
        flight.pilots._telemetry.wake_s[:] = 0.0 if by_python else np.inf

    together = 0
    flight.run(0.02, wake)
    for _ in range(150):
        wake(None)
        for _, data in flight.datagrams(0.02):
            streamed = [msgid in FREQUENT for msgid in ids_of(data) if msgid in FREQUENT or msgid in RARE]
            assert streamed == sorted(streamed)
            together += len(set(streamed)) == 2
    assert together > 3
    flight.pilots._telemetry.wake_s[:] = 0.0


def test_pings_of_a_link_are_numbered_without_gaps(flight):
    """Requested messages are packed in Python, streams in the kernel. Both use one counter."""
    numbers = []
    ping = mavlink.MAVLINK_MSG_ID_PING
    flight.recorded = sent = []
    for _ in range(4):
        flight.command(0, mavlink.MAV_CMD_REQUEST_MESSAGE, ping)
        flight.run(1.0, flight.hover)
    flight.recorded = None
    for link, data in sent:
        found = mavlink.MAVLink(None).parse_buffer(data) or []
        numbers += [m.seq for m in found if m.get_msgId() == ping and link == "router"]
    assert len(numbers) >= 8 and numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_sequence_numbers_of_each_link_have_no_gaps(flight):
    expected: dict[str, int] = {}
    for link, data in flight.datagrams(3.0):
        for frame in parse_frames(data).frames:
            seq = data[frame.start + 4]
            assert seq == expected.get(link, seq)
            expected[link] = (seq + 1) % 256


def test_changed_battery_threshold_is_in_the_next_battery_status(flight):
    flight.battery[0] = 0.4
    flight.send(0, mavlink.MAVLink_param_set_message(1, 1, b"BAT_LOW_THR", 0.45, 9))
    flight.run(0.1, flight.hover)
    flight.command(0, mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_BATTERY_STATUS)
    (m,) = [m for m in flight.received[0] if m.get_type() == "BATTERY_STATUS"]
    assert m.charge_state == mavlink.MAV_BATTERY_CHARGE_STATE_LOW
