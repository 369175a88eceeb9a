"""Conversion of the telemetry, poses and ground truth of one vehicle to the rows of its log. Pure.

A row belongs to one instant. The row is written later, when each measured group has a sample before and after that
instant.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from arena.constants import MAX_ROTORS
from arena.geometry import Array, euler_from_quat, quat_conj, quat_log, quat_multiply, quat_rotate
from arena.recorder.columns import columns
from arena.recorder.samples import MAX_GAP_S, Held, Series, leading_quaternion, position_velocity
from arena.wire.telemetry import Telemetry
from arena.wire.telemetry_values import (
    Actuators,
    Attitude,
    AttitudeReference,
    Baro,
    Ground,
    HeartbeatState,
    Imu,
    Local,
    Mag,
    Reference,
    Status,
)
from arena.wire.truth_page import Truth

SETPOINT_MAX_AGE_S, STATE_MAX_AGE_S, BATTERY_MAX_AGE_S = 0.5, 3.0, 10.0
_PROGRAM = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
_PROGRAM_BYTES = bytes([_PROGRAM])
_NAN3, _NAN4, _NAN6, _NAN7, _NAN_OUTPUTS = (np.full(n, np.nan) for n in (3, 4, 6, 7, MAX_ROTORS))

Cell = float | str | bool


@dataclass(frozen=True, kw_only=True)
class _Pending:
    """A row of the log that was requested but is not written yet, because its interpolation needs later samples.

    time_s: time of the row, by the clock of the logger [s].  stamp: value of the first column [s].
    """

    time_s: float
    stamp: float
    truth: Truth | None


class Recorder:
    """Computes the rows of one vehicle's log from received telemetry, poses and ground truth. Returns the rows as text.

    system_id: MAV_SYS_ID of the vehicle.
    index: row of the vehicle in the truth page (ground truth in shared memory); None for a real vehicle.
    """

    def __init__(self, system_id: int, index: int | None) -> None:
        self.telemetry = Telemetry(system_id)
        self.datagrams = self.poses = self.rows = 0
        self.first_received: float | None = None
        self._index = index
        self._program = Telemetry(system_id, {mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED}, _PROGRAM)
        self._local = Series(position_velocity)
        self._attitude, self._pose = Series(leading_quaternion), Series(leading_quaternion)
        self._imu, self._mag, self._baro = Series(), Series(), Series()
        self._heart, self._ground = Held[HeartbeatState](STATE_MAX_AGE_S), Held[Ground](STATE_MAX_AGE_S)
        self._status = Held[Status](BATTERY_MAX_AGE_S)
        self._setpoint = Held[Reference](SETPOINT_MAX_AGE_S)
        self._program_reference = Held[Reference](SETPOINT_MAX_AGE_S)
        self._attitude_setpoint = Held[AttitudeReference](SETPOINT_MAX_AGE_S)
        self._actuators = Held[Actuators](SETPOINT_MAX_AGE_S)
        self._taken: tuple[Local | None, Attitude | None, Imu | None, Mag | None, Baro | None] = (None,) * 5
        self._pending: deque[_Pending] = deque()

    @property
    def header(self) -> str:
        """First line of the log, with the names of the columns."""
        return ",".join(columns(self._index is not None)) + "\n"

    @property
    def armed(self) -> bool:
        """Armed flag of the last heartbeat; false before the first one."""
        heart = self.telemetry.heartbeat
        return heart is not None and heart.armed

    # -- received data

    def receive(self, datagram: bytes, now: float) -> None:
        """Decode one datagram from the vehicle or from its user program. now: local time of reception [s]."""
        if datagram[6:7] == _PROGRAM_BYTES and self._program.on_datagram(datagram, now):
            self._take_program_reference(now)
            return
        self.datagrams += 1
        if not self.telemetry.on_datagram(datagram, now):
            return
        if self.first_received is None:
            self.first_received = now
        self._take_measurements(now)
        self._take_states(now)

    def receive_pose(
        self, p_n: Sequence[float] | Array, q_nb: Sequence[float] | Array, exposed: float, now: float
    ) -> None:
        """Add a motion-capture pose of the vehicle.

        p_n: position of the body origin [m] [NED] (3,).  q_nb: attitude [-] wxyz (4,).
        exposed: time of exposure, by the clock of the motion-capture server [s].  now: local time of reception [s].
        """
        self.poses += 1
        self._pose.receive(exposed, now, np.concatenate([q_nb, p_n]))

    def _take_measurements(self, now: float) -> None:
        """Add the measurements that have arrived since the last call. Measurements that were added before are skipped.

        Objects are compared, not times, because the clock of the logger may not have advanced since the last call. A second
        copy would have the time of its reception.
        """
        telemetry, before = self.telemetry, self._taken
        newest = (telemetry.local, telemetry.attitude, telemetry.imu, telemetry.mag, telemetry.baro)
        self._taken = newest
        local, attitude, imu, mag, baro = newest
        if local is not None and local is not before[0]:
            self._local.receive(local.boot_s, now, np.concatenate([local.pos, local.vel]))
        if attitude is not None and attitude is not before[1]:
            self._attitude.receive(attitude.boot_s, now, np.concatenate([attitude.q_nb, attitude.ang_vel]))
        if imu is None or imu is before[2]:
            return
        self._imu.receive(imu.boot_s, now, np.concatenate([imu.acc_body, imu.ang_vel]))
        if mag is not None and mag is not before[3]:
            self._mag.receive(imu.boot_s, now, mag.mag)
        if baro is not None and baro is not before[4]:
            air = np.array([baro.pressure, baro.temperature, baro.alt])
            self._baro.receive(imu.boot_s, now, air)

    def _take_states(self, now: float) -> None:
        telemetry = self.telemetry
        if (heart := telemetry.heartbeat) is not None and heart.received_at == now:
            self._heart.add(now, heart)
        if (ground := telemetry.ground) is not None and ground.received_at == now:
            self._ground.add(now, ground)
        if (status := telemetry.status) is not None and status.received_at == now:
            self._status.add(now, status)
        if (setpoint := telemetry.reference) is not None and setpoint.received_at == now:
            self._setpoint.receive(setpoint.boot_s, now, setpoint)
        if (wanted := telemetry.attitude_reference) is not None and wanted.received_at == now:
            self._attitude_setpoint.receive(wanted.boot_s, now, wanted)
        if (actuators := telemetry.actuators) is not None and actuators.received_at == now:
            self._actuators.add(now, actuators)

    def _take_program_reference(self, now: float) -> None:
        if (reference := self._program.reference) is not None:
            self._program_reference.receive(reference.boot_s, now, reference)

    # -- rows

    def sample(self, now: float, stamp: float, truth: Truth | None = None) -> None:
        """Request a row for the instant `now`. `take_rows` returns the row when it is complete.

        now: local time of the row [s].  stamp: value of its first column [s].
        truth: ground truth of the simulated world at `now`.
        """
        self._pending.append(_Pending(time_s=now, stamp=stamp, truth=truth))

    def take_rows(self, now: float = math.inf) -> Iterator[str]:
        """Yield the requested rows that are complete or older than MAX_GAP_S, oldest first, as lines of text.

        now: local time [s]; without this argument all remaining rows.
        """
        while self._pending:
            oldest = self._pending[0]
            if now - oldest.time_s <= MAX_GAP_S and self._is_incomplete(oldest.time_s):
                return
            self._pending.popleft()
            yield self.row(oldest.time_s, oldest.stamp, oldest.truth)

    def _is_incomplete(self, time_s: float) -> bool:
        measured = (self._local, self._attitude, self._imu, self._pose)
        return any(series.waits_for(time_s) for series in measured)

    def row(self, time_s: float, stamp: float, truth: Truth | None = None) -> str:
        """Return the row of the log for the instant `time_s` [s, local time] as a line of text.

        stamp, truth: as in `sample`.
        """
        self.rows += 1
        local, attitude = self._local.at(time_s), self._attitude.at(time_s)
        cells: list[Cell] = [f"{stamp:.4f}", *_estimate(local, attitude), *self._imu_cells(time_s)]
        cells += self._pose_cells(time_s)
        cells += self._info(time_s)
        cells += self._references(time_s)
        if self._index is not None:
            cells += self._truth(truth, local, attitude)
        return ",".join(map(_text, cells)) + "\n"

    def _imu_cells(self, time_s: float) -> list[Cell]:
        return _flat(_or(self._imu.at(time_s), _NAN6), _or(self._mag.at(time_s), _NAN3))

    def _pose_cells(self, time_s: float) -> list[Cell]:
        pose = _or(self._pose.at(time_s), _NAN7)
        q_nb, p_n = pose[:4], pose[4:]
        return _flat(p_n, q_nb, euler_from_quat(q_nb))

    def _info(self, time_s: float) -> list[Cell]:
        heart, ground, status = (
            self._heart.at(time_s),
            self._ground.at(time_s),
            self._status.at(time_s),
        )
        return [
            heart.mode if heart is not None else "",
            heart.armed if heart is not None else "",
            ground.landed if ground is not None else "",
            status.battery if status is not None else "",
        ]

    def _references(self, time_s: float) -> list[Cell]:
        """Return the values of references, setpoints and actuator outputs: the columns from pos_ref to
        act.output, in the order of `arena.recorder.columns`.
        """
        pos, vel, yaw = self._position_reference(time_s)
        q_nb, rates, thrust = _NAN4, _NAN3, math.nan
        if (wanted := self._attitude_setpoint.at(time_s)) is not None:
            q_nb, rates, thrust = wanted.q_nb, wanted.ang_vel, wanted.thrust
        actuators = self._actuators.at(time_s)
        outputs = actuators.output if actuators is not None else _NAN_OUTPUTS
        air = _or(self._baro.at(time_s), _NAN3)
        return _flat(pos, euler_from_quat(q_nb), [yaw], vel, q_nb, rates, [thrust], air, outputs)

    def _position_reference(self, time_s: float) -> tuple[Array, Array, float]:
        """Return the position, velocity and yaw references [NED]. They are from the user program if it
        publishes them, else from the setpoint.

        The setpoint is the one that the autopilot reports. NaN if unknown.
        """
        pos, vel, yaw = _NAN3, _NAN3, math.nan
        for reference in (self._setpoint.at(time_s), self._program_reference.at(time_s)):
            if reference is not None:
                pos = np.where(np.isfinite(reference.pos), reference.pos, pos)
                vel = np.where(np.isfinite(reference.vel), reference.vel, vel)
                yaw = reference.yaw if math.isfinite(reference.yaw) else yaw
        return pos, vel, yaw

    def _truth(self, truth: Truth | None, local: Array | None, attitude: Array | None) -> list[Cell]:
        if truth is None:
            return [math.nan] * 25
        i = self._index or 0
        q_nb = truth.q_nb[i]
        error = _NAN6 if local is None else local - np.concatenate([truth.p_n[i], truth.v_n[i]])
        turned = _NAN3 if attitude is None else quat_log(quat_multiply(quat_conj(q_nb), attitude[:4]))
        return _flat(truth.p_n[i], truth.v_n[i], q_nb, euler_from_quat(q_nb), truth.omega_b[i], error, turned)


def _estimate(local: Array | None, attitude: Array | None) -> list[Cell]:
    pos_vel, attitude = _or(local, _NAN6), _or(attitude, _NAN7)
    q_nb = attitude[:4]
    body = quat_rotate(quat_conj(q_nb), pos_vel[3:])
    return _flat(pos_vel, body, q_nb, euler_from_quat(q_nb), attitude[4:])


def _or(value: Array | None, missing: Array) -> Array:
    return missing if value is None else value


def _flat(*parts: Sequence[float] | Array) -> list[Cell]:
    found: list[Cell] = []
    for part in parts:
        found += part.tolist() if isinstance(part, np.ndarray) else part
    return found


def _text(cell: Cell) -> str:
    if isinstance(cell, float):
        return f"{cell:.7g}" if math.isfinite(cell) else ""
    return str(cell)


def rates(recorder: Recorder, now: float) -> dict[str, float | int]:
    """Return statistics of the logger: mean rates of rows, poses and datagrams since the vehicle's first
    message [Hz], and the numbers of rows and damaged messages. now: local time [s].
    """
    since = now - (now if recorder.first_received is None else recorder.first_received)
    each: Iterable[tuple[str, int]] = (
        ("log_hz", recorder.rows),
        ("mocap_hz", recorder.poses),
        ("datagrams_hz", recorder.datagrams),
    )
    found: dict[str, float | int] = {
        name: round(count / since, 2) if since > 1.0 else 0.0 for name, count in each
    }
    return {**found, "rows": recorder.rows, "damaged": recorder.telemetry.refused}
