"""When setpoints are sent, confirmed commands, and the loss of the vehicle."""

from __future__ import annotations

import dataclasses
import threading
import time

import numpy as np
import pytest
from fake_autopilot import TELEMETRY, FakeAutopilot
from pymavlink.dialects.v20 import common as mavlink
from served import let_pass, until

from arena.clock import WallClock
from arena.errors import CommandRefusedError, NotConfirmedError, OffboardLostError, StaleDataError
from arena.trajectories import Circle
from arena.uav import UAV, vehicle_control

from .conftest import free_address, make_uav, sending_to


@pytest.fixture(params=["mavlink", "mavsdk"])
def backend(request) -> str:
    if request.param == "mavsdk":
        pytest.importorskip("mavsdk.plugins.mavlink_direct", reason="mavsdk is not installed")
    return request.param


TRIES = 20
OFFBOARD_TIMEOUT_S = 1.0  # COM_OF_LOSS_T: a longer pause between setpoints is a failsafe


def gaps(autopilot: FakeAutopilot) -> np.ndarray:
    """Return the times between the setpoints [s], without pauses of the computer."""
    return np.diff(autopilot.setpoint_ticks) * autopilot.period_s


def test_no_setpoint_is_sent_between_calls(autopilot, uav):
    uav.start_offboard_mission()
    for _ in range(5):
        uav.set_vel_yaw([0, 0, -1], 0.0, 50)
    let_pass(autopilot, 3)
    beats, sent = len(autopilot.heartbeats), len(autopilot.setpoints)
    until(lambda: len(autopilot.heartbeats) >= beats + 1)  # the program hangs, its link lives
    let_pass(autopilot, 25)
    assert len(autopilot.setpoints) == sent


def test_slow_program_leaves_gaps_between_its_setpoints(autopilot, uav):
    uav.start_offboard_mission()
    let_pass(autopilot, 3)
    before = len(autopilot.setpoints)
    for _ in range(3):
        uav.set_vel_yaw([0, 0, -1], 0.0, 50)
        let_pass(autopilot, 30)  # longer than half a second of computation
    until(lambda: len(autopilot.setpoints) >= before + 3)
    assert len(autopilot.setpoints) == before + 3
    assert gaps(autopilot)[-2:].min() > 0.4


def test_a_trajectory_is_sent_with_velocity_and_acceleration_until_it_ends(autopilot, uav):
    uav.start_offboard_mission()
    let_pass(autopilot, 3)  # the last setpoint of the take-off arrives
    before = len(autopilot.setpoints)
    trajectory = Circle(np.zeros(3), 1.0, lap_s=2.0, laps=0.5, ramp_s=0.5)
    began = uav.clock.now()
    uav.follow(trajectory, 50)
    assert uav.clock.now() - began >= trajectory.duration_s
    until(lambda: len(autopilot.setpoints) >= before + 3)
    sent = np.array(
        [[m.x, m.y, m.z, m.vx, m.vy, m.vz, m.afx, m.afy, m.afz] for _, m in autopilot.setpoints[before:]]
    )
    states = [trajectory.at(t) for t in np.linspace(0.0, trajectory.duration_s, 2000)]
    planned = np.array([[*state.pos, *state.vel, *state.acc] for state in states])
    nearest = np.abs(sent[:, None] - planned).max(axis=2).argmin(axis=1)
    np.testing.assert_allclose(sent, planned[nearest], atol=0.1)  # how many there are depends on the machine
    assert np.all(np.diff(nearest) >= 0) and nearest[-1] > nearest[0]
    assert np.abs(sent[:, 3:6]).max() > 0.5 and np.abs(sent[:, 6:]).max() > 0.5


