"""Preflight check of the captured attitude against accelerometer and gyroscope. Pure.

Accelerometer and gyroscope do not depend on the poses.

The autopilot's estimate follows the poses, so it agrees with a rigid body that has wrong axes or belongs to another
vehicle. Two comparisons find such a body:

- gravity: at rest, the accelerometer and the captured attitude must have the same direction down. This does not show
  a body that is turned about the vertical axis, or another body that is level too;
- rotation: while somebody carries the vehicle, the captured body must turn as the gyroscope measures. Without enough
  motion there is no result.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np

from arena.constants import GRAVITY_M_S2
from arena.geometry import Array, quat_conj, quat_rotate
from arena.motion_check.rotation import Comparison, captured_rates, compare, mean_rates

IMU_MAX_AGE_S = 2.0
_REST_S = 1.0
_REST_RAD_S, _REST_M_S2 = 0.2, 1.0  # rate, and difference of the specific force from 1 g
_MIN_SAMPLES = 5
_WINDOW_S = 4.0
_EVALUATE_S = 0.5
_GAP_S = 0.25  # a longer gap between samples: the motion between them is not known
_MOVING_RAD_S, _MOVING_SHARE = 0.25, 0.3  # a window has enough motion if this share of it turns this fast
_STILL_RAD_S = 0.1
_FOLLOWS, _FOLLOWS_NOT = 0.85, 0.6


class PoseConsistency:
    """Comparison of one vehicle's captured attitude with its IMU, before arming.

    Pass the autopilot's messages to `on_autopilot` and each sent attitude to `on_attitude`. `reasons` returns why the
    vehicle must not be armed.
    tilt_deg: largest angle between the captured and the measured direction down [deg]
    imu_required: missing IMU data is a reason too
    """

    def __init__(self, tilt_deg: float, *, imu_required: bool) -> None:
        self._tilt_deg, self._required = tilt_deg, imu_required
        self.reset()

    def reset(self) -> None:
        """Delete all samples and results after a reboot or exchange of the autopilot."""
        self._imu: deque[tuple[float, tuple[float, ...]]] = deque()
        self._poses: deque[tuple[float, tuple[float, ...]]] = deque()
        self._tilt: float | None = None
        self._rotation = ""
        self._evaluated_at = -math.inf
        self._imu_at = -math.inf

    def on_autopilot(self, m: Any, now: float) -> None:
        """Store a HIGHRES_IMU message of the vehicle; ignore other messages.

        now: time of arrival [s].
        """
        if m.get_type() != "HIGHRES_IMU":
            return
        values = (m.xacc, m.yacc, m.zacc, m.xgyro, m.ygyro, m.zgyro)
        if all(map(math.isfinite, values)):
            self._imu_at = now
            self._imu.append((now, values))
            self._evaluate(now)

    def on_attitude(self, q_nb: Any, now: float) -> None:
        """Store the attitude of a pose that is sent to the vehicle. q_nb: [-] wxyz (4,)"""
        norm = math.sqrt(sum(x * x for x in q_nb))
        if math.isfinite(norm) and norm > 0.5:
            self._poses.append((now, tuple(x / norm for x in q_nb)))
            self._trim(now)

    def reasons(self, now: float) -> list[str]:
        """Return why the captured attitude forbids arming; empty if arming is allowed.

        Each text fits in one STATUSTEXT.
        """
        if now - self._imu_at > IMU_MAX_AGE_S:
            return ["no accelerometer data from the autopilot"] if self._required else []
        found = [self._rotation] if self._rotation else []
        if self._tilt is None:
            return [*found, "hold the vehicle still to compare tilt"] if self._required else found
        if self._tilt > self._tilt_deg:
            found.append(f"capture is {self._tilt:.0f} deg off gravity")
        return found

    def _evaluate(self, now: float) -> None:
        """Compare the newest attitudes of motion capture with the IMU, at most twice a second."""
        if now - self._evaluated_at < _EVALUATE_S:
            return
        self._evaluated_at = now
        self._trim(now)
        self._compare_gravity(now)
        self._compare_rotation()

    def _trim(self, now: float) -> None:
        for samples in (self._imu, self._poses):
            while samples and samples[0][0] < now - _WINDOW_S:
                samples.popleft()

    def _compare_gravity(self, now: float) -> None:
        imu = np.array([v for t, v in self._imu if t > now - _REST_S])
        poses = np.array([q for t, q in self._poses if t > now - _REST_S])
        if len(imu) < _MIN_SAMPLES or len(poses) < _MIN_SAMPLES:
            return
        force, rate = imu[:, :3], np.linalg.norm(imu[:, 3:], axis=1)
        mean = force.mean(axis=0)
        size = float(np.linalg.norm(mean))
        if rate.max() > _REST_RAD_S or abs(size - GRAVITY_M_S2) > _REST_M_S2:
            return
        down = quat_rotate(quat_conj(poses), np.array([0.0, 0.0, 1.0])).mean(axis=0)
        cosine = float(-(mean / size) @ down) / max(float(np.linalg.norm(down)), 1e-6)
        self._tilt = math.degrees(math.acos(min(1.0, max(-1.0, cosine))))

    def _compare_rotation(self) -> None:
        if len(self._imu) < 2 * _MIN_SAMPLES or len(self._poses) < 2 * _MIN_SAMPLES:
            return
        (imu_t, imu), (pose_t, poses) = _arrays(self._imu), _arrays(self._poses)
        if max(np.diff(imu_t).max(), np.diff(pose_t).max()) > _GAP_S:
            return
        captured, gyro = (
            captured_rates(pose_t, poses, _span(imu_t)),
            mean_rates(imu_t, imu[:, 3:], _span(imu_t)),
        )
        if not (_moves(captured[1]) or _moves(gyro[1])):
            return
        found = compare(captured, gyro)
        if found is not None:
            self._rotation = _verdict(found, self._rotation)


def _verdict(found: Comparison, before: str) -> str:
    """Return how the captured rotation differs from the gyroscope's, as text for the user; "" if it agrees.

    before: result of the comparison before this one. It is returned if this comparison is not clear.
    """
    if found.captured_rad_s < max(_STILL_RAD_S, 0.2 * found.gyro_rad_s):
        return "vehicle turned, its captured body did not"
    if found.gyro_rad_s < max(_STILL_RAD_S, 0.2 * found.captured_rad_s):
        return "captured body turned, the vehicle did not"
    if found.same_axes >= _FOLLOWS:
        return ""
    if found.any_axes >= _FOLLOWS:
        turned = found.turned_deg
        return "captured axes are not the gyro's" + (f" ({turned:.0f} deg)" if turned is not None else "")
    return "captured rotation is not the gyro's" if found.any_axes < _FOLLOWS_NOT else before


def _span(imu_t: Array) -> float:
    """Return the time over which angular rates are averaged before they are compared [s].

    It is at least four sample intervals of the IMU.
    """
    return max(0.1, 4.0 * float(np.median(np.diff(imu_t))))


def _moves(rates: Array) -> bool:
    return len(rates) > 0 and float((np.linalg.norm(rates, axis=1) > _MOVING_RAD_S).mean()) > _MOVING_SHARE


def _arrays(samples: deque[tuple[float, tuple[float, ...]]]) -> tuple[Array, Array]:
    return np.array([t for t, _ in samples]), np.array([v for _, v in samples])
