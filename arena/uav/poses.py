"""Newest motion-capture poses of the program's own body and of its neighbours. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arena.geometry import Array

_TRAIL_LENGTH = 9  # at 180 Hz and 0.3 mm of noise a slope over nine poses is good to some 7 mm/s


@dataclass(frozen=True, kw_only=True, slots=True)
class Pose:
    """Pose as plain numbers. Up to some hundred poses arrive per second, so numpy arrays are made only when a program reads them.

    received_at: time of arrival [s].
    position: [m] [NED] (3,).
    quaternion: q_nb [-] wxyz (4,).
    trail: (time [s], position) of the last poses.
    """

    received_at: float
    position: Sequence[float]
    quaternion: Sequence[float]
    trail: tuple[tuple[float, Sequence[float]], ...]

    @property
    def p_n(self) -> Array:
        """Position of the body origin [m] [NED] (3,)."""
        return np.array(self.position, dtype=np.float64)

    @property
    def q_nb(self) -> Array:
        """Attitude [-] wxyz (4,)."""
        return np.array(self.quaternion, dtype=np.float64)

    @property
    def v_n(self) -> Array:
        """Velocity [m/s] [NED] (3,): least-squares slope of the last positions over time; zero while only one pose has arrived."""
        times = np.array([t for t, _ in self.trail])
        times -= times.mean()
        spread = float(times @ times)
        return times @ np.array([p for _, p in self.trail]) / spread if spread > 0.0 else np.zeros(3)


class Poses:
    """Newest poses of the program's own body and of its neighbours.

    own, neighbours: the newest poses, None before the first pose arrives.
    body: name of the program's own rigid body in the capture system, None if it has none.
    neighbours: (vehicle, rigid body) of each neighbour.
    """

    def __init__(self, body: str | None, neighbours: Sequence[tuple[str, str]] = ()) -> None:
        self.neighbour_names = tuple(name for name, _ in neighbours)
        self.neighbours: tuple[Pose | None, ...] = (None,) * len(neighbours)
        self.own: Pose | None = None
        self._body = body
        self._rows = {b: i for i, (_, b) in enumerate(neighbours)}

    @property
    def bodies(self) -> list[str]:
        """Names of the rigid bodies to request from motion capture."""
        return [*([] if self._body is None else [self._body]), *self._rows]

    def receive(
        self, body: str, p_n: Sequence[float], q_nb: Sequence[float], time_s: float, now: float
    ) -> None:
        """Store the pose of a tracked body.

        time_s: exposure, by the capture system's clock [s]. now: time of arrival [s].
        """
        if body == self._body:
            self.own = _next(self.own, p_n, q_nb, time_s, now)
        row = self._rows.get(body)
        if row is not None:
            pose = _next(self.neighbours[row], p_n, q_nb, time_s, now)
            self.neighbours = (*self.neighbours[:row], pose, *self.neighbours[row + 1 :])


def _next(last: Pose | None, p_n: Sequence[float], q_nb: Sequence[float], time_s: float, now: float) -> Pose:
    trail = () if last is None else last.trail[1 - _TRAIL_LENGTH :]
    if trail and not trail[-1][0] < time_s < trail[-1][0] + 0.25:
        trail = ()  # the capture system restarted or lost the body: the old slope is not valid
    return Pose(received_at=now, position=p_n, quaternion=q_nb, trail=(*trail, (time_s, p_n)))