def test_vehicle_is_flown_by_the_program_that_sends_its_setpoints(autopilot, uav):
    autopilot.mode, autopilot.armed = "OFFBOARD", True  # another program has taken off
    until(lambda: uav.info.is_armed and uav.info.flight_mode == "OFFBOARD")
    assert not uav.control.flies(OFFBOARD_TIMEOUT_S)
    uav.set_vel_yaw([0, 0, -1], 0.0, 50)
    assert uav.control.flies(OFFBOARD_TIMEOUT_S)
    autopilot.mode = "AUTO.LAND"
    until(lambda: uav.info.flight_mode == "AUTO.LAND")
    assert not uav.control.flies(OFFBOARD_TIMEOUT_S)
    autopilot.mode = "OFFBOARD"  # another program again
    until(lambda: uav.info.flight_mode == "OFFBOARD")
    assert not uav.control.flies(OFFBOARD_TIMEOUT_S)


def test_silent_program_does_not_fly_a_vehicle_that_stays_in_offboard(autopilot, uav):
    """A ROS 2 program takes over in OFFBOARD: its setpoints are the only reason why the failsafe does not act."""
    autopilot.mode, autopilot.armed = "OFFBOARD", True
    until(lambda: uav.info.is_armed and uav.info.flight_mode == "OFFBOARD")
    uav.set_vel_yaw([0, 0, -1], 0.0, 50)
    assert uav.control.flies(offboard_loss_s=0.1)
    until(lambda: not uav.control.flies(offboard_loss_s=0.1))
    assert uav.control.flies(offboard_loss_s=60.0)  # this autopilot's failsafe waits longer
    uav.set_vel_yaw([0, 0, -1], 0.0, 50)
    assert uav.control.flies(offboard_loss_s=0.1)


def test_program_that_only_reads_sends_no_setpoint(autopilot, uav):
    until(lambda: len(autopilot.heartbeats) >= 2)
    assert autopilot.setpoints == []
    assert autopilot.heartbeats[0].type == mavlink.MAV_TYPE_ONBOARD_CONTROLLER
    assert (autopilot.heartbeats[0].get_srcSystem(), autopilot.heartbeats[0].get_srcComponent()) == (1, 191)


def test_setpoints_never_pause_while_a_mission_starts(autopilot, uav):
    autopilot.prearm = False
    until(lambda: uav._source.telemetry.status.prearm is False)
    threading.Timer(0.5, lambda: setattr(autopilot, "prearm", True)).start()
    uav.start_offboard_mission()
    uav.set_pos_yaw(uav.ekf.pos, 0.0, 0.2)
    assert (autopilot.mode, autopilot.armed) == ("OFFBOARD", True)
    assert len(autopilot.setpoints) > 20
    assert gaps(autopilot).max() < OFFBOARD_TIMEOUT_S


def test_mission_enters_offboard_at_the_present_position_then_arms(autopilot, uav):
    uav.start_offboard_mission()
    asked = [c.command for c in autopilot.orders]
    assert asked == [mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM]
    first = autopilot.setpoints[0][1]
    assert (first.x, first.y, first.z) == pytest.approx(autopilot.pos, abs=1e-6)
    assert first.yaw == pytest.approx(np.radians(30), abs=1e-5)


ARM, MODE = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_DO_SET_MODE


def test_refused_arming_raises_with_the_autopilots_text(autopilot, uav, monkeypatch):
    monkeypatch.setattr(vehicle_control, "READY_TIMEOUT_S", 3.0)
    monkeypatch.setattr(vehicle_control, "_REARM_S", 0.1)
    autopilot.refuse[ARM] = (1, b"Arming denied: throttle above center")
    with pytest.raises(
        CommandRefusedError, match=r"uav1.*arming.*temporarily rejected.*throttle above center"
    ):
        uav.start_offboard_mission()
    assert gaps(autopilot).max() < OFFBOARD_TIMEOUT_S


