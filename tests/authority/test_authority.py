"""Authority over a vehicle: priority, latches, takeover by the pilot, arming refused at the end of a run."""

from __future__ import annotations

import json

import pytest

from arena.authority import Authority, Kind, Request, Role

ARM, DISARM, KILL, SPIN = (Request(k) for k in (Kind.ARM, Kind.DISARM, Kind.KILL, Kind.SPIN))
SETPOINT = Request(Kind.SETPOINT)
AUTOMATIC = (Role.PROGRAM, Role.COPILOT, Role.EMERGENCY)


def mode(name: str) -> Request:
    return Request(Kind.MODE, name)


OFFBOARD, LAND, HOLD, POSCTL = (mode(m) for m in ("OFFBOARD", "AUTO.LAND", "AUTO.LOITER", "POSCTL"))


def in_offboard(*, simulated: bool = False) -> Authority:
    """Return the authority over a vehicle that its program flies in OFFBOARD."""
    a = Authority(simulated=simulated)
    assert a.refusal(Role.PROGRAM, OFFBOARD, 0.0) == "" and a.refusal(Role.PROGRAM, ARM, 0.0) == ""
    a.on_state(True, "OFFBOARD", 0.5)
    assert a.holder is Role.PROGRAM
    return a


def taken_by_pilot(*, simulated: bool = False) -> Authority:
    a = in_offboard(simulated=simulated)
    a.on_state(True, "POSCTL", 10.0)
    assert a.holder is Role.PILOT
    return a


def landed_by(role: Role) -> Authority:
    a = in_offboard()
    assert a.refusal(role, LAND, 10.0) == ""
    a.on_state(True, "AUTO.LAND", 10.5)
    assert a.holder is role and a.latched
    return a


@pytest.mark.parametrize("role", AUTOMATIC)
@pytest.mark.parametrize("request_", [ARM, KILL, LAND, HOLD, OFFBOARD, DISARM])
def test_no_automatic_command_passes_after_the_pilot_took_over(role, request_):  # review fault 5
    assert taken_by_pilot().refusal(role, request_, 11.0) == "pilot has control"


def test_ground_station_commands_pass_while_the_pilot_has_control():
    assert taken_by_pilot().refusal(Role.GROUND_STATION, LAND, 11.0) == ""


def test_pilot_who_leaves_a_landing_of_land_all_has_control():  # review fault 5
    a = landed_by(Role.EMERGENCY)
    a.on_state(True, "ALTCTL", 12.0)
    assert a.holder is Role.PILOT and a.refusal(Role.EMERGENCY, LAND, 12.1) == "pilot has control"


def test_manual_mode_by_a_ground_station_after_an_obeyed_landing_is_the_pilot():
    a = landed_by(Role.EMERGENCY)
    assert a.refusal(Role.GROUND_STATION, POSCTL, 11.0) == ""
    a.on_state(True, "POSCTL", 11.5)
    assert a.holder is Role.PILOT


def test_simulated_vehicle_obeys_land_all_in_a_manual_mode():
    assert taken_by_pilot(simulated=True).refusal(Role.EMERGENCY, LAND, 11.0) == ""


def test_pilot_loses_control_when_the_mode_is_not_manual_any_more():
    a = taken_by_pilot()
    a.on_state(True, "AUTO.RTL", 20.0)  # RC lost: land-all must reach the vehicle
    assert a.holder is Role.NOBODY and a.refusal(Role.EMERGENCY, LAND, 20.1) == ""


@pytest.mark.parametrize("simulated", [True, False])
def test_setpoints_do_not_take_a_vehicle_out_of_its_failsafe(simulated):
    """PX4 v1.16 enters OFFBOARD again without a command when setpoints arrive after the failsafe of their loss."""
    a = in_offboard(simulated=simulated)
    a.on_state(True, "AUTO.LAND", 10.0)
    assert not a.passes_program_setpoint(10.1)
    assert a.refusal(Role.PROGRAM, SETPOINT, 10.1) == "AUTO.LAND ended OFFBOARD: run `arena release`"
    a.on_state(
        True, "OFFBOARD", 11.0
    )  # because of a setpoint before the report of AUTO.LAND: no switch of a pilot
    assert a.refusal(Role.PROGRAM, SETPOINT, 11.1) and a.refusal(Role.PROGRAM, OFFBOARD, 11.1)
    b = Authority(simulated=simulated)
    b.restore(json.loads(json.dumps(a.standing)), 12.0)
    assert b.refusal(Role.PROGRAM, SETPOINT, 12.1)
    a.release("ada", 13.0)
    assert a.passes_program_setpoint(13.1) and a.refusal(Role.PROGRAM, OFFBOARD, 13.1) == ""


