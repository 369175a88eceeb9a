"""The whole core: bytes and poses in, commands and sentences out."""

from __future__ import annotations

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.copilot.vehicle_state import VehicleStates
from arena.wire.mavlink_codec import Codec
from arena.wire.px4_mode import mode_numbers

from .scene import Scene, tilted


def test_normal_flight_is_not_commanded() -> None:
    scene = Scene(3)
    scene.run(5.0)
    assert scene.sent == [] and scene.events == []


def test_vehicle_is_held_where_it_can_still_stop_before_the_fence() -> None:
    scene = Scene()
    scene.v[0] = (2.0, 0.0, 0.0)
    scene.run(2.5)
    assert scene.commands()[0] == "AUTO.LOITER"
    when = scene.sent[0][0]
    place = 2.0 * (when - 100.0)
    assert 1.5 < 6.0 - place < 3.5
    assert "uav1: hold: geofence: to stop from 2.0 m/s" in scene.events[0]


def test_commands_have_the_copilots_ids_and_request_a_heartbeat() -> None:
    scene = Scene()
    scene.battery[0] = 5
    scene.run(0.1)
    command, ask = (m for _, _, m in scene.sent[:2])
    assert (command.get_srcSystem(), command.get_srcComponent()) == (251, 190)
    assert (command.target_system, command.target_component) == (1, 1)
    assert ask.command == mavlink.MAV_CMD_REQUEST_MESSAGE and ask.param1 == mavlink.MAVLINK_MSG_ID_HEARTBEAT


def test_later_vehicle_yields_and_the_other_stops_before_it() -> None:
    scene = Scene(2)
    scene.p = np.array([[-4.0, 0.0, -1.0], [4.0, 0.0, -1.0]])
    scene.v = np.array([[1.5, 0.0, 0.0], [-1.5, 0.0, 0.0]])
    scene.run(0.4)
    assert scene.commands(1) == ["AUTO.LOITER"] and scene.commands(0) == []
    scene.mode[1], scene.v[1] = "AUTO.LOITER", 0.0
    scene.run(4.0)
    assert scene.commands(0)[0] == "AUTO.LOITER"
    held_at = next(t for t, row, _ in scene.sent if row == 0) - 100.0
    gap = (4.0 - 1.5 * 0.4) - (-4.0 + 1.5 * held_at)
    assert 0.8 + 1.2 < gap < 3.0


@pytest.mark.parametrize("ground", ["landed", "disarmed", "unknown"])
def test_vehicle_that_does_not_fly_is_not_commanded(ground: str) -> None:
    scene = Scene()
    scene.v[0], scene.battery[0], scene.turn[0] = (4.0, 0.0, 0.0), 1, tilted(80.0)
    scene.landed[0], scene.armed[0], scene.speaks[0] = (
        ground == "landed",
        ground != "disarmed",
        ground != "unknown",
    )
    scene.run(2.0)
    assert scene.sent == []


def test_vehicle_without_poses_lands() -> None:
    scene = Scene()
    scene.run(3.0)
    scene.captured[0] = False
    scene.run(0.4)
    assert scene.sent == []
    scene.run(0.3)
    assert scene.commands() == ["AUTO.LAND"] and "no captured pose for 0.5" in scene.events[0]


def test_shifted_estimate_lands_the_vehicle() -> None:
    scene = Scene()
    scene.estimate_off[0] = (0.0, 0.25, 0.0)
    scene.run(2.0)
    assert scene.sent == []
    scene.estimate_off[0] = (0.0, 0.4, 0.0)
    scene.run(0.7)
    assert (
        scene.commands() == ["AUTO.LAND"]
        and "its estimate is 0.40 m from its captured track" in scene.events[0]
    )


def test_fast_flight_is_no_shifted_estimate() -> None:
    scene = Scene(section={"geofence": {"do": "none"}})
    scene.v[0] = (4.0, 0.0, 0.0)
    scene.run(3.0)
    assert scene.sent == []


