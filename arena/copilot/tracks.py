"""Tracks of the captured bodies: newest position, attitude, age and velocity of N vehicles.

Pure.

The velocity is the least-squares slope of the last nine poses. At 180 Hz and 0.3 mm noise its error is about
7 mm/s, and it is 25 ms late.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arena.constants import GRAVITY_M_S2
from arena.copilot.settings import STEP_HZ
from arena.portable_math import arccos

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TRAIL = 9
LATE_S = (TRAIL - 1) / 2 / 180.0
_LEAST = 5
_GAP_S = 0.25
_JUMP_M_S = 30.0  # faster than indoor flight: the body was lost or swapped, and the old slope is not valid
_MEMORY_S = 0.5
# stored steps of the copilot. After a pause, a few steps follow each other faster
_PAST = int(_MEMORY_S * STEP_HZ) + 7


class Tracks:
    """Recent captured poses of the rigid bodies of all vehicles.

    bodies: names of the bodies; row i of each returned array belongs to bodies[i].
    """

    def __init__(self, bodies: Sequence[str]) -> None:
        n = len(bodies)
        self._rows = {body: i for i, body in enumerate(bodies)}
        self._times = np.full((n, TRAIL), np.nan)
        self._places = np.full((n, TRAIL, 3), np.nan)
        self._count = [0] * n
        self._last: list[tuple[float, Sequence[float], Sequence[float]] | None] = [None] * n
        self.seen_at = np.full(n, -np.inf)
        self.repeated = self.restarted = 0
        self._past, self._past_at = np.full((_PAST, n, 3), np.nan), np.full(_PAST, -np.inf)
        self._steps = 0

    def on_pose(
        self,
        body: str,
        p_n: Sequence[float],
        q_nb: Sequence[float],
        time_s: float,
        now: float,
        late_s: float = 0.0,
    ) -> None:
        """Store a captured pose of a rigid body that the cameras track.

        time_s: exposure, by the cameras' clock [s]. now: time of arrival [s].
        late_s: lateness of the pose [s]; a late pose is as old as one that arrived earlier
        """
        i = self._rows.get(body)
        if i is None:
            return
        last = self._last[i]
        if last is not None:
            then, place, turn = last
            if tuple(place) == tuple(p_n) and tuple(turn) == tuple(q_nb):
                self.repeated += 1  # a frozen pose is no measurement
                return
            gap = time_s - then
            if (
                not 0.0 < gap < _GAP_S
                or max(abs(a - b) for a, b in zip(p_n, place, strict=True)) > _JUMP_M_S * gap
            ):
                self._times[i] = np.nan
                self._count[i] = 0
                self.restarted += 1
        at = self._count[i] % TRAIL
        self._count[i] += 1
        self._times[i, at] = time_s
        self._places[i, at] = p_n
        self._last[i] = time_s, p_n, q_nb
        self.seen_at[i] = now - late_s

    def positions(self, now: float) -> Array:
        """Return the newest captured positions [m] [NED] (N, 3); NaN before the first pose.

        Call it once per step, because `distance_to_track` uses the stored positions.
        """
        found = np.array(
            [(np.nan,) * 3 if pose is None else pose[1] for pose in self._last], dtype=np.float64
        ).reshape(-1, 3)
        self._past[now - self._past_at > _MEMORY_S] = np.nan
        at = self._steps % _PAST
        self._past[at], self._past_at[at] = found, now
        self._steps += 1
        return found

    def velocities(self) -> tuple[Array, Mask]:
        """Return the velocities [m/s] [NED] (N, 3), and a mask (N,): true where the velocity is known.

        An unknown velocity is zero.
        """
        has = np.isfinite(self._times)
        count = has.sum(1)
        t = np.where(has, self._times, 0.0)
        t = np.where(has, t - (t.sum(1) / np.maximum(count, 1))[:, None], 0.0)
        spread = (t * t).sum(1)
        known = (count >= _LEAST) & (spread > 1e-9)
        slope = np.einsum("nk,nkd->nd", t, np.where(has[:, :, None], self._places, 0.0))
        return np.where(known[:, None], slope / np.where(known, spread, 1.0)[:, None], 0.0), known

    def tilt_and_acceleration(self) -> tuple[Array, Array]:
        """Return the tilt [rad] (N,), and the horizontal acceleration that it causes [m/s2] [NED] (N, 3).

        The acceleration is that of a flight at constant height.
        """
        turns = [(1.0, 0.0, 0.0, 0.0) if pose is None else pose[2] for pose in self._last]
        w, x, y, z = np.array(turns, dtype=np.float64).reshape(-1, 4).T
        up = 1.0 - 2.0 * (x * x + y * y)
        north, east = -2.0 * (x * z + w * y), -2.0 * (y * z - w * x)
        scale = GRAVITY_M_S2 / np.maximum(up, 0.3)
        return arccos(np.clip(up, -1.0, 1.0)), np.column_stack(
            [north * scale, east * scale, np.zeros_like(north)]
        )

    def distance_to_track(self, p_n: Array) -> Array:
        """Return the distance [m] (N,) from each estimated position to the nearest recently captured position.

        NaN if unknown.

        The track is made of the captured positions of the last 0.5 s. The nearest of them counts.

        p_n: estimated positions [m] [NED] (N, 3). They are compared with the track, not with the newest pose,
        because an estimate arrives late and a fast body has moved since.
        """
        apart = self._past - p_n
        nearest: Array = np.sqrt(np.fmin.reduce((apart * apart).sum(2), axis=0))  # fmin ignores NaN
        return nearest