def test_setpoints_pass_after_a_failsafe_while_a_pilot_has_control():
    a = in_offboard()
    a.on_state(True, "AUTO.LAND", 10.0)
    a.on_state(True, "POSCTL", 11.0)
    assert a.holder is Role.PILOT and a.refusal(Role.PROGRAM, SETPOINT, 11.1) == ""
    a.on_state(True, "OFFBOARD", 12.0)
    assert a.holder is Role.PROGRAM and a.blocked == ""


@pytest.mark.parametrize("request_", [HOLD, POSCTL])
def test_setpoints_pass_after_a_failsafe_if_a_ground_station_commands_a_mode(request_):
    a = in_offboard()
    a.on_state(True, "AUTO.LAND", 10.0)
    assert a.refusal(Role.GROUND_STATION, request_, 11.0) == ""
    a.on_state(True, request_.mode, 11.5)
    assert a.refusal(Role.PROGRAM, SETPOINT, 11.6) == "" and a.refusal(Role.PROGRAM, OFFBOARD, 11.6)


def test_setpoints_pass_after_a_failsafe_of_a_simulated_vehicle_that_has_landed():
    a = in_offboard(simulated=True)
    a.on_state(True, "AUTO.LAND", 10.0)
    a.on_state(False, "AUTO.LAND", 15.0)
    assert a.passes_program_setpoint(15.1) and a.refusal(Role.PROGRAM, OFFBOARD, 15.1) == ""


def test_program_gets_control_back_by_the_pilots_switch_only():  # review fault 9
    a = taken_by_pilot()
    assert a.refusal(Role.PROGRAM, SETPOINT, 11.0) == ""
    a.on_state(True, "AUTO.LOITER", 12.0)
    assert a.refusal(Role.PROGRAM, OFFBOARD, 12.1) == "pilot took control: run `arena release`"
    a.on_state(True, "POSCTL", 13.0)
    a.on_state(True, "OFFBOARD", 14.0)
    assert a.holder is Role.PROGRAM and a.refusal(Role.PROGRAM, OFFBOARD, 14.1) == ""


def test_program_cannot_arm_again_after_a_takeover_and_a_landing():  # review fault 9
    a = taken_by_pilot()
    a.on_state(False, "POSCTL", 30.0)
    assert a.refusal(Role.PROGRAM, ARM, 31.0) and a.refusal(Role.PROGRAM, OFFBOARD, 31.0)
    a.release("the operator", 32.0)
    assert a.refusal(Role.PROGRAM, ARM, 33.0) == "" and a.refusal(Role.PROGRAM, OFFBOARD, 33.0) == ""


def test_mode_change_of_a_ground_station_takes_offboard_from_programs():  # review fault 9
    a = in_offboard()
    assert a.refusal(Role.GROUND_STATION, HOLD, 5.0) == ""
    a.on_state(True, "AUTO.LOITER", 5.5)
    assert a.refusal(Role.PROGRAM, OFFBOARD, 6.0) == "ground station took control: run `arena release`"


@pytest.mark.parametrize(("simulated", "after_landing"), [(False, False), (True, True)])
def test_program_that_lost_offboard_to_a_failsafe(simulated, after_landing):
    a = in_offboard(simulated=simulated)
    a.on_state(True, "AUTO.LAND", 5.0)
    assert a.refusal(Role.PROGRAM, OFFBOARD, 5.1)
    a.on_state(False, "AUTO.LAND", 9.0)
    assert (a.refusal(Role.PROGRAM, OFFBOARD, 10.0) == "") is after_landing


def test_program_may_leave_and_enter_offboard_by_itself():
    a = in_offboard()
    assert a.refusal(Role.PROGRAM, HOLD, 5.0) == ""
    a.on_state(True, "AUTO.LOITER", 5.5)
    assert a.refusal(Role.PROGRAM, OFFBOARD, 9.0) == ""


@pytest.mark.parametrize("by", [Role.EMERGENCY, Role.COPILOT])
@pytest.mark.parametrize("role", [Role.PROGRAM, Role.GROUND_STATION])
def test_landing_is_latched_until_release(by, role):
    a = landed_by(by)
    a.on_state(False, "AUTO.LAND", 20.0)
    for request in (ARM, OFFBOARD, SPIN, SETPOINT, HOLD):
        assert a.refusal(role, request, 21.0) == f"{by.words} has control: run `arena release`"
    for request in (LAND, DISARM, KILL):
        assert a.refusal(role, request, 21.0) == ""
    a.release("the operator", 22.0)
    assert a.refusal(role, ARM, 23.0) == ""