def test_program_that_stops_its_heartbeats_lands_its_vehicle() -> None:
    scene = Scene(2)
    scene.beats[0] = True
    scene.run(2.0)
    scene.beats[0] = False
    scene.run(1.3)
    assert scene.commands(0) == ["AUTO.LAND"] and scene.commands(1) == []
    assert "no heartbeat of its program for" in scene.events[0]


def test_undefined_landed_state_ends_no_order() -> None:
    s = Scene()
    s.p[0], s.v[0] = [5.2, 0.0, -1.0], [0.5, 0.0, 0.0]
    s.run(1.0)
    assert s.core.escalations[0].held
    s.say(0, mavlink.MAVLink_extended_sys_state_message(0, 0))
    s.core.step(s.now + 0.001)
    assert s.core.escalations[0].held and s.core.flying.all()


def test_missing_landed_state_is_reported_once() -> None:
    s = Scene()
    s.speaks[0] = False
    main, sub = mode_numbers("OFFBOARD")
    for _ in range(50):
        s.say(0, mavlink.MAVLink_heartbeat_message(2, 12, 128, main << 16 | sub << 24, 4, 3))
        s.run(0.1)
    assert len([e for e in s.events if "NOT MONITORED" in e]) == 1 and not s.sent
    s.speaks[0] = True
    s.run(1.0)
    assert len([e for e in s.events if "NOT MONITORED" in e]) == 1


def test_constant_capture_times_are_reported_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    s = Scene()
    see = s.core.on_frames
    monkeypatch.setattr(
        s.core, "on_frames", lambda frames, now: see([f._replace(time_s=5.0) for f in frames], now)
    )
    s.run(5.0)
    assert len([e for e in s.events if "NOT be stopped" in e]) == 1
    monkeypatch.undo()
    s.run(1.0)
    monkeypatch.setattr(
        s.core, "on_frames", lambda frames, now: see([f._replace(time_s=5.0) for f in frames], now)
    )
    s.run(5.0)
    assert len([e for e in s.events if "NOT be stopped" in e]) == 2


def _obeying(s: Scene, seconds: float) -> None:
    """Every order is obeyed at once."""
    for _ in range(round(seconds / 0.1)):
        s.run(0.1)
        s.mode = [(s.commands(i) or ["OFFBOARD"])[-1] for i in range(len(s.mode))]


def test_vehicle_that_descends_beyond_the_fence_is_not_terminated() -> None:
    s = Scene(1, {"at_most": "terminate"})
    s.p[0] = [6.05, 0.0, -2.0]
    _obeying(s, 2.5)
    s.v[0] = [0.05, 0.0, 0.4]
    _obeying(s, 4.0)
    assert s.commands() == ["AUTO.LOITER", "AUTO.LAND"]


def test_vehicle_that_flies_on_beyond_the_fence_is_terminated() -> None:
    s = Scene(1, {"at_most": "terminate"})
    s.p[0], s.v[0] = [5.0, 0.0, -2.0], [1.0, 0.0, 0.0]
    for _ in range(60):
        s.run(0.1)
        s.mode[0] = {"terminate": "AUTO.LAND"}.get(
            (s.commands() or ["OFFBOARD"])[-1], (s.commands() or ["OFFBOARD"])[-1]
        )
    assert s.commands() == ["AUTO.LOITER", "AUTO.LAND", "terminate"]


def test_vehicles_that_land_side_by_side_are_not_terminated() -> None:
    s = Scene(2, {"at_most": "terminate"})
    s.p[1] = s.p[0] + [0.7, 0.0, 0.0]
    _obeying(s, 8.0)
    assert s.commands(1) == ["AUTO.LOITER", "AUTO.LAND"] and "terminate" not in s.commands(0)


def test_new_arming_forgets_earlier_program_heartbeats() -> None:
    scene = Scene()
    scene.beats[0] = True
    scene.run(1.0)
    scene.beats[0], scene.armed[0], scene.landed[0] = False, False, True
    scene.run(1.0)
    scene.armed[0], scene.landed[0] = True, False
    scene.run(3.0)
    assert scene.sent == []