def test_temporarily_rejected_arming_is_requested_again(autopilot, uav, monkeypatch):
    monkeypatch.setattr(vehicle_control, "_REARM_S", 0.1)
    autopilot.refuse[ARM] = (1, b"Arming denied: 12 poses/s, needs 20")
    begun = len(autopilot.orders)

    def see_more_poses() -> None:
        until(lambda: sum(c.command == ARM for c in autopilot.orders[begun:]) >= 3)
        autopilot.refuse.clear()

    watch = threading.Thread(target=see_more_poses)
    watch.start()
    uav.start_offboard_mission()
    watch.join()
    assert (autopilot.mode, autopilot.armed) == ("OFFBOARD", True)
    assert gaps(autopilot).max() < OFFBOARD_TIMEOUT_S


def test_rejected_arming_waits_for_the_arming_checks(autopilot, uav, monkeypatch):
    monkeypatch.setattr(vehicle_control, "_REARM_S", 0.1)
    autopilot.refuse[ARM] = (1, b"Arming denied: no poses")

    def lose_poses_for_a_moment() -> None:
        until(lambda: any(c.command == ARM for c in autopilot.orders))
        autopilot.prearm = False
        until(lambda: uav._source.telemetry.status.prearm is False)
        let_pass(autopilot, 25)  # a request that was on its way arrives
        before = sum(c.command == ARM for c in autopilot.orders)
        let_pass(autopilot, 40)
        asked.append(sum(c.command == ARM for c in autopilot.orders) - before)
        autopilot.refuse.clear()
        autopilot.prearm = True

    asked: list[int] = []
    watch = threading.Thread(target=lose_poses_for_a_moment)
    watch.start()
    uav.start_offboard_mission()
    watch.join()
    assert autopilot.armed
    assert asked == [0], "arming was requested while the arming checks failed"


@pytest.mark.parametrize("result", [2, 3, 4], ids=["denied", "unsupported", "failed"])
def test_finally_refused_arming_is_not_requested_again(autopilot, uav, result):
    autopilot.refuse[ARM] = (result, b"Arming denied: land-all has control")
    with pytest.raises(CommandRefusedError, match="land-all has control"):
        uav.start_offboard_mission()
    assert sum(c.command == ARM for c in autopilot.orders) == 1


def test_denied_offboard_is_not_requested_again(autopilot, uav):
    autopilot.refuse[MODE] = (2, b"land-all has control: run `arena release`")
    with pytest.raises(CommandRefusedError, match=r"refused OFFBOARD \(denied\).*run `arena release`"):
        uav.start_offboard_mission()
    assert [c.command for c in autopilot.orders] == [MODE]


def test_temporarily_rejected_offboard_is_requested_again(autopilot, uav):
    autopilot.refuse[MODE] = (1, b"no setpoints")

    def accept_later() -> None:
        until(lambda: sum(c.command == MODE for c in autopilot.orders) >= 2)
        autopilot.refuse.clear()

    watch = threading.Thread(target=accept_later)
    watch.start()
    uav.start_offboard_mode()
    watch.join()
    assert autopilot.mode == "OFFBOARD"


def test_arm_drone_does_not_wait_for_a_rejected_arming(autopilot, uav):
    autopilot.refuse[ARM] = (1, b"Arming denied: no poses")
    with pytest.raises(CommandRefusedError, match="no poses"):
        uav.arm_drone()
    assert sum(c.command == ARM for c in autopilot.orders) == 1


def test_program_that_may_not_fly_raises_with_the_holder_and_the_remedy(
    autopilot, uav, monkeypatch
):  # review fault 9
    monkeypatch.setattr(vehicle_control, "_CONFIRM_TIMEOUT_S", 0.8)
    autopilot.refuse[mavlink.MAV_CMD_DO_SET_MODE] = (1, b"pilot took control: run `arena release`")
    with pytest.raises(CommandRefusedError, match=r"OFFBOARD.*pilot took control: run `arena release`"):
        uav.start_offboard_mission()
    assert not autopilot.armed


