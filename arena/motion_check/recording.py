"""Recording of a vehicle's motion during a check: inertial sensors and captured bodies. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from arena.constants import GRAVITY_M_S2
from arena.geometry import Array, quat_conj, quat_rotate

_CLOSEST_S = 0.01  # samples of another body that follow faster are left out
_DOWN_N = np.array([0.0, 0.0, 1.0])


@dataclass(kw_only=True)
class Recording:
    """Samples of inertial sensors and of captured bodies since the start of a motion.

    imu_at: times of arrival [s]; imu_boot: times by the autopilot's clock [s]; accel_b: specific force [m/s2] [FRD];
        gyro_b: rotation rate [rad/s] [FRD]
    pose_at: times at which poses were sent to the autopilot [s]; q_nb: their attitudes [-] wxyz; p_n: positions [m] [NED]
    others: other body -> times [s] and attitudes [-] wxyz
    """

    imu_at: list[float] = field(default_factory=list)
    imu_boot: list[float] = field(default_factory=list)
    accel_b: list[Sequence[float]] = field(default_factory=list)
    gyro_b: list[Sequence[float]] = field(default_factory=list)
    pose_at: list[float] = field(default_factory=list)
    q_nb: list[Sequence[float]] = field(default_factory=list)
    p_n: list[Sequence[float]] = field(default_factory=list)
    others: dict[str, tuple[list[float], list[Sequence[float]]]] = field(default_factory=dict)

    def add_imu(self, at: float, boot_s: float, accel_b: Sequence[float], gyro_b: Sequence[float]) -> None:
        """Add a sample of the inertial sensors.

        A sample that is not newer than the last one is skipped.
        """
        if self.imu_boot and boot_s <= self.imu_boot[-1]:
            return
        self.imu_at.append(at)
        self.imu_boot.append(boot_s)
        self.accel_b.append(accel_b)
        self.gyro_b.append(gyro_b)

    def add_pose(self, at: float, q_nb: Sequence[float], p_n: Sequence[float]) -> None:
        """Add a pose that was sent to the autopilot."""
        if not self.pose_at or at > self.pose_at[-1]:
            self.pose_at.append(at)
            self.q_nb.append(q_nb)
            self.p_n.append(p_n)

    def add_other(self, body: str, at: float, q_nb: Sequence[float]) -> None:
        """Add the attitude of a captured body that is not the vehicle's own."""
        times, attitudes = self.others.setdefault(body, ([], []))
        if not times or at - times[-1] >= _CLOSEST_S:
            times.append(at)
            attitudes.append(q_nb)

    def imu_times(self, offset_s: float | None) -> Array:
        """Return the times of the inertial samples by this computer's clock [s] (N,).

        offset_s: this clock minus the autopilot's clock [s]; None: unknown, then the times of arrival
        """
        return np.array(self.imu_at) if offset_s is None else np.array(self.imu_boot) + offset_s

    def rise_m(self, begin: float) -> float:
        """Return the greatest height of the captured body above its position at the time `begin` [m]."""
        down = [p[2] for at, p in zip(self.pose_at, self.p_n, strict=True) if at >= begin]
        return down[0] - min(down) if down else 0.0


def captured_down(times: Array, at: list[float], q_nb: list[Sequence[float]]) -> Array:
    """Compute the direction of gravity in body axes from captured attitudes [-] [FRD] (N, 3).

    The captured attitudes are interpolated.

    times: [s] (N,). at, q_nb: times [s] and values [-] wxyz of the captured attitudes
    """
    down = quat_rotate(quat_conj(np.array(q_nb)), _DOWN_N)
    return np.stack([np.interp(times, np.array(at), down[:, k]) for k in range(3)], axis=-1)


def measured_down(accel_b: Sequence[float]) -> tuple[float, float, float] | None:
    """Return the direction of gravity from the accelerometer [-] [FRD] (3,); None while the vehicle accelerates.

    An accelerating vehicle measures more than gravity.

    accel_b: mean specific force [m/s2] [FRD]
    """
    size = math.sqrt(sum(x * x for x in accel_b))
    if abs(size - GRAVITY_M_S2) > 2.0:
        return None
    return -accel_b[0] / size, -accel_b[1] / size, -accel_b[2] / size
