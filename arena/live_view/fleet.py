"""State of all vehicles of an arena, from telemetry, true states, motion capture and the supervisor. Pure.

Arrays have one row per vehicle, in the order of the settings. Values that are not known are NaN.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

from arena.constants import MAX_ROTORS
from arena.live_view.settings import Kind, VehicleSettings
from arena.mocap.client import CapturedFrame
from arena.wire.telemetry import Telemetry
from arena.wire.truth_page import Truth

Array = NDArray[np.float64]

STALE_S = 3.0
"""Telemetry that is older is not shown as the present state [s]."""
_POSE_STALE_S = 0.5
_RECEIVED = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,
    mavlink.MAVLINK_MSG_ID_ACTUATOR_CONTROL_TARGET,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT,
}


@dataclass(frozen=True, kw_only=True)
class FleetSnapshot:
    """State of all N vehicles of an arena at one instant.

    names, kinds, modes, controls: one entry per vehicle. mode: PX4's name, "" if unknown. control: who commands the vehicle.
    armed, landed, connected: None if unknown.
    p_n, v_n, q_nb, omega_b: best known state: true state if simulated, else the captured pose, else the estimate.
        [m] [NED] (N, 3), [m/s] [NED] (N, 3), [-] wxyz (N, 4), [rad/s] [FRD] (N, 3)
    has_true: whether p_n and q_nb are true or captured, not estimated (N,)
    est_p_n, est_v_n, est_q_nb, est_omega_b: the autopilot's estimate
    set_p_n, set_v_n, set_yaw: setpoint that the autopilot follows [m] [NED] (N, 3), [m/s] [NED] (N, 3), [rad] (N,)
    set_q_nb, set_thrust: attitude setpoint [-] wxyz (N, 4) and thrust 0..1 [-] (N,)
    motors: output of each rotor, 0..1 [-] (N, MAX_ROTORS)
    battery: remaining charge [%] (N,)
    pose_age_s: age of the last pose that the autopilot was sent [s] (N,)
    silent_s: time since the last message of the autopilot, without pauses of a replay [s] (N,); inf before the first
    texts: last STATUSTEXT of each vehicle, "" before the first
    """

    names: tuple[str, ...]
    kinds: tuple[Kind, ...]
    modes: tuple[str, ...]
    armed: tuple[bool | None, ...]
    landed: tuple[bool | None, ...]
    connected: tuple[bool | None, ...]
    controls: tuple[str, ...]
    texts: tuple[str, ...]
    p_n: Array
    v_n: Array
    q_nb: Array
    omega_b: Array
    has_true: NDArray[np.bool_]
    est_p_n: Array
    est_v_n: Array
    est_q_nb: Array
    est_omega_b: Array
    set_p_n: Array
    set_v_n: Array
    set_yaw: Array
    set_q_nb: Array
    set_thrust: Array
    motors: Array
    battery: Array
    pose_age_s: Array
    silent_s: Array


class FleetTracker:
    """Collector of the newest state of all vehicles. All times `now` are times of `ShownTime` [s].

    Pass received data to the `on_...` methods, and call `snapshot` when a picture is drawn.
    """

    def __init__(self, vehicles: tuple[VehicleSettings, ...]) -> None:
        self._vehicles = vehicles
        self.telemetry = tuple(Telemetry(v.id, _RECEIVED) for v in vehicles)
        self._rows_of_truth = np.array([i for i, v in enumerate(vehicles) if v.index is not None], dtype=int)
        self._indices = np.array([v.index for v in vehicles if v.index is not None], dtype=int)
        self._bodies = {v.body: i for i, v in enumerate(vehicles) if v.index is None}
        n = len(vehicles)
        self._p_n, self._v_n, self._q_nb = _unknown(n, 3), _unknown(n, 3), _unknown(n, 4)
        self._omega_b, self._motors = _unknown(n, 3), _unknown(n, MAX_ROTORS)
        self._posed_at = np.full(n, -np.inf)
        self._facts: Mapping[str, Any] = {}
        self._pose_age_s = np.full(n, np.nan)

    def on_datagram(self, row: int, data: bytes, now: float) -> None:
        """Update the state of a vehicle from a MAVLink datagram. row: index of the vehicle."""
        self.telemetry[row].on_datagram(data, now)

    def on_truth(self, truth: Truth, now: float) -> None:
        """Store the true states of the simulated vehicles."""
        rows, at = self._rows_of_truth, self._indices
        self._p_n[rows], self._v_n[rows], self._q_nb[rows] = truth.p_n[at], truth.v_n[at], truth.q_nb[at]
        self._omega_b[rows], self._motors[rows] = truth.omega_b[at], truth.motors[at]
        self._posed_at[rows] = now

    def on_frames(self, frames: Iterable[CapturedFrame], now: float) -> None:
        """Store the captured poses of the real vehicles."""
        for frame in frames:
            for pose in frame.poses:
                if (row := self._bodies.get(pose.body)) is not None:
                    self._p_n[row], self._q_nb[row] = pose.p_n, pose.q_nb
                    self._posed_at[row] = now

    def on_status(self, status: Mapping[str, Any]) -> None:
        """Store the vehicle states (such as `armed`) and pose ages that the supervisor has reported.

        status: reply of the supervisor to the request `view`.
        """
        self._facts = status.get("facts") or {}
        ages = {
            row.get("vehicle"): (row.get("stats") or {}).get("pose_age_ms")
            for row in (status.get("processes") or {}).values()
            if row.get("kind") == "forward"
        }
        self._pose_age_s[:] = [
            np.nan if (age := ages.get(v.name)) is None else 1e-3 * age for v in self._vehicles
        ]

    def snapshot(self, now: float) -> FleetSnapshot:
        """Return the state of all vehicles at the time `now`."""
        n = len(self._vehicles)
        est_p, est_v, est_q, est_w = _unknown(n, 3), _unknown(n, 3), _unknown(n, 4), _unknown(n, 3)
        set_p, set_v, set_yaw = _unknown(n, 3), _unknown(n, 3), np.full(n, np.nan)
        set_q, set_thrust, battery = _unknown(n, 4), np.full(n, np.nan), np.full(n, np.nan)
        motors, silent_s = self._motors.copy(), np.full(n, np.inf)
        for i, t in enumerate(self.telemetry):
            if t.received_at is None:
                continue
            silent_s[i] = now - t.received_at
            oldest = now - STALE_S
            if (local := t.local) is not None and local.received_at >= oldest:
                est_p[i], est_v[i] = local.pos, local.vel
            if (attitude := t.attitude) is not None and attitude.received_at >= oldest:
                est_q[i], est_w[i] = attitude.q_nb, attitude.ang_vel
            if (reference := t.reference) is not None and reference.received_at >= oldest:
                set_p[i], set_v[i], set_yaw[i] = reference.pos, reference.vel, reference.yaw
            if (target := t.attitude_reference) is not None and target.received_at >= oldest:
                set_q[i], set_thrust[i] = target.q_nb, target.thrust
            if (status := t.status) is not None:
                battery[i] = status.battery
            if self._vehicles[i].index is None and (actuators := t.actuators) is not None:
                motors[i] = actuators.output[:MAX_ROTORS] if actuators.received_at >= oldest else np.nan
        has_true = now - self._posed_at <= _POSE_STALE_S
        return FleetSnapshot(
            names=tuple(v.name for v in self._vehicles),
            kinds=tuple(v.kind for v in self._vehicles),
            modes=tuple(self._mode(i, now) for i in range(n)),
            armed=tuple(self._armed(i, now) for i in range(n)),
            landed=tuple(self._landed(i, now) for i in range(n)),
            connected=tuple(self._fact(i, "connected") for i in range(n)),
            controls=tuple(str(self._fact(i, "control") or "") for i in range(n)),
            texts=tuple(t.texts[-1].text if t.texts else "" for t in self.telemetry),
            p_n=np.where(has_true[:, None], self._p_n, est_p),
            v_n=np.where((has_true & np.isfinite(self._v_n[:, 0]))[:, None], self._v_n, est_v),
            q_nb=np.where(has_true[:, None], self._q_nb, est_q),
            omega_b=np.where((has_true & np.isfinite(self._omega_b[:, 0]))[:, None], self._omega_b, est_w),
            has_true=has_true,
            est_p_n=est_p,
            est_v_n=est_v,
            est_q_nb=est_q,
            est_omega_b=est_w,
            set_p_n=set_p,
            set_v_n=set_v,
            set_yaw=set_yaw,
            set_q_nb=set_q,
            set_thrust=set_thrust,
            motors=motors,
            battery=battery,
            pose_age_s=self._pose_age_s.copy(),
            silent_s=silent_s,
        )

    def _fact(self, row: int, name: str) -> Any:
        return self._facts.get(f"{self._vehicles[row].name}.{name}")

    def _armed(self, row: int, now: float) -> bool | None:
        heartbeat = self.telemetry[row].heartbeat
        if heartbeat is not None and now - heartbeat.received_at <= STALE_S:
            return heartbeat.armed
        return self._reported(row, "armed")

    def _landed(self, row: int, now: float) -> bool | None:
        ground = self.telemetry[row].ground
        if ground is not None and now - ground.received_at <= STALE_S:
            return ground.landed
        return self._reported(row, "landed")

    def _reported(self, row: int, name: str) -> bool | None:
        """Return a vehicle state from the supervisor, such as `armed`; None if the vehicle is not connected.

        The state of a vehicle that is not connected may have changed.
        """
        value: bool | None = self._fact(row, name)
        return None if self._fact(row, "connected") is False else value

    def _mode(self, row: int, now: float) -> str:
        heartbeat = self.telemetry[row].heartbeat
        if heartbeat is not None and now - heartbeat.received_at <= STALE_S:
            return heartbeat.mode
        return str(self._fact(row, "mode") or "")


def _unknown(rows: int, columns: int) -> Array:
    return np.full((rows, columns), np.nan)
