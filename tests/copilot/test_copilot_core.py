"""The whole core: bytes and poses in, commands and sentences out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.copilot.vehicle_state import Known
from arena.wire.mavlink_codec import Codec
from arena.wire.px4_mode import mode_numbers

from .scene import Scene, tilted


def test_a_quiet_flight_is_left_alone() -> None:
    scene = Scene(3)
    scene.run(5.0)
    assert scene.sent == [] and scene.events == []


def test_a_vehicle_that_flies_at_the_wall_is_held_where_the_stop_still_fits() -> None:
    scene = Scene()
    scene.v[0] = (2.0, 0.0, 0.0)
    scene.run(2.5)
    assert scene.commands()[0] == "AUTO.LOITER"
    when = scene.sent[0][0]
    place = 2.0 * (when - 100.0)
    assert 1.5 < 6.0 - place < 3.5
    assert "uav1: hold: geofence: to stop from 2.0 m/s" in scene.events[0]


def test_orders_go_to_the_vehicle_by_our_own_name_and_its_heartbeat_is_asked_for() -> None:
    scene = Scene()
    scene.battery[0] = 5
    scene.run(0.1)
    command, ask = (m for _, _, m in scene.sent[:2])
    assert (command.get_srcSystem(), command.get_srcComponent()) == (251, 190)
    assert (command.target_system, command.target_component) == (1, 1)
    assert ask.command == mavlink.MAV_CMD_REQUEST_MESSAGE and ask.param1 == mavlink.MAVLINK_MSG_ID_HEARTBEAT


def test_the_yielder_lets_the_other_by_and_the_other_stops_before_it() -> None:
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
def test_whoever_is_on_the_ground_disarmed_or_never_heard_is_not_commanded(ground: str) -> None:
    scene = Scene()
    scene.v[0], scene.battery[0], scene.turn[0] = (4.0, 0.0, 0.0), 1, tilted(80.0)
    scene.landed[0], scene.armed[0], scene.speaks[0] = (
        ground == "landed",
        ground != "disarmed",
        ground != "unknown",
    )
    scene.run(2.0)
    assert scene.sent == []


def test_a_vehicle_that_is_lost_to_the_cameras_lands() -> None:
    scene = Scene()
    scene.run(3.0)
    scene.captured[0] = False
    scene.run(0.4)
    assert scene.sent == []
    scene.run(0.3)
    assert scene.commands() == ["AUTO.LAND"] and "not been captured for 0.5" in scene.events[0]


def test_an_estimate_shifted_against_the_capture_lands_the_vehicle() -> None:
    scene = Scene()
    scene.estimate_off[0] = (0.0, 0.25, 0.0)
    scene.run(2.0)
    assert scene.sent == []
    scene.estimate_off[0] = (0.0, 0.4, 0.0)
    scene.run(0.7)
    assert (
        scene.commands() == ["AUTO.LAND"]
        and "its estimate is 0.40 m from where it was captured" in scene.events[0]
    )


def test_a_fast_flight_is_no_shifted_estimate() -> None:
    scene = Scene(section={"geofence": {"do": "none"}})
    scene.v[0] = (4.0, 0.0, 0.0)
    scene.run(3.0)
    assert scene.sent == []


def test_a_program_that_has_beaten_and_falls_silent_lands_and_one_that_never_beat_does_not() -> None:
    scene = Scene(2)
    scene.beats[0] = True
    scene.run(2.0)
    scene.beats[0] = False
    scene.run(1.3)
    assert scene.commands(0) == ["AUTO.LAND"] and scene.commands(1) == []
    assert "its program has not beaten for" in scene.events[0]


def test_an_undefined_landed_state_takes_no_order_back() -> None:
    s = Scene()
    s.p[0], s.v[0] = [5.2, 0.0, -1.0], [0.5, 0.0, 0.0]
    s.run(1.0)
    assert s.core.helms[0].held
    s.say(0, mavlink.MAVLink_extended_sys_state_message(0, 0))
    s.core.step(s.now + 0.001)
    assert s.core.helms[0].held and s.core.flying.all()


def test_one_that_never_says_whether_it_flies_is_told_as_not_watched_once() -> None:
    s = Scene()
    s.speaks[0] = False
    main, sub = mode_numbers("OFFBOARD")
    for _ in range(50):
        s.say(0, mavlink.MAVLink_heartbeat_message(2, 12, 128, main << 16 | sub << 24, 4, 3))
        s.run(0.1)
    assert len([e for e in s.events if "NOT WATCHED" in e]) == 1 and not s.sent
    s.speaks[0] = True
    s.run(1.0)
    assert len([e for e in s.events if "NOT WATCHED" in e]) == 1


def test_one_whose_captured_times_stand_still_is_told_as_not_stopped_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    s = Scene()
    see = s.core.see
    monkeypatch.setattr(s.core, "see", lambda frames, now: see([replace(f, time_s=5.0) for f in frames], now))
    s.run(5.0)
    assert len([e for e in s.events if "NOT be stopped" in e]) == 1
    monkeypatch.undo()
    s.run(1.0)
    monkeypatch.setattr(s.core, "see", lambda frames, now: see([replace(f, time_s=5.0) for f in frames], now))
    s.run(5.0)
    assert len([e for e in s.events if "NOT be stopped" in e]) == 2


def _obeying(s: Scene, seconds: float) -> None:
    """Every order is obeyed at once."""
    for _ in range(round(seconds / 0.1)):
        s.run(0.1)
        s.mode = [(s.commands(i) or ["OFFBOARD"])[-1] for i in range(len(s.mode))]


def test_with_terminate_allowed_one_that_comes_down_beyond_the_fence_is_let_down() -> None:
    s = Scene(1, {"at_most": "terminate"})
    s.p[0] = [6.05, 0.0, -2.0]
    _obeying(s, 2.5)
    s.v[0] = [0.05, 0.0, 0.4]
    _obeying(s, 4.0)
    assert s.commands() == ["AUTO.LOITER", "AUTO.LAND"]


def test_with_terminate_allowed_one_that_flies_on_beyond_the_fence_is_ended() -> None:
    s = Scene(1, {"at_most": "terminate"})
    s.p[0], s.v[0] = [5.0, 0.0, -2.0], [1.0, 0.0, 0.0]
    for _ in range(60):
        s.run(0.1)
        s.mode[0] = {"terminate": "AUTO.LAND"}.get(
            (s.commands() or ["OFFBOARD"])[-1], (s.commands() or ["OFFBOARD"])[-1]
        )
    assert s.commands() == ["AUTO.LOITER", "AUTO.LAND", "terminate"]


def test_with_terminate_allowed_two_that_land_side_by_side_are_let_down() -> None:
    s = Scene(2, {"at_most": "terminate"})
    s.p[1] = s.p[0] + [0.7, 0.0, 0.0]
    _obeying(s, 8.0)
    assert s.commands(1) == ["AUTO.LOITER", "AUTO.LAND"] and "terminate" not in s.commands(0)


def test_a_new_arming_begins_without_the_heartbeats_of_the_last() -> None:
    scene = Scene()
    scene.beats[0] = True
    scene.run(1.0)
    scene.beats[0], scene.armed[0], scene.landed[0] = False, False, True
    scene.run(1.0)
    scene.armed[0], scene.landed[0] = True, False
    scene.run(3.0)
    assert scene.sent == []


def test_a_leaning_vehicle_lands() -> None:
    scene = Scene()
    scene.turn[0] = tilted(70.0)
    scene.run(0.5)
    assert scene.commands() == ["AUTO.LAND"]


def test_a_vehicle_that_falls_silent_is_watched_by_the_cameras_and_its_silence_is_told_once() -> None:
    scene = Scene()
    scene.run(1.0)
    scene.speaks[0] = False
    scene.run(5.0)
    assert len(scene.events) == 1 and "not heard for 3 s" in scene.events[0] and scene.sent == []
    scene.v[0] = (2.0, 0.0, 0.0)
    scene.run(2.6)
    assert scene.commands()[0] == "AUTO.LOITER"
    scene.speaks[0] = True
    scene.run(0.1)
    assert any("heard again" in e for e in scene.events)


def test_two_that_are_commanded_to_one_place_are_told_who_yields_once() -> None:
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


def test_a_refusal_is_told_once_and_tried_on() -> None:
    scene = Scene()
    scene.battery[0] = 5
    for _ in range(20):
        scene.run(0.1)
        scene.say(0, mavlink.MAVLink_command_ack_message(mavlink.MAV_CMD_DO_SET_MODE, 2, 0, 0, 251, 190))
    assert [e for e in scene.events if "refused" in e] == ["uav1: an order was refused: denied; trying on"]
    assert len(scene.sent) > 10


def test_what_is_heard_is_what_pymavlink_says() -> None:
    known, codec = Known([7]), Codec(7, 1)
    known.hear(0, codec.pack(mavlink.MAVLink_local_position_ned_message(5, 1.5, -2.5, 0.0, 9, 9, 9)), 1.0)
    known.hear(
        0, codec.pack(mavlink.MAVLink_sys_status_message(1, 2, 3, 4, 5, 6, 55, 8, 9, 10, 11, 12, 13)), 2.0
    )
    known.hear(
        0,
        codec.pack(mavlink.MAVLink_position_target_local_ned_message(5, 1, 0, 3.0, 4.0, -5.0, *[0.0] * 8)),
        3.0,
    )
    assert known.estimate[0].tolist() == [1.5, -2.5, 0.0] and known.battery[0] == 0.55
    assert known.target[0].tolist() == [3.0, 4.0, -5.0]
    known.hear(
        0,
        codec.pack(mavlink.MAVLink_position_target_local_ned_message(5, 1, 7, 3.0, 4.0, -5.0, *[0.0] * 8)),
        4.0,
    )
    assert np.isnan(known.target[0]).all() and np.isinf(known.target_since[0])


def test_a_vehicle_is_heard_on_its_own_tools_port_alone_and_a_program_anywhere() -> None:
    known = Known([1, 2])
    beat = mavlink.MAVLink_heartbeat_message(2, 12, 128, 6 << 16, 4, 3)
    known.hear(1, Codec(1, 1).pack(beat), 1.0)
    known.hear(None, Codec(1, 1).pack(beat), 1.0)
    assert known.armed == [None, None]
    known.hear(None, Codec(2, 191).pack(beat), 1.0)
    assert known.beat_at.tolist() == [-np.inf, 1.0]
    known.hear(None, Codec(9, 191).pack(beat), 1.0)
    known.hear(None, b"\xfd\x00garbage", 1.0)
    assert known.counts["garbled"] == 1
