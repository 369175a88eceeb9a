"""Publishes the path that a program plans to fly, for viewers and the record.

Nothing is sent to the vehicle.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from pymavlink.dialects.v20 import common as mavlink

from arena.errors import SetpointError, StaleDataError
from arena.geometry import Array
from arena.trajectories.trajectory import Trajectory, positions_along
from arena.wire.planned_path import path_messages

_SAME_M = 0.01
_LEAST_S = 0.5


class PathPublisher:
    """Publisher of one vehicle's planned path.

    send: sends a message to the recorder and returns at once; None without a recorder.
    """

    def __init__(self, send: Callable[[mavlink.MAVLink_message], None] | None) -> None:
        self._send = send
        self._time_us = 0
        self._goal: Array | None = None
        self._of_trajectory = False

    def publish(self, points: ArrayLike, now: float) -> None:
        """Publish a list of points as the planned path, for viewers and the record.

        points: [m] [NED] (k, 3); none removes the path.
        now: [s].

        Raises SetpointError if the points are not finite numbers of this shape.
        """
        found = np.asarray(points, float)
        if found.size == 0:
            found = np.zeros((0, 3))
        if found.ndim != 2 or found.shape[1] != 3 or not np.isfinite(found).all():
            raise SetpointError(
                f"planned_path: got points of shape {found.shape}, expected finite numbers (k, 3)"
            )
        self._goal = None
        self._publish(found, now)

    def publish_trajectory(self, trajectory: Trajectory, now: float) -> None:
        """Publish the path of a trajectory from `arena.trajectories`.

        Trajectories of other classes have no path to publish.

        now: [s].
        """
        points = positions_along(trajectory) if self._send is not None else None
        self._of_trajectory = points is not None
        if points is not None:
            self.publish(points, now)

    def end_trajectory(self, now: float) -> None:
        """Remove the path of a trajectory from the viewers, after the trajectory has ended.

        now: [s].
        """
        if self._of_trajectory:
            self.publish([], now)

    def publish_line(
        self, from_n: Callable[[], Array], goal: ArrayLike, duration_s: float, now: float
    ) -> None:
        """Publish the straight line to a new goal as the planned path, if the flight takes at least 0.5 s.

        from_n: returns the present position [m] [NED] (3,).  goal: [m] [NED] (3,).  duration_s: time of the flight [s].
        """
        if self._send is None or duration_s < _LEAST_S:
            return
        try:
            end = np.asarray(goal, float)
        except (TypeError, ValueError):
            return  # the setpoint reports what is wrong
        if end.shape != (3,) or not np.isfinite(end).all():
            return
        if self._goal is not None and np.abs(end - self._goal).max() < _SAME_M:
            return
        try:
            line = np.stack([np.asarray(from_n(), float), end])
        except StaleDataError:
            return
        self._goal = end
        self._publish(line, now)

    def _publish(self, points_n: Array, now: float) -> None:
        if self._send is None:
            return
        self._time_us = max(round(1e6 * now), self._time_us + 1)
        for message in path_messages(points_n, self._time_us):
            self._send(message)