class MovedClock(WallClock):
    """Wall clock that a test sets forward by `ahead_s` [s]."""

    ahead_s = 0.0

    def now(self) -> float:
        return super().now() + self.ahead_s

    def sleep_until(self, t: float) -> float:
        return super().sleep_until(t - self.ahead_s) + self.ahead_s


def test_refused_mode_is_requested_again_then_raises(autopilot, address, backend):
    autopilot.refuse[MODE] = (1, b"No offboard signal")
    clock = MovedClock()

    def pass_time() -> None:
        until(lambda: sum(c.command == MODE for c in autopilot.orders) >= 2)
        clock.ahead_s = 1.5 * vehicle_control._CONFIRM_TIMEOUT_S

    watch = threading.Thread(target=pass_time)
    with make_uav(address, backend=backend, clock=clock) as uav:
        until(lambda: uav.ekf.age_s < 0.5 and uav.info.is_connected)
        watch.start()
        with pytest.raises(CommandRefusedError, match=r"temporarily rejected.*No offboard signal"):
            uav.start_offboard_mode()
    watch.join()
    assert clock.ahead_s > 0.0, "OFFBOARD was requested once only"


def test_vehicle_that_is_not_ready_is_not_armed_and_raises_why(autopilot, uav, monkeypatch):
    monkeypatch.setattr(vehicle_control, "READY_TIMEOUT_S", 0.4)
    autopilot.prearm = False
    until(lambda: uav._source.telemetry.status.prearm is False)
    autopilot.say(b"Preflight Fail: Compass not calibrated")
    until(lambda: uav._source.telemetry.recent_texts(0.0))
    with pytest.raises(NotConfirmedError, match=r"not ready.*pre-arm checks fail.*Compass not calibrated"):
        uav.start_offboard_mission()
    assert autopilot.orders == []


def test_vehicle_that_is_disarmed_in_land_enters_offboard_before_it_is_ready(address, backend):
    class InLand(FakeAutopilot):
        """Its pre-arm checks fail in AUTO.LAND, as those of PX4."""

        def step(self, now):
            self.prearm = self.mode != "AUTO.LAND"
            return super().step(now)

    vehicle = InLand(telemetry=tuple(TELEMETRY), mode="AUTO.LAND")
    with sending_to(address, vehicle), make_uav(address, backend=backend) as uav:
        until(lambda: uav.ekf.age_s < 0.5 and uav.info.is_connected and uav.info.flight_mode == "AUTO.LAND")
        uav.start_offboard_mission()
        assert vehicle.armed and vehicle.mode == "OFFBOARD"


def test_vehicle_without_attitude_is_not_armed_and_raises_why(autopilot, uav, monkeypatch):
    monkeypatch.setattr(vehicle_control, "READY_TIMEOUT_S", 0.4)
    autopilot.telemetry = [name for name in autopilot.telemetry if not name.startswith("ATTITUDE")]
    telemetry = uav._source.telemetry
    until(lambda: telemetry.local.received_at > telemetry.attitude.received_at)
    old_at = telemetry.attitude.received_at - 2.0 * uav._source.stale_s
    telemetry.attitude = dataclasses.replace(telemetry.attitude, received_at=old_at)
    with pytest.raises(NotConfirmedError, match=r"the autopilot has no attitude estimate"):
        uav.start_offboard_mission()
    assert autopilot.orders == []


def test_first_heartbeat_is_requested(autopilot, uav):
    uav.start_offboard_mission()
    first = autopilot.commands[0]
    assert (first.command, first.param1) == (
        mavlink.MAV_CMD_REQUEST_MESSAGE,
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    )


def test_mission_needs_a_position_estimate(monkeypatch):
    monkeypatch.setattr(vehicle_control, "READY_TIMEOUT_S", 0.4)
    address, autopilot = (
        free_address(),
        FakeAutopilot(telemetry=sorted(TELEMETRY.keys() - {"LOCAL_POSITION_NED"})),
    )
    with sending_to(address, autopilot), make_uav(address) as uav:
        until(lambda: uav.info.is_connected)
        with pytest.raises(NotConfirmedError, match="no position estimate"):
            uav.start_offboard_mission()
        let_pass(autopilot, 3)
        assert autopilot.setpoints == [] and autopilot.orders == []