def test_tilted_vehicle_lands() -> None:
    scene = Scene()
    scene.turn[0] = tilted(70.0)
    scene.run(0.5)
    assert scene.commands() == ["AUTO.LAND"]


def test_silent_vehicle_is_reported_once_and_monitored_by_capture() -> None:
    scene = Scene()
    scene.run(1.0)
    scene.speaks[0] = False
    scene.run(5.0)
    assert len(scene.events) == 1 and "no heartbeat for 3 s" in scene.events[0] and scene.sent == []
    scene.v[0] = (2.0, 0.0, 0.0)
    scene.run(2.6)
    assert scene.commands()[0] == "AUTO.LOITER"
    scene.speaks[0] = True
    scene.run(0.1)
    assert any("heartbeat received again" in e for e in scene.events)


def test_common_target_is_reported_once() -> None:
    scene = Scene(2)
    scene.p = np.array([[-3.0, 0.0, -1.0], [3.0, 0.0, -1.0]])
    for _ in range(60):
        for i in range(2):
            scene.say(
                i, mavlink.MAVLink_position_target_local_ned_message(0, 1, 0, 0.1 * i, 0, -1, *[0.0] * 8)
            )
        scene.run(0.02)
    assert [e for e in scene.events if "commanded" in e] == [
        "uav2 yields to uav1: both are commanded to about N 0.1 E 0.0 D -1.0, 0.10 m apart"
    ]


def test_refused_command_is_reported_once_and_repeated() -> None:
    scene = Scene()
    scene.battery[0] = 5
    for _ in range(20):
        scene.run(0.1)
        scene.say(0, mavlink.MAVLink_command_ack_message(mavlink.MAV_CMD_DO_SET_MODE, 2, 0, 0, 251, 190))
    assert [e for e in scene.events if "refused" in e] == [
        "uav1: the autopilot refused a command: denied; retrying"
    ]
    assert len(scene.sent) > 10


def test_states_equal_those_decoded_by_pymavlink() -> None:
    known, codec = VehicleStates([7]), Codec(7, 1)
    known.on_datagram(
        0, codec.pack(mavlink.MAVLink_local_position_ned_message(5, 1.5, -2.5, 0.0, 9, 9, 9)), 1.0
    )
    known.on_datagram(
        0, codec.pack(mavlink.MAVLink_sys_status_message(1, 2, 3, 4, 5, 6, 55, 8, 9, 10, 11, 12, 13)), 2.0
    )
    known.on_datagram(
        0,
        codec.pack(mavlink.MAVLink_position_target_local_ned_message(5, 1, 0, 3.0, 4.0, -5.0, *[0.0] * 8)),
        3.0,
    )
    assert known.estimate[0].tolist() == [1.5, -2.5, 0.0] and known.battery[0] == 0.55
    assert known.target[0].tolist() == [3.0, 4.0, -5.0]
    known.on_datagram(
        0,
        codec.pack(mavlink.MAVLink_position_target_local_ned_message(5, 1, 7, 3.0, 4.0, -5.0, *[0.0] * 8)),
        4.0,
    )
    assert np.isnan(known.target[0]).all() and np.isinf(known.target_since[0])


def test_telemetry_is_accepted_only_from_the_vehicles_tools_port() -> None:
    known = VehicleStates([1, 2])
    beat = mavlink.MAVLink_heartbeat_message(2, 12, 128, 6 << 16, 4, 3)
    known.on_datagram(1, Codec(1, 1).pack(beat), 1.0)
    known.on_datagram(None, Codec(1, 1).pack(beat), 1.0)
    assert known.armed == [None, None]
    known.on_datagram(None, Codec(2, 191).pack(beat), 1.0)
    assert known.program_heartbeat_at.tolist() == [-np.inf, 1.0]
    known.on_datagram(None, Codec(9, 191).pack(beat), 1.0)
    known.on_datagram(None, b"\xfd\x00garbage", 1.0)
    assert known.counts["garbled"] == 1
