"""Modes, arming and failsafes of the commander."""

from __future__ import annotations

import dataclasses

import pytest

from arena.autopilot.commander import Commander
from arena.autopilot.commander_inputs import CommanderInputs, CommanderParams
from arena.autopilot.flight_modes import Mode, mode_of
from arena.autopilot.manual_control import ManualControl, ManualInput
from arena.wire.sticks import CENTRED

OK = CommanderInputs(
    now=100.0,
    xy_valid=True,
    z_valid=True,
    yaw_valid=True,
    landed=True,
    flying=False,
    tilt_rad=0.0,
    battery=0.9,
    offboard_age=0.02,
    offboard_needs_position=True,
    gcs_age=0.1,
    aligned=True,
)
PARAMS = CommanderParams(
    com_of_loss_t=1.0,
    com_obl_rc_act=4,
    com_fail_act_t=0.0,
    com_disarm_land=2.0,
    com_disarm_prflt=10.0,
    com_low_bat_act=0,
    bat_low_thr=0.15,
    bat_crit_thr=0.07,
    bat_emergen_thr=0.05,
    nav_dll_act=0,
    com_dl_loss_t=10.0,
    cbrk_flightterm=121212,
    fd_fail_rad=1.05,
)


def inputs(*, manual_control=False, **changes) -> CommanderInputs:
    if manual_control:
        changes["manual"] = ManualInput(sticks=CENTRED)
    return dataclasses.replace(OK, **changes)


def params(**changes) -> CommanderParams:
    return dataclasses.replace(PARAMS, **changes)


def flying() -> tuple[Commander, dict]:
    c = Commander("uav1")
    assert c.request_mode(Mode.OFFBOARD, OK, PARAMS) == ""
    assert c.arm(OK, PARAMS) == ""
    up = {"landed": False, "flying": True}
    c.update(inputs(now=105.0, **up), PARAMS)
    return c, up


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"aligned": False}, "Attitude"),
        ({"xy_valid": False}, "position"),
        ({"z_valid": False}, "Height"),
        ({"yaw_valid": False}, "Heading"),
        ({"battery": 0.05}, "Battery"),
        ({"tilt_rad": 1.5}, "tilted"),
        ({"offboard_age": 2.0}, "offboard"),
    ],
)
def test_each_failed_check_refuses_arming_and_is_named(change, word):
    c = Commander("uav1", mode=Mode.OFFBOARD)
    why = c.arm(inputs(**change), PARAMS)
    assert word.lower() in why.lower()
    assert not c.armed


def test_arming_is_refused_in_landing_modes():
    for mode in (Mode.LAND, Mode.DESCEND, Mode.TERMINATE):
        c = Commander("uav1", mode=mode)
        assert c.arm(OK, PARAMS)
        assert not c.armed


@pytest.mark.parametrize(
    ("action", "mode"), [(0, Mode.LAND), (4, Mode.LAND), (5, Mode.HOLD), (6, Mode.TERMINATE)]
)
def test_offboard_loss_action(action, mode):
    c, up = flying()
    c.update(inputs(now=106.0, offboard_age=1.5, **up), params(com_obl_rc_act=action))
    assert c.mode is mode
    assert c.armed


def test_offboard_loss_action_disarm_disarms():
    c, up = flying()
    c.update(inputs(now=106.0, offboard_age=1.5, **up), params(com_obl_rc_act=7))
    assert not c.armed


def test_offboard_loss_acts_at_once_despite_com_fail_act_t():
    c, up = flying()
    c.update(inputs(now=106.0, offboard_age=1.5, **up), params(com_fail_act_t=5.0))
    assert c.mode is Mode.LAND


@pytest.mark.parametrize(
    ("what", "settings"),
    [
        ({"gcs_age": 20.0}, {"nav_dll_act": 3}),
        ({"battery": 0.04}, {"com_low_bat_act": 2}),
        ({"fence": "outside"}, {"gf_action": 5}),
    ],
)
def test_other_failsafes_hold_for_com_fail_act_t_while_a_pilot_may_take_over(what, settings):
    slow = params(com_fail_act_t=5.0, **settings)
    c, up = flying()
    c.update(inputs(now=106.0, **what, **up), slow)
    assert c.mode is Mode.HOLD
    c.update(inputs(now=110.9, **what, **up), slow)
    assert c.mode is Mode.HOLD
    c.update(inputs(now=111.1, **what, **up), slow)
    assert c.mode is Mode.LAND

    c, up = flying()
    c.update(inputs(now=106.0, **what, **up), slow)
    c.request_mode(Mode.OFFBOARD, inputs(now=107.0, **up), slow)
    c.update(inputs(now=112.0, **up), slow)
    assert c.mode is Mode.OFFBOARD, "the pilot took over"


def test_position_loss_is_a_failsafe_for_position_setpoints_only():
    c, up = flying()
    c.update(inputs(now=106.0, xy_valid=False, offboard_needs_position=False, **up), PARAMS)
    assert c.mode is Mode.OFFBOARD
    c.update(inputs(now=106.1, xy_valid=False, **up), PARAMS)
    assert c.mode is Mode.DESCEND


