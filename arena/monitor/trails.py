"""Trails (past paths) of all vehicles on the live page, as pieces of line segments. Pure.

A finished piece does not change, so a browser receives each piece once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arena.monitor.poses import world_positions

Array = NDArray[np.float64]


class Trails:
    """Recorder of the vehicles' trails. Call `add` a few times a second, and draw the result of `piece` each time.

    vehicles: number of vehicles.  steps: number of positions in a piece.
    number: count of finished pieces.
    """

    def __init__(self, vehicles: int, steps: int) -> None:
        self._steps = steps
        self._points: list[Array] = []
        self._rows = np.arange(vehicles)
        self.number = 0

    def add(self, p_n: Array) -> bool:
        """Add the present positions of all vehicles. Return True if the newest piece of the trails is now full.

        Then call `next_piece`.

        p_n: [m] [NED] (N, 3), NaN if unknown.
        """
        self._points.append(np.asarray(p_n, float).copy())
        return len(self._points) > self._steps

    def piece(self) -> tuple[Array, NDArray[np.int_]]:
        """Return the segments of the last piece of the trails [m] [world axes] (S, 2, 3), and their vehicle indices (S,)."""
        if len(self._points) < 2:
            return np.zeros((0, 2, 3)), np.zeros(0, int)
        points = np.stack(self._points)
        pairs = np.stack([points[:-1], points[1:]], axis=2)  # (steps, N, 2, 3)
        rows = np.broadcast_to(self._rows, pairs.shape[:2])
        known = np.isfinite(pairs).all(axis=(2, 3))
        pairs, rows = pairs[known], rows[known]
        return world_positions(pairs.reshape(-1, 3)).reshape(-1, 2, 3), rows

    def next_piece(self) -> None:
        """Start a new piece of all trails at the last positions."""
        self._points = self._points[-1:]
        self.number += 1