def test_copilot_cannot_weaken_a_landing_of_land_all():
    a = landed_by(Role.EMERGENCY)
    assert a.refusal(Role.COPILOT, HOLD, 11.0) and a.refusal(Role.COPILOT, LAND, 11.0) == ""


def test_land_all_commands_a_vehicle_that_the_copilot_has_landed():
    a = landed_by(Role.COPILOT)
    assert a.refusal(Role.EMERGENCY, LAND, 11.0) == ""
    assert a.refusal(Role.COPILOT, HOLD, 11.1) == "land-all has control: run `arena release`"


def test_kill_all_after_land_all_needs_no_release():
    assert landed_by(Role.EMERGENCY).refusal(Role.EMERGENCY, KILL, 11.0) == ""


def test_program_cannot_fly_on_while_the_copilot_repeats_hold():
    a = in_offboard()
    assert a.refusal(Role.COPILOT, HOLD, 5.0) == ""
    assert a.refusal(Role.PROGRAM, OFFBOARD, 5.9) == "copilot holds the vehicle"
    assert a.refusal(Role.PROGRAM, LAND, 5.9) == ""
    a.on_state(True, "AUTO.LOITER", 5.5)
    assert a.refusal(Role.PROGRAM, OFFBOARD, 6.1) == ""


def test_setpoints_of_a_ground_station_wait_for_the_programs():
    a = in_offboard()
    assert a.refusal(Role.PROGRAM, SETPOINT, 5.0) == ""
    assert a.refusal(Role.GROUND_STATION, SETPOINT, 5.5) == "a program sends setpoints"
    assert a.refusal(Role.GROUND_STATION, SETPOINT, 6.1) == ""


@pytest.mark.parametrize("role", [Role.GROUND_STATION, *AUTOMATIC])
def test_nobody_can_arm_once_the_run_ends(role):  # review fault 6
    a = Authority(simulated=False)
    a.refuse_arming("the run is ending")
    assert a.refusal(role, ARM, 1.0) == "arming refused: the run is ending"
    assert a.refusal(role, SPIN, 1.0) and a.refusal(role, LAND, 1.0) == ""


def test_landing_passes_while_the_run_ends():
    a = in_offboard()
    a.refuse_arming("the run is ending")
    assert a.refusal(Role.PROGRAM, SETPOINT, 5.0) == "" and a.refusal(Role.EMERGENCY, LAND, 5.0) == ""


def test_armed_vehicle_in_a_manual_mode_at_the_start_belongs_to_the_pilot():
    a = Authority(simulated=False)
    a.on_state(True, "POSCTL", 0.0)
    assert a.holder is Role.PILOT


def test_program_that_arms_in_a_manual_mode_is_not_the_pilot():
    a = Authority(simulated=False)
    a.on_state(False, "POSCTL", 0.0)
    assert a.refusal(Role.PROGRAM, ARM, 1.0) == ""
    a.on_state(True, "POSCTL", 1.5)
    assert a.holder is Role.PROGRAM and a.refusal(Role.PROGRAM, OFFBOARD, 2.0) == ""


def test_every_change_says_who_why_and_when():
    a = landed_by(Role.EMERGENCY)
    a.release("the operator", 30.0)
    said = [(str(c), c.at) for c in a.take_changes()]
    assert said == [
        ("program has control: OFFBOARD commanded", 0.5),
        ("land-all has control: landing, until `arena release`", 10.0),
        ("released by the operator", 30.0),
    ]
    assert a.take_changes() == []


def test_every_refusal_fits_in_one_statustext():
    a = in_offboard()
    a.on_state(True, "AUTO.FOLLOW_TARGET", 5.0)
    assert 0 < len(a.refusal(Role.PROGRAM, OFFBOARD, 6.0).encode()) <= 50
    a.refuse_arming("a reason that is much longer than one STATUSTEXT can hold")
    a.on_state(False, "AUTO.LOITER", 7.0)
    assert len(a.refusal(Role.PROGRAM, ARM, 8.0).encode()) <= 50


def restarted(before: Authority) -> Authority:
    """Return the authority of a process that starts again, after it has received the standing state."""
    a = Authority(simulated=False)
    a.restore(json.loads(json.dumps(before.standing)), 100.0)
    return a