def test_data_link_loss_acts_only_if_configured():
    c, up = flying()
    c.update(inputs(now=120.0, gcs_age=20.0, **up), PARAMS)
    assert c.mode is Mode.OFFBOARD
    c.update(inputs(now=120.1, gcs_age=20.0, **up), params(nav_dll_act=3))
    assert c.mode is Mode.LAND


def test_arming_needs_a_data_link_if_its_loss_has_an_action():
    c = Commander("uav1")
    assert c.arm_checks(inputs(gcs_age=13.0), params(nav_dll_act=3)) == [
        "No connection to the ground control station"
    ]
    assert c.arm_checks(inputs(gcs_age=12.0), params(nav_dll_act=3)) == [], (
        "2.5 s without a heartbeat, then COM_DL_LOSS_T"
    )
    assert c.arm_checks(inputs(gcs_age=13.0), PARAMS) == []


def test_attitude_failure_terminates_only_with_the_breaker_open():
    c, up = flying()
    c.update(inputs(now=106.0, tilt_rad=1.3, **up), PARAMS)
    assert c.mode is Mode.OFFBOARD
    c.update(inputs(now=106.1, tilt_rad=1.3, **up), params(cbrk_flightterm=0, fd_fail_s=0.0))
    assert c.mode is Mode.TERMINATE


def test_landing_disarms_after_com_disarm_land_and_returns_to_hold():
    c, up = flying()
    c.request_mode(Mode.LAND, inputs(now=110.0, **up), PARAMS)
    c.update(inputs(now=112.0), PARAMS)
    assert c.armed
    c.update(inputs(now=114.1), PARAMS)
    assert not c.armed
    assert c.mode is Mode.HOLD


def test_custom_modes_are_px4s_numbers():
    assert Mode.OFFBOARD.custom_mode == 6 << 16
    assert Mode.LAND.custom_mode == 4 << 16 | 6 << 24
    assert Mode.DESCEND.custom_mode == Mode.LAND.custom_mode
    assert mode_of(4, 6) is Mode.LAND
    assert mode_of(6, 0) is Mode.OFFBOARD
    assert mode_of(9, 0) is None


def _radio_lost(mode=Mode.HOLD, had=True, **changes) -> Commander:
    """Return a commander in flight whose manual control was lost."""
    c, up = flying()
    c.request_mode(mode, inputs(now=105.0, **up), PARAMS)
    c.update(inputs(now=105.5, manual_control=had, **up), params(**changes))
    c.update(inputs(now=106.0, **up), params(**changes))
    return c


@pytest.mark.parametrize(
    ("action", "mode"),
    [(1, Mode.HOLD), (2, Mode.RTL), (3, Mode.LAND), (5, Mode.TERMINATE), (0, Mode.OFFBOARD)],
)
def test_lost_manual_control_runs_nav_rcl_act(action, mode):
    c = _radio_lost(Mode.OFFBOARD, nav_rcl_act=action)
    assert c.mode is mode and c.armed
    assert bool(c.failsafe) is (action != 0)


def test_lost_manual_control_can_disarm():
    assert not _radio_lost(nav_rcl_act=6).armed


@pytest.mark.parametrize(
    ("mode", "bits", "acts"),
    [
        (Mode.OFFBOARD, 4, False),
        (Mode.OFFBOARD, 3, True),
        (Mode.HOLD, 2, False),
        (Mode.HOLD, 5, True),
        (Mode.TAKEOFF, 2, False),
        (Mode.TAKEOFF, 5, True),
    ],
)
def test_com_rcl_except_applies_to_the_requested_mode(mode, bits, acts):
    c = _radio_lost(mode, nav_rcl_act=3, com_rcl_except=bits)
    assert (c.mode is Mode.LAND) is acts


def test_manual_control_never_received_or_disabled_is_not_missed():
    assert _radio_lost(had=False, nav_rcl_act=3).mode is Mode.HOLD
    assert _radio_lost(nav_rcl_act=3, com_rc_in_mode=4).mode is Mode.HOLD


def test_regained_manual_control_changes_nothing_and_may_be_lost_again():
    c = _radio_lost(Mode.OFFBOARD, nav_rcl_act=1)
    up = {"landed": False, "flying": True}
    c.update(inputs(now=107.0, manual_control=True, **up), params(nav_rcl_act=1))
    assert c.mode is Mode.HOLD
    c.request_mode(Mode.OFFBOARD, inputs(now=108.0, manual_control=True, **up), PARAMS)
    c.update(inputs(now=108.1, manual_control=True, **up), params(nav_rcl_act=1))
    assert c.mode is Mode.OFFBOARD
    c.update(inputs(now=109.0, **up), params(nav_rcl_act=1))
    assert c.mode is Mode.HOLD


