"""Who may command a real vehicle, at its link: router link and panic link."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.authority import CommandGate
from arena.process_context import SUPERVISOR_LOST
from arena.wire.mavlink_codec import Codec
from arena.wire.px4_mode import mode_numbers

from .link_rig import ID, Rig, arm, rc_channels

PROGRAM, LAND_ALL, COPILOT, GROUND_STATION = Codec(ID, 191), Codec(253, 195), Codec(251, 190), Codec(255, 190)


def set_mode(mode: str) -> Any:
    return mavlink.MAVLink_command_long_message(ID, 1, 176, 0, 1, *mode_numbers(mode), 0, 0, 0, 0)


def kill() -> Any:
    return arm(param1=0.0, magic=21196.0)


def setpoint() -> Any:
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, ID, 1, 1, 3576, 0, 0, -1, 0, 0, 0, 0, 0, 0, 0, 0
    )


def reports(rig: Rig, mode: str, *, armed: bool = True) -> None:
    """Send a heartbeat of the vehicle."""
    main, sub = mode_numbers(mode)
    flags = 1 | (128 if armed else 0)
    rig.receive(mavlink.MAVLink_heartbeat_message(2, 12, flags, main << 16 | sub << 24, 4, 3))


def sent_by(rig: Rig, codec: Codec, message: Any, link: str = "router") -> bool:
    """Return whether a message that is sent on a link reaches the vehicle."""
    rig.now += 0.02
    before = len(rig.out)
    rig.send(link, message, codec=codec)
    return len(rig.out) > before


def in_offboard(*, radio: bool = True) -> Rig:
    """Return a link whose vehicle is flown by its program. radio: a pilot may have a radio; its checks are left out."""
    rig = Rig()
    rig.core.gate = CommandGate("uav7", ID, simulated=False, radio=radio)
    rig.fly(2.0)
    assert sent_by(rig, PROGRAM, set_mode("OFFBOARD")) and sent_by(rig, PROGRAM, arm())
    reports(rig, "OFFBOARD")
    rig.core.events()
    return rig


def taken_by_pilot() -> Rig:
    rig = in_offboard()
    reports(rig, "POSCTL")
    return rig


@pytest.mark.parametrize(
    ("link", "codec"), [("panic", LAND_ALL), ("router", LAND_ALL), ("panic", COPILOT), ("router", PROGRAM)]
)
@pytest.mark.parametrize("message", [set_mode("AUTO.LAND"), set_mode("OFFBOARD"), arm(), kill()])
def test_no_automatic_command_reaches_a_vehicle_of_its_pilot(link, codec, message):  # review fault 5
    rig = taken_by_pilot()
    assert not sent_by(rig, codec, message, link)
    (ack,) = rig.received(link, "COMMAND_ACK")
    assert (ack.command, ack.result) == (message.command, mavlink.MAV_RESULT_DENIED)
    assert (ack.get_srcSystem(), ack.get_srcComponent()) == (ID, 1)
    assert [t.text for t in rig.received(link, "STATUSTEXT")] == ["pilot has control"]


def test_takeover_by_the_pilot_is_reported_once_with_the_mode():
    rig = in_offboard()
    for _ in range(3):
        reports(rig, "POSCTL")
    assert rig.core.events() == ["uav7: pilot has control: POSCTL"]


def test_land_all_reaches_the_vehicle_when_no_pilot_has_control():
    rig = in_offboard()
    assert sent_by(rig, LAND_ALL, set_mode("AUTO.LAND"), "panic")


def test_pilot_who_leaves_a_landing_of_land_all_keeps_the_vehicle():  # review fault 5
    rig = in_offboard()
    assert sent_by(rig, LAND_ALL, set_mode("AUTO.LAND"), "panic")
    reports(rig, "AUTO.LAND")
    reports(rig, "POSCTL")
    assert not sent_by(rig, LAND_ALL, set_mode("AUTO.LAND"), "panic")


def test_program_cannot_fly_after_land_all_until_release():
    rig = in_offboard()
    assert sent_by(rig, LAND_ALL, set_mode("AUTO.LAND"), "panic")
    reports(rig, "AUTO.LAND")
    assert not sent_by(rig, PROGRAM, set_mode("OFFBOARD"))
    reports(rig, "AUTO.LAND", armed=False)
    assert not sent_by(rig, PROGRAM, arm()) and not sent_by(rig, PROGRAM, setpoint())
    rig.core.gate.on_request({"do": "release", "vehicle": "uav7", "by": "ada"}, rig.now)
    rig.fly(2.0)
    assert sent_by(rig, PROGRAM, arm())
    assert "uav7: released by ada" in rig.core.events()


def test_program_cannot_retake_offboard_from_the_pilot():  # review fault 9
    rig = taken_by_pilot()
    reports(rig, "AUTO.LOITER")
    assert not sent_by(rig, PROGRAM, set_mode("OFFBOARD"))
    assert rig.received("router", "STATUSTEXT")[-1].text == "pilot took control: run `arena release`"


def test_nobody_arms_the_vehicle_once_the_run_ends():  # review fault 6
    rig = Rig()
    rig.fly(2.0)
    rig.core.gate.on_request({"do": "refuse_arming", "why": "the run is ending"}, rig.now)
    for codec, link in ((PROGRAM, "router"), (GROUND_STATION, "router"), (LAND_ALL, "panic")):
        assert not sent_by(rig, codec, arm(), link)
    stick = mavlink.MAVLink_manual_control_message(ID, 0, 0, 0, 1000, 0)
    assert not sent_by(rig, GROUND_STATION, stick)  # a stick gesture arms, too
    assert sent_by(rig, LAND_ALL, set_mode("AUTO.LAND"), "panic")


def test_nobody_arms_the_vehicle_once_the_supervisor_has_ended():  # review fault 6
    rig = Rig()
    rig.fly(2.0)
    rig.core.gate.on_request(SUPERVISOR_LOST, rig.now)
    assert not sent_by(rig, PROGRAM, arm())
    assert rig.received("router", "STATUSTEXT")[-1].text == "arming refused: the supervisor has ended"


def test_arming_that_a_preflight_check_refused_is_not_attributed_to_the_program():  # review fault 5
    rig = Rig()
    rig.core.gate = CommandGate("uav7", ID, simulated=False)
    reports(rig, "POSCTL", armed=False)
    assert not sent_by(rig, PROGRAM, arm())  # no poses yet
    reports(rig, "POSCTL")  # the pilot arms by radio
    assert not sent_by(rig, PROGRAM, set_mode("OFFBOARD"))


def test_refused_setpoints_have_no_reply():
    rig = in_offboard()
    sent_by(rig, LAND_ALL, set_mode("AUTO.LAND"), "panic")
    assert not sent_by(rig, PROGRAM, setpoint())
    assert not rig.received("router", "STATUSTEXT")


def test_arming_after_land_all_is_denied_also_while_a_preflight_check_fails():
    rig = in_offboard()
    assert sent_by(rig, LAND_ALL, set_mode("AUTO.LAND"), "panic")
    reports(rig, "AUTO.LAND", armed=False)
    rig.fly(2.0, poses=False)
    assert rig.reasons() and not sent_by(rig, PROGRAM, arm())
    assert (
        rig.received("router", "COMMAND_ACK")[-1].result == mavlink.MAV_RESULT_DENIED
    )  # not requested again
    assert rig.received("router", "STATUSTEXT")[-1].text == "land-all has control: run `arena release`"


def test_arming_before_enough_poses_is_rejected_temporarily_then_passes():
    rig = Rig()
    rig.fly(0.5)
    assert rig.reasons() == ["Preflight: 25 poses/s, needs 40"] and not sent_by(rig, PROGRAM, arm())
    (ack,) = rig.received("router", "COMMAND_ACK")
    assert ack.result == mavlink.MAV_RESULT_TEMPORARILY_REJECTED  # the program requests it again
    rig.fly(1.0)
    assert sent_by(rig, PROGRAM, arm())


def test_without_radio_only_stick_positions_are_a_pilot():
    rig = in_offboard(radio=False)
    reports(rig, "POSCTL")
    assert sent_by(rig, LAND_ALL, set_mode("AUTO.LAND"), "panic")
    rig.receive(rc_channels())  # a transmitter, although the YAML has `radio: none`
    assert not sent_by(rig, LAND_ALL, set_mode("AUTO.LAND"), "panic")


def test_joystick_of_a_ground_station_without_radio_is_a_pilot():
    rig = in_offboard(radio=False)
    reports(rig, "POSCTL")
    stick = mavlink.MAVLink_manual_control_message(ID, 0, 0, 500, 0, 0)
    assert sent_by(rig, GROUND_STATION, stick)
    assert not sent_by(rig, LAND_ALL, set_mode("AUTO.LAND"), "panic")