@pytest.mark.parametrize("role", [Role.EMERGENCY, Role.COPILOT])
def test_landing_stays_latched_after_a_restart_until_release(role):
    a = restarted(landed_by(role))
    assert a.refusal(Role.PROGRAM, ARM, 101.0) == f"{role.words} has control: run `arena release`"
    a.on_state(False, "AUTO.LAND", 102.0)
    assert a.refusal(Role.PROGRAM, ARM, 103.0) and a.holder is role
    a.release("ada", 104.0)
    assert a.standing == {} and a.refusal(Role.PROGRAM, ARM, 105.0) == ""


def test_weaker_standing_state_does_not_replace_a_stronger_latch():
    a = landed_by(Role.EMERGENCY)
    a.restore(landed_by(Role.COPILOT).standing, 20.0)
    assert a.standing == {"latch": [int(Role.EMERGENCY), 3]}


def test_pilot_keeps_control_when_a_landing_is_restored():
    a = taken_by_pilot()
    a.restore({"latch": [int(Role.EMERGENCY), 3]}, 20.0)
    assert a.holder is Role.PILOT and a.latched
    words = "pilot keeps control; a landing is latched until `arena release`"
    assert str(a.take_changes()[-1]) == f"pilot has control: {words}"
    assert a.refusal(Role.EMERGENCY, LAND, 21.0) == "pilot has control"


def test_program_cannot_retake_offboard_after_a_restart():
    before = taken_by_pilot()
    before.on_state(True, "AUTO.LOITER", 12.0)
    assert (
        restarted(before).refusal(Role.PROGRAM, OFFBOARD, 101.0) == "pilot took control: run `arena release`"
    )


def test_pilot_keeps_control_after_a_restart_until_the_mode_is_known():
    a = restarted(taken_by_pilot())
    assert a.refusal(Role.EMERGENCY, LAND, 101.0) == "pilot has control"
    a.on_state(True, "POSCTL", 101.5)
    assert a.refusal(Role.EMERGENCY, LAND, 102.0) == "pilot has control"
    a.on_state(True, "AUTO.LOITER", 103.0)
    assert a.refusal(Role.EMERGENCY, LAND, 104.0) == ""


def test_pilot_who_disarmed_during_a_restart_has_no_control():
    a = restarted(taken_by_pilot())
    a.on_state(False, "POSCTL", 101.0)
    assert a.holder is Role.NOBODY


def test_failsafe_is_forgotten_if_the_vehicle_disarmed_during_a_restart():
    before = in_offboard(simulated=True)
    before.on_state(True, "AUTO.LAND", 5.0)
    a = restarted(before)
    assert a.refusal(Role.PROGRAM, ARM, 101.0) == "AUTO.LAND ended OFFBOARD: run `arena release`"
    a.on_state(False, "AUTO.LAND", 102.0)
    assert a.refusal(Role.PROGRAM, ARM, 103.0) == ""


STICKS = Request(Kind.MANUAL_INPUT)


def without_radio() -> Authority:
    """Return the authority over a vehicle with `radio: none` that its program flies in OFFBOARD."""
    a = Authority(simulated=False, radio=False)
    assert a.refusal(Role.PROGRAM, OFFBOARD, 0.0) == "" and a.refusal(Role.PROGRAM, ARM, 0.0) == ""
    a.on_state(True, "OFFBOARD", 0.5)
    return a


def test_land_all_continues_in_a_manual_mode_without_a_pilot():
    a = without_radio()
    a.on_state(True, "POSCTL", 10.0)  # a failsafe
    assert a.holder is Role.NOBODY and a.refusal(Role.EMERGENCY, LAND, 10.1) == ""
    a.on_state(True, "AUTO.LAND", 10.5)
    a.on_state(True, "STABILIZED", 11.0)
    assert a.refusal(Role.EMERGENCY, LAND, 11.1) == "" and a.holder is Role.EMERGENCY
    assert a.refusal(Role.PROGRAM, OFFBOARD, 11.2) == "land-all has control: run `arena release`"


def test_program_cannot_retake_offboard_after_a_manual_mode_without_a_pilot():
    a = without_radio()
    a.on_state(True, "POSCTL", 10.0)
    assert a.refusal(Role.PROGRAM, OFFBOARD, 10.1) == "POSCTL ended OFFBOARD: run `arena release`"