def test_unanswered_command_is_repeated_with_a_counter(autopilot, uav, monkeypatch):
    monkeypatch.setattr(vehicle_control, "_RETRY_S", 0.1)
    autopilot.ignore.add(mavlink.MAV_CMD_COMPONENT_ARM_DISARM)
    with pytest.raises(
        NotConfirmedError, match="no acknowledgement of arming from the autopilot after 5 tries"
    ):
        uav.arm_drone()
    until(lambda: len(autopilot.commands) == 5)
    assert [c.confirmation for c in autopilot.commands] == [0, 1, 2, 3, 4]


def test_later_heartbeat_confirms_a_landing_without_acknowledgement(autopilot, uav, monkeypatch):
    uav.start_offboard_mission()
    monkeypatch.setattr(vehicle_control, "_RETRY_S", 0.5)
    autopilot.ack_to = (253, 190)  # the autopilot obeys, and its acknowledgements are lost
    uav.auto_land(wait=False)
    assert autopilot.mode == "AUTO.LAND"


def test_older_heartbeat_does_not_confirm_a_landing_without_acknowledgement(autopilot, uav, monkeypatch):
    uav.start_offboard_mission()
    monkeypatch.setattr(vehicle_control, "_RETRY_S", 0.1)
    autopilot.mode = "AUTO.LAND"
    until(lambda: uav.info.flight_mode == "AUTO.LAND")
    autopilot.ignore.add(mavlink.MAV_CMD_DO_SET_MODE)
    autopilot.mode = "POSCTL"  # a pilot takes the vehicle while the program requests the landing
    with pytest.raises(NotConfirmedError, match="no acknowledgement of landing"):
        uav.auto_land(wait=False)


def test_acknowledgement_for_another_sender_is_ignored(autopilot, uav, monkeypatch):
    monkeypatch.setattr(vehicle_control, "_TRIES", 1)
    autopilot.ack_to = (253, 190)
    with pytest.raises(NotConfirmedError, match="no acknowledgement of arming"):
        uav.arm_drone()


@pytest.mark.parametrize(
    "setter",
    [
        lambda u: u.set_pos_yaw([0, 0, -1], 0.0, 120.0),
        lambda u: u.set_vel_yaw([0, 0, 0], 0.0, 50),
        lambda u: u.set_vel_body_yaw_rate([0, 0, 0], 0.0, 50),
        lambda u: u.set_att_thrust([0, 0, 0], "euler", 14.0, 50),
        lambda u: u.set_ang_vel_thrust([0, 0, 0], 14.0, 50),
    ],
)
def test_every_setter_keeps_raising_after_the_pilot_took_over(autopilot, uav, setter):
    uav.start_offboard_mission()
    setter_thread_sees = threading.Timer(
        0.1, lambda: (autopilot.say(b"Pilot took over using sticks"), take(autopilot))
    )
    setter_thread_sees.start()
    began = time.monotonic()
    with pytest.raises(OffboardLostError, match=r"POSCTL: a pilot \(Pilot took over using sticks\)"):
        while time.monotonic() < began + 60.0:  # during a setter
            setter(uav)
    autopilot.mode = "OFFBOARD"  # OFFBOARD by the pilot does not return the vehicle to the program
    until(lambda: uav.info.flight_mode == "OFFBOARD")
    sent = len(autopilot.setpoints)
    with pytest.raises(OffboardLostError):
        setter(uav)
    assert len(autopilot.setpoints) <= sent


def take(autopilot: FakeAutopilot) -> None:
    autopilot.mode = "POSCTL"


def test_setters_raise_after_a_disarming(autopilot, uav):
    uav.start_offboard_mission()
    autopilot.armed = False
    with pytest.raises(OffboardLostError, match="disarmed"):
        uav.set_pos_yaw([0, 0, -1], 0.0, 2.0)


