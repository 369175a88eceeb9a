"""Interface of a trajectory, and trajectories that are made from another trajectory or from samples."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from arena.errors import InputError
from arena.geometry import Array


@dataclass(frozen=True, kw_only=True)
class Reference:
    """Desired motion of a vehicle at one instant: position, velocity, acceleration and yaw.

    pos: position [m] [NED] (3,).  vel: velocity [m/s] [NED] (3,).  acc: acceleration without gravity [m/s2] [NED] (3,).
    yaw: [rad].  yaw_rate: [rad/s].
    """

    pos: Array
    vel: Array = field(default_factory=lambda: np.zeros(3))
    acc: Array = field(default_factory=lambda: np.zeros(3))
    yaw: float = 0.0
    yaw_rate: float = 0.0


class Trajectory(Protocol):
    """Interface of a trajectory: position, velocity, acceleration and yaw as functions of time, until its end.

    duration_s: time from the beginning to the end [s].
    """

    @property
    def duration_s(self) -> float: ...

    def at(self, t: float) -> Reference:
        """Return the reference (position, velocity, acceleration, yaw) at time `t` [s] after the beginning.

        Before the beginning and after the end the vehicle stands still.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class Moved:
    """Trajectory that shifts the positions of another trajectory by an offset.

    offset: [m] [NED] (3,)
    """

    trajectory: Trajectory
    offset: Array

    @property
    def duration_s(self) -> float:
        return self.trajectory.duration_s

    def at(self, t: float) -> Reference:
        found = self.trajectory.at(t)
        return Reference(
            pos=found.pos + self.offset, vel=found.vel, acc=found.acc, yaw=found.yaw, yaw_rate=found.yaw_rate
        )


def positions_along(trajectory: Trajectory, step_s: float = 0.05, most: int = 200) -> Array | None:
    """Return positions of a trajectory at equal time steps, from begin to end [m] [NED] (k, 3).

    None for classes outside `arena.trajectories`: their method `at` may be slow or have side effects.
    step_s: time between two positions [s], longer if there would be more than `most` positions.
    """
    inner = trajectory
    while type(inner) is Moved:
        inner = inner.trajectory
    if not type(inner).__module__.startswith("arena.trajectories."):
        return None
    count = min(max(int(trajectory.duration_s / step_s), 1) + 1, most)
    return np.array([trajectory.at(float(t)).pos for t in np.linspace(0.0, trajectory.duration_s, count)])


class Sampled:
    """Trajectory through samples (times and positions), for example from a CSV file.

    Positions follow cubic Hermite polynomials. Yaw is linear.

    t: times of the samples [s], increasing (n,).  pos: positions [m] [NED] (n, 3).
    vel: velocities [m/s] [NED] (n, 3); None: from central differences.  yaw: [rad] (n,), None: zero.
    Raises InputError if the shapes do not fit, a time does not increase, or a value is not finite.
    """

    def __init__(
        self, t: ArrayLike, pos: ArrayLike, vel: ArrayLike | None = None, yaw: ArrayLike | None = None
    ) -> None:
        self._t, self._pos = np.asarray(t, float), np.asarray(pos, float)
        n = self._t.size
        if n < 2 or self._t.shape != (n,) or self._pos.shape != (n, 3):
            raise InputError(
                f"trajectory: got times of shape {self._t.shape} and positions of shape {self._pos.shape}, expected (n,) and (n, 3) "
                "with n of at least 2"
            )
        if (np.diff(self._t) <= 0).any():
            row = int((np.diff(self._t) <= 0).argmax()) + 1
            raise InputError(
                f"trajectory: the time of row {row + 1} ({self._t[row]:g} s) is not later than that of the row before"
            )
        self._vel = (
            np.gradient(self._pos, self._t, axis=0) if vel is None else np.asarray(vel, float).reshape(n, 3)
        )
        self._yaw = np.zeros(n) if yaw is None else np.unwrap(np.asarray(yaw, float).reshape(n))
        for values in (self._t, self._pos, self._vel, self._yaw):
            if not np.isfinite(values).all():
                raise InputError("trajectory: got a value that is not a finite number")

    @property
    def duration_s(self) -> float:
        return float(self._t[-1] - self._t[0])

    def at(self, t: float) -> Reference:
        if not 0.0 <= t <= self.duration_s:
            end = 0 if t < 0.0 else -1
            return Reference(pos=self._pos[end].copy(), yaw=float(self._yaw[end]))
        at = self._t[0] + t
        k = min(int(np.searchsorted(self._t, at, side="right")) - 1, self._t.size - 2)
        h = self._t[k + 1] - self._t[k]
        u = (at - self._t[k]) / h
        p, q, v, w = self._pos[k], self._pos[k + 1], self._vel[k] * h, self._vel[k + 1] * h
        # Cubic Hermite basis and its derivatives: https://en.wikipedia.org/wiki/Cubic_Hermite_spline
        pos = (
            (1 + 2 * u) * (1 - u) ** 2 * p
            + u * (1 - u) ** 2 * v
            + u * u * (3 - 2 * u) * q
            + u * u * (u - 1) * w
        )
        slope = 6 * u * (u - 1) * (p - q) + (1 - u) * (1 - 3 * u) * v + u * (3 * u - 2) * w
        bend = 6 * (2 * u - 1) * (p - q) + (6 * u - 4) * v + (6 * u - 2) * w
        rate = (self._yaw[k + 1] - self._yaw[k]) / h
        return Reference(
            pos=pos,
            vel=slope / h,
            acc=bend / h**2,
            yaw=float(self._yaw[k] + rate * u * h),
            yaw_rate=float(rate),
        )


def from_rest(t: float, rise_s: float) -> tuple[float, float, float]:
    """Return a smooth rise from 0 to 1 at time `t`, and its first two derivatives [-], [1/s], [1/s2].

    The rise is the polynomial of degree five whose first and second derivatives are zero at both ends:
    10 u^3 - 15 u^4 + 6 u^5, with u = t / rise_s.
    t: time since the beginning of the rise [s].  rise_s: duration of the rise [s].
    """
    u = min(max(t / rise_s, 0.0), 1.0)
    return (
        u**3 * (10 - 15 * u + 6 * u * u),
        30 * u * u * (1 - u) ** 2 / rise_s,
        60 * u * (1 - u) * (1 - 2 * u) / rise_s**2,
    )
