"""POSCTL, ALTCTL, STABILIZED and ACRO of the built-in autopilot, flown with MANUAL_CONTROL."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flight import Flight
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot import Autopilots

PARAMS = {"COM_RC_IN_MODE": 1, "NAV_RCL_ACT": 3, "MPC_VEL_MANUAL": 3.0}
POSCTL, ALTCTL, STABILIZED, ACRO, OFFBOARD = (3, 0), (2, 0), (7, 0), (5, 0), (6, 0)
ACCEPTED, REJECTED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_TEMPORARILY_REJECTED


def sticks(*, pitch=0.0, roll=0.0, throttle=0.0, yaw=0.0):
    """Return a function that sends these stick positions -1..1."""
    x, y, r = (round(1000 * value) for value in (pitch, roll, yaw))
    z = round(500 * (throttle + 1.0))
    return lambda f: f.send(0, mavlink.MAVLink_manual_control_message(1, x, y, z, r, 0))


CENTRE = sticks()


def set_mode(f, mode, each=CENTRE):
    """Request a mode while the sticks are sent, and return the acknowledgement."""
    each(f)
    f.run(0.04, each)
    result = f.command(0, mavlink.MAV_CMD_DO_SET_MODE, 1, *mode)
    f.run(0.04, each)
    return result


def by_hand(**params) -> Flight:
    """Return a flight that hovers in POSCTL, taken off with the throttle stick."""
    f = Flight(params={**PARAMS, **params})
    f.run(3.0)
    assert set_mode(f, POSCTL) == ACCEPTED
    assert f.arm(0) == ACCEPTED
    f.run(1.2, CENTRE)
    f.until(lambda f: f.position(0)[2] < -1.2, 15.0, sticks(throttle=0.8))
    f.run(3.0, CENTRE)
    return f


def velocity(f):
    return f.world.truth().v_n[0]


def test_pilot_takes_off_in_posctl_holds_and_lands_with_the_throttle_stick():
    f = by_hand()
    before = f.position(0).copy()
    f.run(3.0, CENTRE)
    assert np.linalg.norm(f.position(0) - before) < 0.05
    down = f.until(lambda f: f.position(0)[2] > -0.06, 6.0, sticks(throttle=-1.0))
    assert down > 1.0
    assert f.until(lambda f: not f.armed(0), 4.5, sticks(throttle=-1.0)) > 2.0, "COM_DISARM_LAND is 2 s"
    assert f.mode(0) == "POSCTL"


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_stick_to_the_right_flies_to_the_right_of_the_body(yaw):
    f = by_hand()
    turn = sticks(yaw=math.copysign(0.5, yaw))
    if yaw:
        f.until(lambda f: abs(f.pilots.vehicles[0].yaw() - yaw) < 0.2, 10.0, turn)
        f.run(2.0, CENTRE)
    heading = f.pilots.vehicles[0].yaw()
    f.run(6.0, sticks(roll=0.6))
    right = np.array([-math.sin(heading), math.cos(heading), 0.0])
    rest = (0.6 - 0.1) / 0.9
    wanted = PARAMS["MPC_VEL_MANUAL"] * (0.4 * rest + 0.6 * rest**3)
    assert velocity(f) @ right == pytest.approx(wanted, rel=0.1)
    assert np.linalg.norm(velocity(f) - wanted * right) < 0.15


def test_released_sticks_brake_and_hold_the_position():
    f = by_hand()
    f.run(3.0, sticks(pitch=1.0))
    assert velocity(f)[0] > 2.0
    f.run(3.0, CENTRE)
    stopped = f.position(0).copy()
    f.run(3.0, CENTRE)
    assert np.linalg.norm(f.position(0) - stopped) < 0.1
    assert np.linalg.norm(velocity(f)) < 0.05


def test_yaw_stick_to_the_right_turns_clockwise_and_the_heading_is_held():
    f = by_hand()
    f.run(1.0, sticks(yaw=0.5))
    assert f.world.truth().omega_b[0, 2] > 0.3
    f.run(3.0, CENTRE)
    heading = f.pilots.vehicles[0].yaw()
    f.run(3.0, CENTRE)
    assert abs(f.pilots.vehicles[0].yaw() - heading) < 0.02


def test_climb_rate_near_the_ground_is_limited():
    f = by_hand(MPC_Z_VEL_MAX_UP=3.0, MPC_TKO_SPEED=1.0)
    f.run(1.5, sticks(throttle=1.0))
    assert -velocity(f)[2] == pytest.approx(1.0, abs=0.15)


def test_limit_near_the_ground_does_not_slow_a_climb_below_it():
    f = by_hand(MPC_Z_VEL_MAX_UP=3.0, MPC_TKO_SPEED=1.0)
    f.run(1.5, sticks(throttle=0.6))
    throttle = (0.6 - 0.1) / 0.9  # MPC_HOLD_DZ 0.1
    asked = 3.0 * (0.4 * throttle + 0.6 * throttle**3)  # MPC_Z_MAN_EXPO 0.6
    assert -velocity(f)[2] == pytest.approx(asked, abs=0.1)


def test_altctl_holds_the_height_and_tilts_with_the_stick():
    f = by_hand()
    assert set_mode(f, ALTCTL) == ACCEPTED and f.mode(0) == "ALTCTL"
    height = f.position(0)[2]
    f.run(1.0, sticks(roll=0.3))
    tilt = math.acos(f.pilots.est.r_nb[0, 2, 2])
    assert tilt == pytest.approx(math.atan(0.3 * math.tan(math.radians(35))), abs=0.03)
    assert velocity(f)[1] > 0.7
    f.run(1.0, CENTRE)
    assert f.position(0)[2] == pytest.approx(height, abs=0.15)
    assert velocity(f)[1] > 0.3, "in ALTCTL nothing brakes"


@pytest.mark.parametrize(("pitch", "roll"), [(0.4, 0.0), (0.0, -0.4), (0.3, 0.3)])
def test_stabilized_tilts_towards_the_stick(pitch, roll):
    f = by_hand()
    assert set_mode(f, STABILIZED) == ACCEPTED and f.mode(0) == "STABILIZED"
    f.run(0.6, sticks(pitch=pitch, roll=roll))
    down = f.pilots.est.r_nb[0][:, 2]  # thrust is opposite to it
    angle = math.radians(35) * math.hypot(pitch, roll)
    assert math.acos(down[2]) == pytest.approx(angle, abs=0.04)
    assert -down[0] == pytest.approx(math.sin(angle) * pitch / math.hypot(pitch, roll), abs=0.05)
    assert -down[1] == pytest.approx(math.sin(angle) * roll / math.hypot(pitch, roll), abs=0.05)


def test_acro_turns_at_the_rate_of_the_stick():
    f = by_hand()
    assert set_mode(f, ACRO) == ACCEPTED
    f.run(0.3, sticks(roll=0.4, throttle=0.1))
    assert f.world.truth().omega_b[0, 0] == pytest.approx(math.radians(40), abs=0.08)
    assert f.world.truth().omega_b[0, 1] == pytest.approx(0.0, abs=0.08)


def test_throttle_in_stabilized_moves_the_thrust_around_hover():
    f = by_hand()
    set_mode(f, STABILIZED)
    f.run(0.5, CENTRE)
    hover = f.pilots.params["MPC_THR_HOVER"][0]
    assert f.pilots.thrust[0] == pytest.approx(hover, abs=0.01)
    f.run(0.3, sticks(throttle=0.5))
    assert f.pilots.thrust[0] == pytest.approx(hover + 0.5 * (1.0 - hover), abs=0.01)


def test_lost_sticks_land_the_vehicle():
    f = by_hand()
    f.run(0.4)
    assert f.mode(0) == "POSCTL", "COM_RC_LOSS_T is 0.5 s"
    f.run(0.3)
    assert f.mode(0) == "AUTO.LAND"
    f.until(lambda f: not f.armed(0), 15.0)
    assert f.position(0)[2] > -0.1


def test_deflected_stick_does_not_survive_its_loss():
    f = by_hand()
    f.run(2.0, sticks(roll=1.0))
    assert velocity(f)[1] > 2.0
    f.run(3.5)
    assert abs(velocity(f)[1]) < 0.3


@pytest.mark.parametrize("mode", [POSCTL, ALTCTL, STABILIZED, ACRO])
def test_manual_mode_is_refused_in_the_air_without_sticks(mode):
    f = by_hand()
    assert f.command(0, mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3) == ACCEPTED
    f.pilots.params.set(0, "NAV_RCL_ACT", 1)
    f.run(1.0)
    assert f.command(0, mavlink.MAV_CMD_DO_SET_MODE, 1, *mode) == REJECTED
    assert f.mode(0) == "AUTO.LOITER"


def test_arming_in_a_manual_mode_needs_sticks():
    f = Flight(params=PARAMS)
    f.run(3.0)
    assert f.command(0, mavlink.MAV_CMD_DO_SET_MODE, 1, *POSCTL) == ACCEPTED
    assert f.arm(0) == REJECTED
    f.run(0.1, CENTRE)
    assert f.arm(0) == ACCEPTED


@pytest.mark.parametrize(
    ("mode", "throttle", "result"),
    [
        (POSCTL, 0.3, REJECTED),
        (POSCTL, -1.0, ACCEPTED),
        (STABILIZED, 0.0, REJECTED),
        (STABILIZED, -1.0, ACCEPTED),
    ],
)
def test_arming_needs_a_low_throttle_stick(mode, throttle, result):
    f = Flight(params=PARAMS)
    f.run(3.0)
    assert set_mode(f, mode, sticks(throttle=throttle)) == ACCEPTED
    assert f.arm(0) == result


def test_gesture_arms_in_posctl_and_disarms_on_the_ground():
    f = Flight(params=PARAMS)
    f.run(3.0)
    f.run(1.3, sticks(throttle=-1.0, yaw=1.0))
    assert f.armed(0) and f.mode(0) == "POSCTL"
    f.run(1.5, sticks(throttle=-1.0, yaw=-1.0))
    assert not f.armed(0)


def test_gesture_does_not_disarm_in_the_air_in_posctl():
    f = by_hand()
    f.run(1.5, sticks(throttle=-1.0, yaw=-1.0))
    assert f.armed(0)


def test_gesture_does_not_arm_while_a_program_prepares_its_flight():
    f = Flight(params=PARAMS)
    f.run(3.0)
    f.run(0.2, lambda f: f.setpoint(0, (0.0, 0.0, -1.0)))
    assert f.offboard(0) == ACCEPTED
    f.run(1.5, sticks(throttle=-1.0, yaw=1.0))
    assert not f.armed(0)


def hover_offboard(**params):
    """Return a flight that hovers in OFFBOARD, with a pilot whose sticks are centred, and its setpoint."""
    f = Flight(params={**PARAMS, "COM_RCL_EXCEPT": 4, **params})
    f.run(3.0)

    def hold(f):
        f.setpoint(0, (0.0, 0.0, -1.0))
        CENTRE(f)

    f.run(0.2, hold)
    assert f.offboard(0) == ACCEPTED and f.arm(0) == ACCEPTED
    f.run(4.0, hold)
    return f, hold


@pytest.mark.parametrize(
    ("override", "mode"), [(1, "OFFBOARD"), (3, "POSCTL"), (2, "POSCTL"), (0, "OFFBOARD")]
)
def test_moved_sticks_take_offboard_as_com_rc_override_says(override, mode):
    f, hold = hover_offboard(COM_RC_OVERRIDE=override)
    f.run(0.3, lambda f: (f.setpoint(0, (0.0, 0.0, -1.0)), sticks(roll=0.8)(f)))
    f.run(0.3, hold)
    assert f.mode(0) == mode


def test_moved_sticks_take_over_from_a_landing_by_default():
    f = by_hand()
    assert f.command(0, mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 6) == ACCEPTED
    f.run(0.3, CENTRE)
    assert f.mode(0) == "AUTO.LAND"
    f.run(0.2, sticks(pitch=0.7))
    assert f.mode(0) == "POSCTL"


def test_pilot_keeps_the_vehicle_although_a_program_sends_setpoints():
    f, hold = hover_offboard()
    assert set_mode(f, POSCTL) == ACCEPTED
    f.run(3.0, hold)
    assert f.mode(0) == "POSCTL"


def test_posctl_without_poses_becomes_altctl_or_stabilized_and_returns():
    f = by_hand()
    f.vision_on[0] = False
    f.until(lambda f: f.mode(0) in ("ALTCTL", "STABILIZED"), 5.0, CENTRE)
    f.vision_on[0] = True
    f.until(lambda f: f.mode(0) == "POSCTL", 5.0, CENTRE)


def test_yaw_rate_of_an_attitude_setpoint_ends_with_offboard():
    f, _ = hover_offboard()
    turn = mavlink.MAVLink_set_attitude_target_message(
        0, 1, 1, mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE | 2, [1, 0, 0, 0], 0, 0, 1.0, 0.56
    )
    f.run(0.3, lambda f: (f.send(0, turn), CENTRE(f)))
    assert f.pilots.sp.yaw_rate_ff[0] == 1.0
    f.command(0, mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3)
    assert f.pilots.sp.yaw_rate_ff[0] == 0.0


def test_pilot_with_sticks_keeps_a_program_of_the_arena_out():
    guarded = Flight(params=PARAMS)
    guarded.pilots = Autopilots(guarded.settings, guarded.world.period_s, authority=True)
    guarded.run(3.0)
    pilot = mavlink.MAVLink(None, srcSystem=250, srcComponent=190)
    centre = mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0).pack(pilot)

    def fly(f):
        f.pilots.receive(0, "router", centre)
        f.setpoint(0, (0.0, 0.0, -1.0))

    guarded.run(0.2, fly)
    for number, *p in ((176, 1, 3, 0, 0, 0, 0, 0), (400, 1, 0, 0, 0, 0, 0, 0)):
        m = mavlink.MAVLink_command_long_message(1, 1, number, 0, *p)
        guarded.pilots.receive(0, "router", m.pack(pilot))
        guarded.run(0.1, fly)
    assert guarded.armed(0) and guarded.mode(0) == "POSCTL"
    assert guarded.offboard(0) == mavlink.MAV_RESULT_DENIED
    assert guarded.mode(0) == "POSCTL"