def test_mode_selected_after_the_loss_of_manual_control_is_flown():
    c = _radio_lost(nav_rcl_act=3)
    up = {"landed": False, "flying": True}
    assert c.request_mode(Mode.HOLD, inputs(now=107.0, **up), PARAMS) == ""
    c.update(inputs(now=107.1, **up), params(nav_rcl_act=3))
    assert c.mode is Mode.HOLD


def test_lost_manual_control_holds_for_com_fail_act_t():
    c = _radio_lost(Mode.OFFBOARD, nav_rcl_act=3, com_fail_act_t=5.0)
    up = {"landed": False, "flying": True}
    assert c.mode is Mode.HOLD
    c.update(inputs(now=110.9, **up), params(nav_rcl_act=3, com_fail_act_t=5.0))
    assert c.mode is Mode.HOLD
    c.update(inputs(now=111.1, **up), params(nav_rcl_act=3, com_fail_act_t=5.0))
    assert c.mode is Mode.LAND


@pytest.mark.parametrize(
    ("action", "mode"), [(1, Mode.LAND), (2, Mode.LAND), (3, Mode.LAND), (5, Mode.TERMINATE)]
)
def test_lost_manual_control_does_not_stop_a_landing(action, mode):
    assert _radio_lost(Mode.LAND, nav_rcl_act=action).mode is mode


def test_more_severe_of_two_failsafes_acts():
    c, up = flying()
    now = {"offboard_age": 1.5, **up}
    c.update(inputs(now=106.0, manual_control=True, **now), params(com_obl_rc_act=5))
    assert c.mode is Mode.HOLD
    c.update(inputs(now=107.0, **now), params(com_obl_rc_act=5, nav_rcl_act=3))
    assert c.mode is Mode.LAND


@pytest.mark.parametrize("there", [True, False])
def test_offboard_loss_into_a_manual_mode_needs_manual_control_else_lands(there):
    for action, manual in enumerate((Mode.POSCTL, Mode.ALTCTL, Mode.STABILIZED)):
        mode = manual if there else Mode.LAND
        c, up = flying()
        c.update(
            inputs(now=106.0, offboard_age=1.5, manual_control=there, **up), params(com_obl_rc_act=action)
        )
        assert c.mode is mode


@pytest.mark.parametrize(
    ("in_mode", "first", "counted"),
    [
        (0, "radio", {"radio"}),
        (1, "radio", {"joystick"}),
        (2, "radio", {"radio", "joystick"}),
        (3, "radio", {"radio"}),
        (3, "joystick", {"joystick"}),
        (4, "radio", set()),
    ],
)
def test_com_rc_in_mode_selects_the_source_of_manual_control(in_mode, first, counted):
    for source in ("radio", "joystick"):
        pilot = ManualControl()
        pilot.receive(first, 1.0)
        assert not pilot.is_available(2.0, in_mode, 0.5)
        pilot.receive(source, 2.0)
        assert pilot.is_available(2.4, in_mode, 0.5) is (source in counted)
        assert not pilot.is_available(2.6, in_mode, 0.5)


def test_short_tilt_is_no_attitude_failure():
    c, up = flying()
    opened = params(cbrk_flightterm=0, fd_fail_s=0.3)
    for now, tilt in ((106.0, 1.3), (106.2, 1.3), (106.25, 0.2), (106.3, 1.3), (106.55, 1.3)):
        c.update(inputs(now=now, tilt_rad=tilt, **up), opened)
        assert c.mode is Mode.OFFBOARD
    c.update(inputs(now=106.65, tilt_rad=1.3, **up), opened)
    assert c.mode is Mode.TERMINATE and c.armed


def test_attitude_failure_after_arming_disarms_despite_the_breaker():
    c = Commander("uav1")
    begins = params(lockdown_s=4.0, fd_fail_s=0.3)
    assert c.arm(inputs(now=100.0), begins) == ""
    for now in (101.0, 101.2):
        c.update(inputs(now=now, tilt_rad=1.3), begins)
        assert c.armed
    c.update(inputs(now=101.35, tilt_rad=1.3), begins)
    assert not c.armed and any("attitude failure: disarming" in text for _, text in c.texts)


def test_attitude_failure_on_the_ground_is_ignored_after_the_lockdown_time():
    c = Commander("uav1")
    later = params(lockdown_s=4.0, fd_fail_s=0.0, com_disarm_prflt=-1.0, cbrk_flightterm=0)
    assert c.arm(inputs(now=100.0), later) == ""
    c.update(inputs(now=104.5, tilt_rad=1.3), later)
    assert c.armed and c.mode is Mode.HOLD


@pytest.mark.parametrize(
    ("least", "battery", "refused"),
    [(-1.0, 0.07, True), (-1.0, 0.08, False), (0.5, 0.49, True), (0.5, 0.51, False), (0.0, 0.05, False)],
)
def test_com_arm_bat_min_replaces_the_critical_charge(least, battery, refused):
    reasons = Commander("uav1").arm_checks(inputs(battery=battery), params(com_arm_bat_min=least))
    assert any("Battery too low" in reason for reason in reasons) is refused