def test_pilot_may_take_over_while_a_mission_starts(autopilot, uav):
    autopilot.ignore.add(mavlink.MAV_CMD_COMPONENT_ARM_DISARM)
    watch = threading.Thread(target=lambda: (until(lambda: len(autopilot.orders) >= 2), take(autopilot)))
    watch.start()
    with pytest.raises(OffboardLostError, match="POSCTL"):
        uav.start_offboard_mission()
    watch.join()
    assert autopilot.mode == "POSCTL"


def test_silent_autopilot_makes_setters_raise(autopilot, uav, monkeypatch):
    uav.start_offboard_mission()
    autopilot.mute = True
    monkeypatch.setattr(vehicle_control, "_MAX_SILENCE", 1.0 / uav._source.stale_s)
    with pytest.raises(StaleDataError, match=r"silent for .* s \(limit 1 s\)"):
        uav.set_pos_yaw([0, 0, -1], 0.0, 5.0)


def test_disarming_by_the_program_is_no_loss(autopilot, uav):
    uav.start_offboard_mission()
    uav.disarm_drone()
    uav.set_vel_yaw([0, 0, 0], 0.0, 50)
    assert not autopilot.armed


def test_landing_returns_on_the_ground_and_disarmed(autopilot, uav):
    uav.start_offboard_mission()
    autopilot.landed, autopilot.land_s, autopilot.disarm_s = False, 0.1, 0.3
    until(lambda: not uav.info.is_landed)
    uav.auto_land()
    assert autopilot.landed and autopilot.mode == "AUTO.LAND"
    assert not autopilot.armed, "landed but armed is not landed"


def test_unconfirmed_landing_raises_with_the_last_state(autopilot, uav, monkeypatch):
    monkeypatch.setattr(vehicle_control, "LAND_TIMEOUT_S", 0.3)
    uav.start_offboard_mission()
    autopilot.landed = False
    until(lambda: not uav.info.is_landed)
    with pytest.raises(NotConfirmedError, match=r"landing not confirmed.*AUTO\.LAND, armed, in the air"):
        uav.auto_land()


def test_landing_taken_over_by_the_pilot_raises(autopilot, uav):
    uav.start_offboard_mission()
    autopilot.landed = False
    until(lambda: not uav.info.is_landed)

    def take_when_landing() -> None:
        until(lambda: uav.info.flight_mode == "AUTO.LAND")
        take(autopilot)

    watch = threading.Thread(target=take_when_landing)
    watch.start()
    with pytest.raises((OffboardLostError, NotConfirmedError), match="POSCTL"):
        uav.auto_land()
    watch.join()


def test_closing_after_an_exception_commands_nothing(autopilot, address):
    with pytest.raises(ZeroDivisionError), make_uav(address) as uav:
        until(lambda: uav.ekf.age_s < 0.5)
        uav.start_offboard_mission()
        let_pass(autopilot, 3)
        asked, sent = len(autopilot.commands), len(autopilot.setpoints)
        raise ZeroDivisionError
    let_pass(autopilot, 10)
    assert (len(autopilot.commands), len(autopilot.setpoints)) == (asked, sent)
    assert autopilot.armed


def test_rate_is_kept_without_drift(autopilot, uav):
    began = time.monotonic()
    for _ in range(100):
        uav.set_vel_yaw([0, 0, 0], 0.0, 200)
    assert time.monotonic() - began >= 0.48  # never faster; a slow machine may be slower


def test_position_setpoint_is_streamed_at_50_hz_for_its_time(autopilot, uav):
    """A busy machine sends fewer setpoints, so the call is repeated; it never sends more."""
    most = 0
    for _ in range(TRIES):
        before, began = len(autopilot.setpoints), time.monotonic()
        uav.set_pos_yaw([[0], [0], [-1]], 0.0, 0.5)
        assert time.monotonic() - began >= 0.48
        let_pass(autopilot, 3)  # the last setpoint arrives
        sent = len(autopilot.setpoints) - before
        assert sent <= 26
        most = max(most, sent)
        if most >= 20:
            break
    assert most >= 20


