"""Newest position, velocity and attitude of each vehicle, from motion capture or from the autopilots. Pure.

A state that is too old is not returned. Untracked, repeated, frozen and late poses are not used.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from arena.emulated_sensors.body_filter import MIN_NOISE_M, BodyFilter, Motion, steady_gains
from arena.emulated_sensors.settings import Settings, Source, Vehicle
from arena.mocap.client import CapturedFrame, Pose, StreamLateness
from arena.wire.telemetry import Telemetry

CAPTURE_LIMIT_S = 0.1
"""Age above which a captured pose is not used [s]."""
ESTIMATE_LIMIT_S = 0.25
"""Age above which an estimate is not used [s]. Autopilots send 30 estimates per second."""

Triple = tuple[float, float, float]
Quad = tuple[float, float, float, float]


class State(NamedTuple):
    """Position, velocity and attitude of a vehicle.

    time_s: time to which it belongs, by the clock of the process [s].  p_n: [m] [NED].  v_n: [m/s] [NED].  q_nb: wxyz [-].
    """

    time_s: float
    p_n: Triple
    v_n: Triple
    q_nb: Quad


class CapturedStates:
    """States of the vehicles from motion capture.

    counts: number of poses that were not used, by reason.
    """

    def __init__(self, settings: Settings) -> None:
        self.counts: Counter[str] = Counter()
        self._noisy = settings.pose_noise_m > 0.0
        self._rows = {(v.simulated, v.body): row for row, v in enumerate(settings.vehicles)}
        gains = steady_gains(max(settings.pose_noise_m, MIN_NOISE_M), 1.0 / settings.frame_rate_hz)
        self._filters = [BodyFilter(gains) for _ in settings.vehicles]
        self._last: list[Pose | None] = [None for _ in settings.vehicles]
        self._states: list[State | None] = [None for _ in settings.vehicles]
        self._lateness = {simulated: StreamLateness(CAPTURE_LIMIT_S) for simulated in (True, False)}

    def on_frame(self, frame: CapturedFrame, simulated: bool, now: float) -> None:
        """Store the captured poses of a frame.

        simulated: True for a frame of the motion-capture emulator.  now: time of arrival [s].
        """
        if self._lateness[simulated].measure(frame, now) > CAPTURE_LIMIT_S:
            self.counts["late frame"] += 1
            return
        for pose in frame.poses:
            row = self._rows.get((simulated, pose.body))
            if row is not None:
                self._on_pose(row, pose, frame.time_s, now)

    def get(self, row: int, now: float) -> State | None:
        """Return the newest captured state of a vehicle; None if it is missing or too old.

        row: index of the vehicle.
        """
        state = self._states[row]
        return state if state is not None and 0.0 <= now - state.time_s <= CAPTURE_LIMIT_S else None

    def _on_pose(self, row: int, pose: Pose, exposed_s: float, now: float) -> None:
        last, self._last[row] = self._last[row], pose
        if self._noisy and last is not None and (pose.p_n, pose.q_nb) == (last.p_n, last.q_nb):
            self.counts["frozen pose"] += 1
            return
        motion: Motion | None = self._filters[row].add(pose.p_n, exposed_s)
        self._states[row] = None if motion is None else State(now, motion.p_n, motion.v_n, pose.q_nb)


class EstimatedStates:
    """States of the vehicles from the estimates in their telemetry.

    The messages are LOCAL_POSITION_NED and ATTITUDE_QUATERNION.
    """

    def __init__(self, vehicles: Sequence[Vehicle]) -> None:
        only = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION
        self._telemetry = [Telemetry(v.id, only) for v in vehicles]

    def on_datagram(self, row: int, data: bytes, now: float) -> None:
        """Store the estimates of position, velocity and attitude in a datagram of an autopilot.

        row: index of the vehicle.  now: time of arrival [s].
        """
        self._telemetry[row].on_datagram(data, now)

    def get(self, row: int, now: float) -> State | None:
        """Return the estimated state of a vehicle at the time `now` [s]; None if it is too old.

        The position is extrapolated from the last estimate with its velocity, because estimates of different vehicles arrive at
        different times. row: index of the vehicle.
        """
        local, attitude = self._telemetry[row].local, self._telemetry[row].attitude
        if local is None or attitude is None:
            return None
        age_s = now - local.received_at
        if not 0.0 <= age_s <= ESTIMATE_LIMIT_S or now - attitude.received_at > ESTIMATE_LIMIT_S:
            return None
        p, v, q = (local.pos + age_s * local.vel).tolist(), local.vel.tolist(), attitude.q_nb.tolist()
        return State(now, (p[0], p[1], p[2]), (v[0], v[1], v[2]), (q[0], q[1], q[2], q[3]))


class States:
    """States of all vehicles from both sources: motion capture and autopilots."""

    def __init__(self, settings: Settings) -> None:
        self.captured, self.estimated = CapturedStates(settings), EstimatedStates(settings.vehicles)

    def get(self, source: Source, row: int, now: float) -> State | None:
        """Return the newest state of a vehicle from motion capture or its autopilot; None if missing or too old."""
        return (self.captured if source == "mocap" else self.estimated).get(row, now)
