"""The thesis's class over a vehicle: columns, units, values without age limit, and a landing that is not waited for."""

from __future__ import annotations

import asyncio
import threading

import numpy as np
import pytest
from fake_autopilot import TELEMETRY, FakeAutopilot
from served import until
from uav.conftest import free_address, sending_to

from arena.compat import command_line, rospy, uav_mavros, uav_mavsdk
from arena.compat.messages import PoseStamped
from arena.compat.uav_mavros import UAV
from arena.errors import InputError, OffboardLostError, StaleDataError
from arena.wire.telemetry_values import Gps

ARGUMENTS = ("uav1", "1.4", "0.275", "0.1", "4", "iris")


@pytest.fixture
def address():
    return free_address()


@pytest.fixture
def autopilot(address):
    fake = FakeAutopilot(telemetry=tuple(TELEMETRY))
    with sending_to(address, fake):
        yield fake


@pytest.fixture
def uav(autopilot, address, monkeypatch):
    options = ["--ns", "uav1", "--link", f"udpin:{address[0]}:{address[1]}"]
    monkeypatch.setattr(command_line, "uav_options", lambda name: options)
    one = UAV(*ARGUMENTS)
    until(lambda: one.ekf.pos is not None and one.info.is_connected)
    yield one
    one._uav.close()


def test_vectors_are_columns_and_numbers_are_those_given(uav):
    assert [uav.ekf.pos.shape, uav.ekf.vel.shape, uav.ekf.att_q.shape, uav.ekf.att_euler.shape] == [
        (3, 1),
        (3, 1),
        (4, 1),
        (3, 1),
    ]
    assert (uav.info.mass, uav.info.radius, uav.info.num_rotors) == (1.4, 0.275, 4)
    assert (uav.info.drone_ns, uav.info.thrust_curve) == ("uav1", "iris")
    assert uav.info.is_connected is True and uav.info.is_armed is False


def test_latitude_and_longitude_are_in_radians(uav, monkeypatch):
    position = Gps(pos=np.array([47.0, -8.0, 488.0]), received_at=0.0)
    monkeypatch.setattr(uav._uav._connection.telemetry, "gps", position)
    assert uav.sen.gps.pos[:, 0] == pytest.approx([np.radians(47.0), np.radians(-8.0), 488.0])


def test_value_that_never_arrived_is_none(uav):
    assert uav.sen.mocap.pos is None


def test_last_value_stays_when_the_autopilot_is_silent(uav, autopilot):
    autopilot.telemetry = ()
    until(lambda: uav._uav.ekf.age_s > 1.0)
    assert uav.ekf.pos.shape == (3, 1)


def go_silent_about_position(uav, autopilot):
    """The autopilot sends heartbeats, but no position: the loss of its estimate, not of its connection."""
    uav.start_offboard_mission()
    autopilot.telemetry = tuple(name for name in TELEMETRY if name != "LOCAL_POSITION_NED")
    until(lambda: uav._uav.ekf.age_s > 1.0)


def test_setpoint_from_an_old_estimate_is_not_sent(uav, autopilot):
    go_silent_about_position(uav, autopilot)
    place = uav.ekf.pos
    sent = len(autopilot.setpoints)
    with pytest.raises(StaleDataError, match="estimated position"):
        uav.set_vel_yaw(0.8 * (np.ones((3, 1)) - place), 0.0, 50)
    assert len(autopilot.setpoints) == sent
    autopilot.telemetry = tuple(TELEMETRY)
    until(lambda: uav._uav.ekf.age_s < 0.5)
    uav.set_vel_yaw(0.8 * (uav.ekf.pos - place), 0.0, 50)


def test_old_value_that_another_thread_reads_stops_no_setpoint(uav, autopilot):
    go_silent_about_position(uav, autopilot)
    log = threading.Thread(target=lambda: uav.ekf.pos)
    log.start()
    log.join(30)
    uav.set_vel_yaw(np.zeros((3, 1)), 0.0, 50)


def test_coroutine_sends_no_setpoint_from_an_old_estimate(uav, autopilot, monkeypatch):
    monkeypatch.setattr(uav_mavros, "UAV", lambda *arguments: uav)
    flyer = uav_mavsdk.UAV(*ARGUMENTS)
    go_silent_about_position(uav, autopilot)

    async def main() -> None:
        await flyer.set_vel_yaw(0.8 * (np.ones((3, 1)) - flyer.ekf.pos), 0.0, 50)

    with pytest.raises(StaleDataError, match="estimated position"):
        asyncio.run(main())


def test_landing_returns_while_the_vehicle_is_in_the_air(uav, autopilot):
    uav.start_offboard_mission()
    uav.set_pos_yaw(np.array([[0.0], [0.0], [-1.0]]), np.array([0.0]), 0.1)
    uav.auto_land()
    assert uav.info.flight_mode == "AUTO.LAND" and uav.info.is_armed


def test_setter_raises_when_a_pilot_has_taken_the_vehicle(uav, autopilot):
    uav.start_offboard_mission()
    autopilot.mode = "POSCTL"
    with pytest.raises(OffboardLostError):
        while True:
            uav.set_vel_yaw(np.zeros((3, 1)), 0.0, 50)


def test_program_for_another_vehicle_is_refused(monkeypatch):
    monkeypatch.setattr(command_line, "vehicle_name", lambda: "uav2")
    with pytest.raises(InputError, match="uav2"):
        UAV(*ARGUMENTS)


class Logged:
    """Stand-in for `arena.UAV` that keeps its references."""

    def __init__(self):
        self.references = []

    def reference(self, p):
        self.references.append(p.tolist())


def test_published_pose_is_logged_in_the_arena_frame(monkeypatch):
    logged = Logged()
    monkeypatch.setitem(uav_mavros.VEHICLES, "uav1", logged)
    message = PoseStamped()
    message.header.stamp = rospy.Time.now()
    message.pose.position.x, message.pose.position.y, message.pose.position.z = np.array(
        [[2.0], [1.0], [3.0]]
    )
    rospy.Publisher("uav1/mavros/waypoints/position", PoseStamped, queue_size=1).publish(message)
    assert logged.references == [[1.0, 2.0, -3.0]]


@pytest.mark.parametrize("topic", ["uav1/mavros/setpoint_position/local", "uav1", ""])
def test_topic_that_does_not_exist_is_refused(topic):
    with pytest.raises(InputError, match="cannot be published without ROS"):
        rospy.Publisher(topic, PoseStamped)


def test_topics_cannot_be_read():
    with pytest.raises(InputError, match="cannot be read"):
        rospy.Subscriber("uav1/mavros/state", PoseStamped, print)


def test_time_has_seconds_and_nanoseconds():
    at = rospy.Time.from_sec(12.25)
    assert (at.to_sec(), at.secs, at.nsecs) == (12.25, 12, 250_000_000)


def test_rate_sleeps_by_the_wall_clock_without_an_arena():
    began, rate = rospy.get_time(), rospy.Rate(50)
    for _ in range(5):
        rate.sleep()
    assert rospy.get_time() - began >= 0.09
