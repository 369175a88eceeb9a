"""Guided identity and axes check: right vehicles pass, every wrong body is named. review fault 2"""

from __future__ import annotations

import math

import numpy as np
import pytest
from carried import STANDING, Captured, Motion, axes, mirrored_y, mirrored_z

from arena.motion_check.guided_check import GuidedCheck
from arena.motion_check.guided_motion import Step

IMU_HZ, POSE_HZ, TICK_HZ = 50.0, 60.0, 20.0
BOOT_S = 812.3  # the autopilot's clock is ahead of this computer's clock by this time


class Bench:
    """A vehicle, its captured body and the other bodies of the room. Times are in simulated seconds.

    rough: factor on noise and bias of the inertial sensors
    late_s: time from a motion to the arrival of its pose at the autopilot
    telemetry_s: time from a sample of the inertial sensors to its arrival at this computer
    """

    def __init__(
        self, vehicle, body=None, *, late_s=0.03, telemetry_s=0.01, offset=True, rough=1.0, **others
    ):
        self._rough = rough
        self.vehicle, self.body, self.others = vehicle, body or Captured(moves=vehicle), others
        self.late_s, self.telemetry_s = late_s, telemetry_s
        self.offset_s = -BOOT_S if offset else None
        self.check = GuidedCheck("uav1", 10.0, 0.0)
        self.steps, self.texts = [Step.REST], [self.check.text]
        self._rng = np.random.default_rng(2)

    def run(self, limit_s: float = 90.0, imu=lambda t: True):
        events = [(k / hz, kind) for kind, hz in (("imu", IMU_HZ), ("pose", POSE_HZ), ("tick", TICK_HZ))
                  for k in range(1, int(limit_s * hz))]  # fmt: skip
        for now, kind in sorted(events):
            if self.check.verdict is not None:
                break
            if kind == "imu" and imu(now):
                self._imu(now)
            elif kind == "pose":
                self._poses(now)
            else:
                self.check.tick(now, self.offset_s)
            if self.check.step is not self.steps[-1]:
                self.steps.append(self.check.step)
            if self.check.text != self.texts[-1]:
                self.texts.append(self.check.text)
        assert self.check.verdict is not None, self.texts
        return self.check.verdict

    def _imu(self, now):
        force, rate = self.vehicle.imu(now - self.telemetry_s)
        force = force + self._rough * self._rng.normal(0.03, 0.05, 3)
        rate = rate + self._rough * self._rng.normal(0.003, 0.01, 3)
        self.check.on_imu(force, rate, now - self.telemetry_s + BOOT_S, now)

    def _poses(self, now):
        at = now - self.late_s
        if self.body.seen(now):
            self.check.on_pose(self.body.q_nb(at), self.body.p_n(at), now)
        for name, other in self.others.items():
            self.check.on_other(name, other.q_nb(at), now)


def test_a_right_vehicle_passes_every_step():
    bench = Bench(Motion(), uav2=Captured(moves=STANDING))
    verdict = bench.run()
    assert verdict.passed, verdict.problems
    assert bench.steps == list(Step)
    assert verdict.own.correlation > 0.97 and not verdict.others["uav2"].moves_with_vehicle
    assert verdict.axes.turned_deg < 2.0 and verdict.rise_m == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("late_s", [0.0, 0.02, 0.055, 0.15])
def test_the_delay_of_the_poses_is_measured(late_s):
    verdict = Bench(Motion(), late_s=late_s, telemetry_s=0.04).run()
    assert verdict.passed
    assert verdict.delay_s == pytest.approx(late_s, abs=0.005)
    assert 0.005 <= verdict.delay_error_s < 0.02


@pytest.mark.parametrize(("yaw_deg", "passes"), [(0.0, True), (15.0, False)])
def test_noisy_sensors_and_markers_do_not_change_the_verdict(yaw_deg, passes):
    vehicle = Motion(pace=0.8)
    body = Captured(moves=vehicle, axes=axes(yaw_deg=yaw_deg), noise_deg=0.3)
    verdict = Bench(vehicle, body, rough=3.0).run()
    assert verdict.passed is passes, verdict.problems
    assert not passes or abs(verdict.delay_s - 0.03) <= verdict.delay_error_s


def test_without_the_autopilots_clock_the_telemetry_delay_is_missing_from_the_result():
    verdict = Bench(Motion(), late_s=0.05, telemetry_s=0.03, offset=False).run()
    assert verdict.delay_s == pytest.approx(0.02, abs=0.006)


@pytest.mark.parametrize("other_moves", [STANDING, Motion(begin=2.7, pace=0.8, yaw_deg=-80.0)])
def test_the_motion_of_another_body_at_the_same_time_does_not_disturb(other_moves):
    verdict = Bench(Motion(), uav2=Captured(moves=other_moves)).run()
    assert verdict.passed, verdict.problems


def test_a_body_that_moves_with_the_vehicle_makes_the_identity_uncertain():
    vehicle = Motion()
    (problem,) = Bench(vehicle, uav2=Captured(moves=vehicle, axes=axes(yaw_deg=50.0))).run().problems
    assert "the body 'uav2' moved in the same way at the same time" in problem


def test_exchanged_bodies_are_named():
    vehicle = Motion()
    verdict = Bench(vehicle, Captured(moves=STANDING), uav2=Captured(moves=vehicle)).run()
    (problem,) = verdict.problems
    assert (
        "'uav1' did not move with the vehicle, but the body 'uav2' moved with it: they are exchanged"
        in problem
    )
    assert "Correct `mocap_body`" in problem


