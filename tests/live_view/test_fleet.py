"""State of the vehicles from telemetry, true state, captured poses and the supervisor's table."""

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from arena.constants import MAX_ROTORS
from arena.live_view.fleet import STALE_S, FleetTracker
from arena.live_view.settings import Rotor, VehicleSettings
from arena.mocap.client import CapturedFrame, Pose
from arena.wire.truth_page import Truth

OFFBOARD = 6 << 16


def vehicle(k, *, index):
    return VehicleSettings(
        name=f"uav{k}",
        id=k,
        kind="real" if index is None else "simulated",
        autopilot="builtin",
        index=index,
        body=f"body{k}",
        tools=("127.0.0.1", 24006 + 10 * k),
        start_n=(0.0, 0.0, 0.0),
        profile="iris",
        radius_m=0.3,
        height_m=0.1,
        rotors=(Rotor(position_b=(0.1, 0.1, 0.0), clockwise=True),),
    )


VEHICLES = (vehicle(1, index=None), vehicle(2, index=1), vehicle(3, index=0))


def packed(message, system):
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=1)))


def local(x, y, z):
    return mavlink.MAVLink_local_position_ned_message(1000, x, y, z, 0.1, 0.2, 0.3)


def truth():
    return Truth(
        time_s=1.0,
        p_n=np.array([[3.0, 0.0, -3.0], [2.0, 0.0, -2.0]]),
        q_nb=np.array([[1.0, 0, 0, 0], [0, 0, 0, 1.0]]),
        v_n=np.zeros((2, 3)),
        omega_b=np.zeros((2, 3)),
        accel_b=np.zeros((2, 3)),
        motors=np.tile(np.linspace(0.1, 0.8, MAX_ROTORS), (2, 1)),
    )


def test_unknown_values_are_nan():
    found = FleetTracker(VEHICLES).snapshot(0.0)
    assert np.isnan(found.p_n).all() and np.isnan(found.battery).all() and np.isinf(found.silent_s).all()
    assert found.modes == ("", "", "") and found.armed == (None, None, None)


def test_true_state_goes_to_the_rows_of_the_simulated_vehicles():
    tracker = FleetTracker(VEHICLES)
    tracker.on_truth(truth(), 10.0)
    found = tracker.snapshot(10.0)
    assert found.p_n[1:].tolist() == [[2.0, 0.0, -2.0], [3.0, 0.0, -3.0]]
    assert found.q_nb[1].tolist() == [0, 0, 0, 1.0]
    assert found.has_true.tolist() == [False, True, True]
    assert np.isnan(found.p_n[0]).all() and np.isnan(found.motors[0]).all()
    assert found.motors[2, 3] == truth().motors[0, 3]


def test_captured_pose_replaces_the_estimate_until_it_is_old():
    tracker = FleetTracker(VEHICLES)
    tracker.on_datagram(0, packed(local(1.0, 2.0, -3.0), 1), 10.0)
    assert tracker.snapshot(10.0).p_n[0].tolist() == [1.0, 2.0, -3.0]
    pose = Pose("body1", (5.0, 6.0, -7.0), (1.0, 0.0, 0.0, 0.0))
    tracker.on_frames([CapturedFrame(1, 0.0, (pose,), ())], 10.0)
    found = tracker.snapshot(10.1)
    assert found.p_n[0].tolist() == [5.0, 6.0, -7.0] and found.est_p_n[0].tolist() == [1.0, 2.0, -3.0]
    assert tracker.snapshot(11.0).p_n[0].tolist() == [1.0, 2.0, -3.0]


def test_mode_and_setpoint_are_those_of_the_autopilot():
    tracker = FleetTracker(VEHICLES)
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 128, OFFBOARD, 4, 3)
    target = mavlink.MAVLink_position_target_local_ned_message(
        0, 1, 0, 1.0, 2.0, -3.0, 0, 0, 0, 0, 0, 0, 0.5, 0
    )
    tracker.on_datagram(1, packed(heartbeat, 2) + packed(target, 2), 10.0)
    found = tracker.snapshot(10.0)
    assert found.modes == ("", "OFFBOARD", "")
    assert found.set_p_n[1].tolist() == [1.0, 2.0, -3.0] and found.set_yaw[1] == 0.5


def test_old_telemetry_is_not_the_present_state():
    tracker = FleetTracker(VEHICLES)
    tracker.on_datagram(0, packed(local(1.0, 2.0, -3.0), 1), 10.0)
    found = tracker.snapshot(10.0 + STALE_S + 0.1)
    assert np.isnan(found.est_p_n[0]).all()
    assert abs(found.silent_s[0] - STALE_S - 0.1) < 1e-9


def test_state_of_a_silent_vehicle_is_unknown():
    tracker = FleetTracker(VEHICLES)
    facts = {"uav2.armed": False, "uav2.landed": True, "uav2.connected": False}
    tracker.on_status({"facts": facts})
    found = tracker.snapshot(10.0)
    assert (found.armed[1], found.landed[1]) == (None, None)


def test_own_telemetry_counts_more_than_an_old_report_of_the_supervisor():
    tracker = FleetTracker(VEHICLES)
    tracker.on_status({"facts": {"uav2.armed": False, "uav2.landed": True, "uav2.connected": True}})
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 128, OFFBOARD, 4, 3)
    in_air = mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_IN_AIR)
    tracker.on_datagram(1, packed(heartbeat, 2) + packed(in_air, 2), 10.0)
    found = tracker.snapshot(10.0)
    assert (found.armed[1], found.landed[1]) == (True, False)


def test_messages_of_another_system_are_ignored():
    tracker = FleetTracker(VEHICLES)
    tracker.on_datagram(0, packed(local(1.0, 2.0, -3.0), 2), 10.0)
    assert np.isinf(tracker.snapshot(10.0).silent_s).all()


def test_facts_and_pose_age_come_from_the_supervisor():
    tracker = FleetTracker(VEHICLES)
    tracker.on_status(
        {
            "facts": {
                "uav2.armed": True,
                "uav2.landed": False,
                "uav2.control": "pilot",
                "uav2.mode": "POSCTL",
            },
            "processes": {
                "forward.uav2": {"kind": "forward", "vehicle": "uav2", "stats": {"pose_age_ms": 12.0}}
            },
        }
    )
    found = tracker.snapshot(10.0)
    assert (found.armed[1], found.landed[1], found.controls[1]) == (True, False, "pilot")
    assert found.pose_age_s[1] == 0.012 and np.isnan(found.pose_age_s[0])
    assert found.modes[1] == "POSCTL"
