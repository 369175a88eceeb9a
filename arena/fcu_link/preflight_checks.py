"""Preflight checks of a real vehicle: connection, poses, estimate, position and battery. Pure.

Each reason fits in one STATUSTEXT of 50 bytes, because it is sent to the program that requested arming.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from arena.fcu_link.pose_consistency import PoseConsistency
from arena.fcu_link.settings import Preflight
from arena.geometry import yaw_from_quat

TEXT_BYTES = 50
CONNECTION_TIMEOUT_S = 1.5
_ESTIMATE_MAX_AGE_S = 0.5
_BATTERY_MAX_AGE_S = 5.0
_MIN_RATE_SHARE = 0.8
_WINDOW_S = 1.0
_MAX_BELOW_FLOOR_M = 0.05

Vector = tuple[float, float, float]


def sentence(text: str) -> str:
    """Return "Preflight: " and the text, cut to one STATUSTEXT (50 bytes).

    If both do not fit, the result is the first 50 bytes of the text.
    """
    full = f"Preflight: {text}"
    return full if len(full.encode()) <= TEXT_BYTES else text.encode()[:TEXT_BYTES].decode(errors="ignore")


class PreflightChecks:
    """Preflight checks of one vehicle: decides from telemetry and poses why it must not be armed.

    Pass the autopilot's messages to `on_autopilot` and each sent pose to `on_pose`. `reasons` returns the
    checks that fail.
    received_at: time of the autopilot's last frame [s]
    heartbeat_at: time of the autopilot's last heartbeat [s]
    """

    def __init__(self, preflight: Preflight) -> None:
        self._p = preflight
        self.received_at = -math.inf
        self.heartbeat_at = -math.inf
        self.armed = False
        self._consistency = PoseConsistency(preflight.tilt_deg, imu_required=preflight.imu)
        self.reset()

    def reset(self) -> None:
        """Delete all stored telemetry after a reboot of the autopilot."""
        self._local: tuple[float, Vector] | None = None
        self._yaw: tuple[float, float] | None = None
        self._on_ground_at = -math.inf
        self._battery: tuple[float, int] | None = None
        self._packs: dict[int, tuple[float, int]] = {}
        self._pose: tuple[float, Vector, float] | None = None
        self._poses: deque[float] = deque()
        self._consistency.reset()

    def restart_motion(self) -> None:
        """Repeat the comparison of captured attitude and IMU, because the vehicle may have been exchanged."""
        self._consistency.reset()

    def on_autopilot(self, m: Any, now: float) -> None:
        """Store the values that the preflight checks need from a message of the autopilot."""
        kind = m.get_type()
        if kind == "HEARTBEAT":
            self.heartbeat_at, self.armed = now, bool(m.base_mode & 128)
        elif kind == "LOCAL_POSITION_NED":
            self._local = now, (m.x, m.y, m.z)
        elif kind == "ATTITUDE":
            self._yaw = now, m.yaw
        elif kind == "ATTITUDE_QUATERNION":
            self._yaw = now, _yaw((m.q1, m.q2, m.q3, m.q4))
        elif kind == "SYS_STATUS":
            self._battery = now, m.battery_remaining
        elif kind == "BATTERY_STATUS":
            self._packs[m.id] = now, m.battery_remaining
        elif kind == "EXTENDED_SYS_STATE":
            landed = m.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
            self._on_ground_at = now if landed else -math.inf
        elif not self.armed and self._p.poses:
            self._consistency.on_autopilot(m, now)

    def on_ground(self, now: float) -> bool:
        """Return whether the autopilot reports that the vehicle is on the ground; False if this is unknown."""
        return now - self._on_ground_at <= CONNECTION_TIMEOUT_S

    def on_pose(self, m: Any, now: float) -> None:
        """Store a captured pose that is sent to the vehicle as ODOMETRY."""
        self._pose = now, (m.x, m.y, m.z), _yaw(m.q)
        self._poses.append(now)
        self._trim(now)
        if not self.armed:
            self._consistency.on_attitude(m.q, now)

    def reasons(self, now: float, more: Sequence[str] = ()) -> list[str]:
        """Return why the vehicle must not be armed, most severe first; empty if arming is allowed.

        more: reasons of other checks: RC transmitter, parameters, missing reboot.
        """
        found = [
            *self._connection(now),
            *(self._poses_reasons(now) if self._p.poses else self._estimate(now)),
            *(self._consistency.reasons(now) if self._p.poses else ()),
            *self._inside(now),
        ]
        return [sentence(text) for text in (*found, *self._charge(now), *more)]

    def pose_rate_hz(self, now: float) -> float:
        """Return the rate at which poses were sent in the last second [Hz]."""
        self._trim(now)
        return len(self._poses) / _WINDOW_S

    def _trim(self, now: float) -> None:
        while self._poses and self._poses[0] <= now - _WINDOW_S:
            self._poses.popleft()

    def _connection(self, now: float) -> list[str]:
        if self.received_at == -math.inf:
            return ["no telemetry received yet"]
        silent = now - self.received_at
        return [f"no telemetry for {silent:.1f} s"] if silent > CONNECTION_TIMEOUT_S else []

    def _poses_reasons(self, now: float) -> list[str]:
        """Return why the poses forbid arming: missing, old, too few, or different from the estimate."""
        if self._pose is None:
            return ["no pose received", *self._estimate(now)]
        at, p_n, yaw = self._pose
        age, rate, needs = now - at, self.pose_rate_hz(now), _MIN_RATE_SHARE * self._p.pose_rate_hz
        if age > self._p.pose_age_s:
            return [f"no pose for {age:.2f} s (limit {self._p.pose_age_s:g} s)", *self._estimate(now)]
        found = [f"{rate:.0f} poses/s, needs {needs:.0f}"] if rate < needs else []
        if not all(map(math.isfinite, (*p_n, yaw))):
            return [*found, "pose is not finite", *self._estimate(now)]
        return found + (self._estimate(now) or self._agreement(p_n, yaw))

    def _agreement(self, p_n: Vector, yaw: float) -> list[str]:
        """Return why arming is forbidden: captured position or yaw differs too much from the autopilot's estimate.

        The result is empty if both agree. Call this method only if `_estimate` has found no error.
        """
        assert self._local is not None and self._yaw is not None
        apart = math.dist(p_n, self._local[1])
        turned = abs(math.degrees(math.remainder(yaw - self._yaw[1], math.tau)))
        found = [] if apart <= self._p.position_m else [f"pose is {apart:.2f} m from the estimate"]
        return found + (
            [] if turned <= self._p.yaw_deg else [f"pose yaw is {turned:.0f} deg off the estimate"]
        )

    def _estimate(self, now: float) -> list[str]:
        """Return why the position or attitude estimate forbids arming: missing, old or not finite."""
        if self._local is None:
            return ["no position estimate"]
        if self._yaw is None:
            return ["no attitude estimate"]
        age = now - min(self._local[0], self._yaw[0])
        if age > _ESTIMATE_MAX_AGE_S:
            return [f"estimate is {age:.1f} s old (limit {_ESTIMATE_MAX_AGE_S:g} s)"]
        return [] if all(map(math.isfinite, (*self._local[1], self._yaw[1]))) else ["estimate is not finite"]

    def _inside(self, now: float) -> list[str]:
        known = self._pose if self._p.poses else self._local
        if known is None or not all(map(math.isfinite, known[1])):
            return []  # reported by another check
        (north, east, down), (size_n, size_e, height) = known[1], self._p.size_m
        walls = [
            (letter, x, half)
            for letter, x, half in (("N", north, size_n / 2), ("E", east, size_e / 2))
            if abs(x) > half
        ]
        found = [f"{letter} {x:.2f} m is outside +-{half:g} m" for letter, x, half in walls]
        lowest = -down - self._p.height_m
        if lowest < -_MAX_BELOW_FLOOR_M:
            found.append(f"{-lowest:.2f} m below the floor")
        if -down > height:
            found.append(f"height {-down:.2f} m is over {height:g} m")
        return found

    def _charge(self, now: float) -> list[str]:
        if self._p.battery <= 0.0:
            return []
        charge = self.charge_percent(now)
        if charge is None:
            return ["battery level unknown"]
        return (
            []
            if charge / 100.0 >= self._p.battery
            else [f"battery at {charge} %, needs {100 * self._p.battery:.0f} %"]
        )

    def charge_percent(self, now: float) -> int | None:
        """Return the battery charge [%] from SYS_STATUS, else the lowest charge in BATTERY_STATUS.

        Values older than 5 s are not used. None: unknown.
        """
        if (
            self._battery is not None
            and self._battery[1] >= 0
            and now - self._battery[0] <= _BATTERY_MAX_AGE_S
        ):
            return self._battery[1]
        packs = [
            charge for at, charge in self._packs.values() if charge >= 0 and now - at <= _BATTERY_MAX_AGE_S
        ]
        return min(packs, default=None)


def _yaw(q: Sequence[float]) -> float:
    """Return the yaw of an attitude quaternion (w, x, y, z) [rad]; NaN for an invalid quaternion."""
    norm = math.sqrt(sum(x * x for x in q))
    return (
        float(yaw_from_quat(np.asarray(q, float) / norm)) if math.isfinite(norm) and norm > 0.5 else math.nan
    )