def test_exchanged_bodies_are_named_when_both_vehicles_are_carried():
    vehicle = Motion()
    other = Captured(moves=Motion(begin=3.1, pace=0.85))
    (problem,) = Bench(vehicle, other, uav2=Captured(moves=vehicle)).run().problems
    assert "they are exchanged" in problem


def test_a_body_that_nothing_moves_with_is_named():
    (problem,) = Bench(Motion(), Captured(moves=STANDING), uav2=Captured(moves=STANDING)).run().problems
    assert "'uav1' did not move with the vehicle (correlation" in problem


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (
            axes(yaw_deg=90.0),
            "turned by 90 deg about the vertical axis: its x axis points to the vehicle's right",
        ),
        (axes(yaw_deg=-90.0), "its x axis points to the vehicle's left"),
        (axes(yaw_deg=180.0), "its x axis points to the vehicle's back"),
        (axes(roll_deg=60.0), "rolled by 60 deg: its right side is too low"),
        (axes(pitch_deg=-20.0), "pitched by 20 deg: its nose is too low"),
        (axes(roll_deg=90.0, yaw_deg=90.0), "turned by 120 deg about the axis"),
    ],
)
def test_wrong_axes_are_named(wrong, words):
    vehicle = Motion()
    (problem,) = Bench(vehicle, Captured(moves=vehicle, axes=wrong)).run().problems
    assert words in problem and "define the rigid body again" in problem


@pytest.mark.parametrize(("yaw_deg", "passes"), [(6.0, True), (14.0, False)])
def test_the_limit_of_the_axes(yaw_deg, passes):
    vehicle = Motion()
    assert Bench(vehicle, Captured(moves=vehicle, axes=axes(yaw_deg=yaw_deg))).run().passed is passes


def test_mirrored_axes_are_named():
    vehicle = Motion()
    (problem,) = Bench(vehicle, Captured(moves=vehicle, mirror=mirrored_y)).run().problems
    assert "mirrored" in problem


def test_a_reversed_vertical_axis_does_not_pass():
    vehicle = Motion()

    class UpsideDown(Captured):
        def p_n(self, t):
            return vehicle.p_n(t) * np.array([1.0, 1.0, -1.0])

    problems = Bench(vehicle, UpsideDown(moves=vehicle, mirror=mirrored_z)).run().problems
    assert any("the z axis of the cameras points down" in problem for problem in problems)


def test_no_motion_ends_the_check():
    (problem,) = Bench(STANDING).run().problems
    assert "did not move as required in the step 'lift' (limit 60 s)" in problem


def test_a_too_slow_motion_is_refused_and_can_be_repeated():
    bench = Bench(Motion(pace=0.12))
    verdict = bench.run(200.0)
    assert any(text.startswith("Too slow: 0.") for text in bench.texts)
    assert not verdict.passed

    class SecondTry(Motion):
        def q_nb(self, t):
            slow = Motion(pace=0.12, begin=self.begin) if t < 45.0 else Motion(begin=45.0 - 1.9)
            return slow.q_nb(t)

        def p_n(self, t):
            return np.array(self.start) - np.array([0.0, 0.0, 0.5 * (2.5 < t < 53.0)])

        def imu(self, t):
            force, rate = super().imu(t)
            return quiet(force, self.q_nb(t)), rate

    bench = Bench(SecondTry())
    verdict = bench.run(200.0)
    assert any(text.startswith("Too slow: 0.") for text in bench.texts)
    assert verdict.passed, (verdict.problems, bench.texts)


def quiet(_, q):
    """Return the specific force at rest in an attitude."""
    return -9.80665 * np.array(
        [2 * (q[1] * q[3] - q[0] * q[2]), 2 * (q[2] * q[3] + q[0] * q[1]), 1 - 2 * (q[1] ** 2 + q[2] ** 2)]
    )


def test_capture_lost_during_the_motion_ends_the_check():
    vehicle = Motion()
    hidden = Captured(moves=vehicle, seen=lambda t: not 5.0 < t < 6.0)
    (problem,) = Bench(vehicle, hidden).run().problems
    assert problem.startswith("no pose of its body for 0.5 s during the motion")


def test_telemetry_lost_during_the_motion_ends_the_check():
    (problem,) = Bench(Motion()).run(imu=lambda t: not 5.0 < t < 6.0).problems
    assert problem.startswith("no data of its inertial sensors for 0.5 s during the motion")


@pytest.mark.parametrize("seen", [True, False])
def test_missing_data_before_the_motion_are_said(seen):
    bench = Bench(STANDING, Captured(moves=STANDING, seen=lambda t: seen))
    bench.run(imu=lambda t: not seen)
    missing = "No data of the inertial sensors" if seen else "No pose of its body"
    assert any(text.startswith(missing) for text in bench.texts), bench.texts


def test_a_tilt_in_another_direction_is_said():
    class RightFirst(Motion):
        def q_nb(self, t):
            w, x, y, z = super().q_nb(t)
            return np.array([w, -y, x, z])

    bench = Bench(RightFirst(yaw_deg=0.0))
    bench.run(120.0)
    assert any("The autopilot measures right side down" in text for text in bench.texts), bench.texts
    assert any("SENS_BOARD_ROT" in text for text in bench.texts)


def test_bad_numbers_do_not_pass():
    check = GuidedCheck("uav1", 10.0, 0.0)
    check.on_imu((math.nan, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0, 1.0)
    check.on_pose((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0)
    check.tick(1.0, None)
    assert check.step is Step.REST and check.verdict is None
