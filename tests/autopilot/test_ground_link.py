"""The link of the built-in autopilot for ground stations: its own streams, its own replies, the same authority."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import pytest
from flight import Flight
from pymavlink.dialects.v20 import common as mavlink

from arena.authority import Role, role_on_link
from arena.autopilot import Autopilots
from arena.wire.mavlink_frame import parse_frames

PX4_NORMAL_HZ = {
    "ALTITUDE": 1.0,
    "ATTITUDE": 15.0,
    "ATTITUDE_QUATERNION": 10.0,
    "ATTITUDE_TARGET": 2.0,
    "BATTERY_STATUS": 0.5,
    "ESTIMATOR_STATUS": 0.5,
    "EXTENDED_SYS_STATE": 1.0,
    "HEARTBEAT": 1.0,
    "LOCAL_POSITION_NED": 1.0,
    "MISSION_CURRENT": 1.0,
    "PING": 0.1,
    "SCALED_PRESSURE": 1.0,
    "SERVO_OUTPUT_RAW": 1.0,
    "SYS_STATUS": 1.0,
    "VFR_HUD": 4.0,
    "VIBRATION": 0.1,
}
NOT_NORMAL = ("TIMESYNC", "HIGHRES_IMU", "ODOMETRY", "SYSTEM_TIME")
LAND = (1, 4, 6)


class TwoLinks(Flight):
    """A flight whose messages on the links `router` and `ground` are kept: `on["ground"]`, newest last."""

    def __init__(self, **settings) -> None:
        super().__init__(1)
        self.pilots = Autopilots(self.settings, self.world.period_s, **settings)
        self.on: dict[str, list] = {"router": [], "ground": []}
        self.bytes_on = dict.fromkeys(self.on, b"")
        self.station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self._decoders = {name: mavlink.MAVLink(None) for name in self.on}
        transmit = self.pilots.transmit

        def kept():
            sent = transmit()
            for _, link, data in sent:
                if link in self.on:
                    self.bytes_on[link] += data
                    self.on[link] += self._decoders[link].parse_buffer(data) or []
            return sent

        self.pilots.transmit = kept

    def clear(self) -> TwoLinks:
        for found in self.on.values():
            found.clear()
        self.bytes_on = dict.fromkeys(self.on, b"")
        return self

    def names(self, link: str) -> Counter[str]:
        return Counter(m.get_type() for m in self.on[link])

    def station_sends(self, message, link: str = "ground", sender=None) -> None:
        self.pilots.receive(0, link, message.pack(sender or self.station))
        self.run(0.05)

    def beat(self) -> None:
        self.station_sends(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))

    def station_command(self, number: int, *p: float, sender=None) -> list[int]:
        """Send a command on the ground station link. Return the results of the acknowledgements on this link."""
        self.clear()
        m = mavlink.MAVLink_command_long_message(1, 1, number, 0, *[*p, *[0.0] * 7][:7])
        self.station_sends(m, sender=sender)
        assert "COMMAND_ACK" not in self.names("router")
        return [m.result for m in self.on["ground"] if m.get_type() == "COMMAND_ACK"]


def hover(f) -> None:
    f.setpoint(0, (0.0, 0.0, -1.0))


@pytest.fixture
def flight() -> TwoLinks:
    """Return a flight with authority, on the ground and ready to arm."""
    f = TwoLinks(authority=True)
    f.until(lambda f: f.pilots.vehicles[0].ready_to_arm, 20)
    return f


def test_every_sender_on_the_link_is_a_ground_station():
    for system in (255, 1, 253, 251, 250):
        assert role_on_link("ground", system, 1) is Role.GROUND_STATION


def test_ground_station_cannot_arm_after_land_all_under_any_system_id(flight):
    flight.run(0.2, hover)
    assert flight.offboard(0) == 0 and flight.arm(0) == 0
    flight.run(2.0, hover)
    land_all = mavlink.MAVLink(None, srcSystem=253, srcComponent=195)
    m = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, *LAND, 0, 0, 0, 0)
    flight.pilots.receive(0, "panic", m.pack(land_all))
    flight.run(0.1, hover)
    assert flight.mode(0) == "AUTO.LAND"
    for system in (255, 1, 253, 251, 250):
        sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
        assert flight.station_command(176, 1, 6, sender=sender) == [mavlink.MAV_RESULT_DENIED]
    assert flight.mode(0) == "AUTO.LAND"
    flight.until(lambda f: not f.armed(0), 20.0, hover)
    assert flight.station_command(400, 1) == [mavlink.MAV_RESULT_DENIED] and not flight.armed(0)


def test_land_all_lands_a_vehicle_that_a_ground_station_flies(flight):
    flight.beat()
    flight.run(0.2, hover)
    assert flight.offboard(0) == 0 and flight.station_command(400, 1) == [0]
    flight.run(2.0, hover)
    land_all = mavlink.MAVLink(None, srcSystem=253, srcComponent=195)
    m = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, *LAND, 0, 0, 0, 0)
    flight.pilots.receive(0, "panic", m.pack(land_all))
    flight.run(0.1, hover)
    assert flight.mode(0) == "AUTO.LAND"


def test_only_heartbeats_are_sent_until_a_ground_station_is_received(flight):
    flight.clear().run(5.0)
    assert set(flight.names("ground")) == {"HEARTBEAT"} and flight.names("ground")["HEARTBEAT"] == 5
    flight.beat()
    flight.clear().run(1.0)
    assert flight.names("ground")["ATTITUDE"] == 15


def test_streams_and_rates_are_px4s_of_mode_normal(flight):
    flight.beat()
    flight.run(1.0).clear().run(30.0)
    found = flight.names("ground")
    for name, hz in PX4_NORMAL_HZ.items():
        assert abs(found[name] / 30.0 - hz) <= 0.04, name
    assert not [name for name in NOT_NORMAL if found[name]]


def test_a_ground_station_changes_no_byte_of_the_router_link():
    sent = []
    for station in (False, True):
        f, kept = TwoLinks(), []
        transmit = f.pilots.transmit

        def keep(kept=kept, transmit=transmit):
            out = transmit()
            kept += [data for _, link, data in out if link == "router"]
            return out

        f.pilots.transmit = keep
        for _ in range(3):
            if station:
                f.beat()
            else:
                f.run(0.05)
            f.run(1.0)
        sent.append(kept)
    assert sent[0] == sent[1] and len(sent[0]) > 100


def test_each_link_has_its_own_sequence_numbers(flight):
    flight.beat()
    flight.clear().run(2.0)
    for link, data in flight.bytes_on.items():
        numbers = [data[frame.start + 4] for frame in parse_frames(data).frames]
        assert len(numbers) > 50
        assert {(b - a) % 256 for a, b in pairwise(numbers)} == {1}, link


def test_command_is_acknowledged_once_on_its_own_link(flight):
    assert flight.station_command(400, 1) == [0] and flight.armed(0)
    assert flight.station_command(400, 0) == [0]
    flight.clear()
    assert flight.command(0, 400, 1) == 0
    assert "COMMAND_ACK" not in flight.names("ground")


def test_interval_and_request_of_a_ground_station_change_its_link_only(flight):
    flight.beat()
    for us, on_ground in ((100_000, 10), (-1, 0), (0, 15)):
        assert flight.station_command(511, 30, us) == [0]
        flight.run(0.5).clear().run(2.0)
        assert abs(flight.names("ground")["ATTITUDE"] - 2 * on_ground) <= 1
        assert abs(flight.names("router")["ATTITUDE"] - 200) <= 2
    assert flight.command(0, 511, 30, 500_000) == 0
    flight.clear().run(2.0)
    assert abs(flight.names("ground")["ATTITUDE"] - 30) <= 1
    assert flight.station_command(512, 148) == [0]
    assert flight.names("ground")["AUTOPILOT_VERSION"] == 1
    assert flight.names("router")["AUTOPILOT_VERSION"] == 0


def test_parameters_and_missions_are_answered_on_the_link_of_the_request(flight):
    flight.beat()
    for request, reply in (
        (mavlink.MAVLink_param_request_read_message(1, 1, b"MPC_XY_P", -1), "PARAM_VALUE"),
        (mavlink.MAVLink_param_set_message(1, 1, b"MPC_XY_P", 1.05, 9), "PARAM_VALUE"),
        (mavlink.MAVLink_mission_request_list_message(1, 1, 0), "MISSION_COUNT"),
        (mavlink.MAVLink_ping_message(5, 77, 0, 0), "PING"),
    ):
        flight.clear()
        flight.station_sends(request)
        assert flight.names("ground")[reply] == 1, reply
        assert not [m for m in flight.on["router"] if m.get_type() == reply and getattr(m, "seq", 77) == 77]


def test_texts_reach_the_ground_station_and_the_router_once_each(flight):
    flight.beat()
    flight.send(0, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    flight.clear()
    assert flight.command(0, mavlink.MAV_CMD_DO_SET_MODE, 1, 9) != 0
    flight.run(0.1)
    assert flight.names("ground")["STATUSTEXT"] == flight.names("router")["STATUSTEXT"] > 0