def test_actuator_setpoint_is_refused_on_a_recent_autopilot(autopilot, uav):
    with pytest.raises(CommandRefusedError, match=r"v1\.13.*v1\.16\.0"):
        uav.set_act(0, [0.1, 0.1, 0.1, 0.5], 50)
    assert autopilot.setpoints == []


def test_actuator_setpoint_is_sent_to_an_old_autopilot(autopilot, uav):
    autopilot.version = 0x01090200
    uav.set_act(0, [0.1, 0.2, 0.3, 0.5], 50)
    until(
        lambda: autopilot.setpoints and autopilot.setpoints[-1][1].get_type() == "SET_ACTUATOR_CONTROL_TARGET"
    )
    assert list(autopilot.setpoints[-1][1].controls[:4]) == pytest.approx([0.1, 0.2, 0.3, 0.5])


def test_sending_before_the_first_message_raises():
    with (
        make_uav(free_address()) as uav,
        pytest.raises(NotConfirmedError, match="no message from the vehicle has arrived"),
    ):
        uav.set_vel_yaw([0, 0, 0], 0.0, 50)


def test_second_program_on_one_port_raises():
    address = free_address()
    with make_uav(address), pytest.raises(Exception, match="Does another program use this port"):
        UAV(
            "uav1",
            1,
            1,
            1,
            4,
            {"kind": "quadratic", "a": 1.0, "b": 1.0},
            link=f"udpin:{address[0]}:{address[1]}",
            system_id=1,
        )


def test_missing_arena_is_named_with_the_address_at_which_the_program_listens(monkeypatch, address):
    monkeypatch.setattr(vehicle_control, "READY_TIMEOUT_S", 0.1)
    with make_uav(address) as silent, pytest.raises(NotConfirmedError) as found:
        silent.start_offboard_mission()
    assert str(found.value).endswith(
        f"no heartbeat from the autopilot has arrived at udpin:{address[0]}:{address[1]}. Is the arena running?"
    )


@pytest.mark.parametrize("command", ["disarm_drone", "arm_drone"])
def test_refused_command_in_the_air_holds_the_present_position(autopilot, uav, command):
    uav.start_offboard_mission()
    there = np.array([3.0, 1.0, -2.0])
    autopilot.landed, autopilot.pos = False, tuple(there)
    until(lambda: np.allclose(uav.ekf.pos, there))
    uav.set_pos_yaw(there, 0.0, 0.1)
    let_pass(autopilot, 3)
    before = len(autopilot.setpoints)
    autopilot.refuse[mavlink.MAV_CMD_COMPONENT_ARM_DISARM] = (mavlink.MAV_RESULT_DENIED, b"in the air")
    with pytest.raises(CommandRefusedError):
        getattr(uav, command)()
    until(lambda: len(autopilot.setpoints) > before)
    sent = np.array([[m.x, m.y, m.z] for _, m in autopilot.setpoints[before:]])
    np.testing.assert_allclose(sent, np.broadcast_to(there, sent.shape))


def test_takeover_after_a_refused_disarming_is_a_loss(autopilot, uav):
    uav.start_offboard_mission()
    autopilot.landed = False
    autopilot.refuse[mavlink.MAV_CMD_COMPONENT_ARM_DISARM] = (mavlink.MAV_RESULT_DENIED, b"in the air")
    with pytest.raises(CommandRefusedError):
        uav.disarm_drone()
    take(autopilot)
    until(lambda: uav.info.flight_mode == "POSCTL")
    with pytest.raises(OffboardLostError, match="POSCTL"):
        uav.set_vel_yaw([0, 0, 0], 0.0, 50)
