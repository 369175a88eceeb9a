"""Newest motion capture pose of the program's own rigid body. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from arena.geometry import Array


class Pose(NamedTuple):
    """Motion capture pose of one rigid body, as plain numbers.

    180 poses arrive per second, so numpy arrays are made only when a program reads them.

    received_at: time of arrival [s].
    position: [m] [NED] (3,).
    quaternion: q_nb [-] wxyz (4,).
    """

    received_at: float
    position: Sequence[float]
    quaternion: Sequence[float]

    @property
    def p_n(self) -> Array:
        """Position of the body origin [m] [NED] (3,)."""
        return np.array(self.position, dtype=np.float64)

    @property
    def q_nb(self) -> Array:
        """Attitude [-] wxyz (4,)."""
        return np.array(self.quaternion, dtype=np.float64)


class Poses:
    """Newest motion capture pose of the program's own rigid body.

    own: the newest pose, None before the first pose arrives.
    body: name of the program's own rigid body in the capture system, None if it has none.
    """

    def __init__(self, body: str | None) -> None:
        self.own: Pose | None = None
        self.body = body

    def receive(self, body: str, p_n: Sequence[float], q_nb: Sequence[float], now: float) -> None:
        """Store a captured pose, if it is that of the program's own rigid body.

        now: time of arrival [s].
        """
        if body == self.body:
            self.own = Pose(received_at=now, position=p_n, quaternion=q_nb)