@pytest.mark.parametrize("before", [True, False], ids=["before the mode", "after the mode"])
def test_stick_positions_show_that_a_pilot_has_control_without_radio(before):
    a = without_radio()
    if before:
        a.on_manual_input(9.5)
    a.on_state(True, "POSCTL", 10.0)
    if not before:
        assert a.refusal(Role.GROUND_STATION, STICKS, 10.2) == ""
    assert a.holder is Role.PILOT and a.refusal(Role.EMERGENCY, LAND, 10.5) == "pilot has control"


def test_pilot_without_radio_loses_control_when_the_stick_positions_end():
    a = without_radio()
    a.on_manual_input(9.9)
    a.on_state(True, "POSCTL", 10.0)
    a.on_state(True, "POSCTL", 20.0)  # telemetry was lost meanwhile: the sticks may be back in a moment
    assert a.refusal(Role.EMERGENCY, LAND, 20.1) == "pilot has control"
    a.on_state(True, "POSCTL", 21.0)
    assert a.holder is Role.NOBODY and a.refusal(Role.EMERGENCY, LAND, 21.1) == ""


def test_stick_positions_of_a_program_are_not_a_pilot():
    a = without_radio()
    a.on_state(True, "POSCTL", 10.0)
    a.refusal(Role.PROGRAM, STICKS, 10.1)
    assert a.holder is Role.NOBODY


def test_manual_mode_of_a_ground_station_without_sticks_does_not_stop_land_all():
    a = without_radio()
    assert a.refusal(Role.EMERGENCY, LAND, 9.0) == ""
    a.on_state(True, "AUTO.LAND", 9.5)
    assert a.refusal(Role.GROUND_STATION, POSCTL, 10.0) == ""
    a.on_state(True, "POSCTL", 10.2)
    assert a.holder is Role.GROUND_STATION and a.refusal(Role.EMERGENCY, LAND, 10.3) == ""
    a.refusal(Role.GROUND_STATION, STICKS, 10.4)
    assert a.refusal(Role.EMERGENCY, LAND, 10.5) == "pilot has control"


@pytest.mark.parametrize("request_", [ARM, OFFBOARD, LAND, HOLD, DISARM, KILL])
def test_program_commands_nothing_while_a_person_flies_with_sticks(request_):
    a = Authority(simulated=True)
    assert (
        a.refusal(Role.GROUND_STATION, POSCTL, 0.0) == "" and a.refusal(Role.GROUND_STATION, ARM, 0.1) == ""
    )
    a.on_state(True, "POSCTL", 0.5)
    assert a.refusal(Role.GROUND_STATION, STICKS, 9.0) == ""
    assert a.refusal(Role.PROGRAM, request_, 10.9) == "a person flies with sticks"
    assert a.refusal(Role.PROGRAM, SETPOINT, 10.9) == "", "the person may hand back by switching to OFFBOARD"
    assert a.refusal(Role.EMERGENCY, LAND, 10.9) == ""
    a = Authority(simulated=True)
    a.on_state(True, "POSCTL", 0.5)
    assert a.refusal(Role.PROGRAM, STICKS, 9.0) == "pilot has control", (
        "a program's sticks are not a person's"
    )


def test_stick_gesture_cannot_arm_a_vehicle_whose_landing_is_latched():
    a = Authority(simulated=False)
    assert a.refusal(Role.EMERGENCY, LAND, 0.0) == ""
    assert a.refusal(Role.GROUND_STATION, STICKS, 0.1) == "", (
        "before the first heartbeat a person may be flying"
    )
    a.on_state(True, "AUTO.LAND", 0.5)
    assert a.refusal(Role.GROUND_STATION, STICKS, 1.0) == "", "a person may fly the landing by hand"
    a.on_state(False, "AUTO.LAND", 5.0)
    assert a.refusal(Role.GROUND_STATION, ARM, 5.1) == "land-all has control: run `arena release`"
    assert a.refusal(Role.GROUND_STATION, STICKS, 5.1) == "land-all has control: run `arena release`"
    a.release("ada", 6.0)
    assert a.refusal(Role.GROUND_STATION, STICKS, 6.1) == ""


def test_program_whose_vehicle_was_taken_cannot_arm_by_sticks():
    a = Authority(simulated=False)
    assert a.refusal(Role.PROGRAM, OFFBOARD, 0.0) == ""
    a.on_state(True, "OFFBOARD", 0.5)
    assert a.refusal(Role.GROUND_STATION, LAND, 1.0) == ""
    a.on_state(True, "AUTO.LAND", 1.5)
    a.on_state(False, "AUTO.LAND", 9.0)
    assert a.refusal(Role.PROGRAM, STICKS, 9.1) == a.refusal(Role.PROGRAM, ARM, 9.1) != ""
