"""Conversion of the telemetry, poses and ground truth of one vehicle to the rows of its log. Opens no sockets and no files.

A row belongs to one instant. The row is written later, when each measured group has a sample before and after that
instant.
"""

from __future__ import annotations

import functools
import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import common as mavlink

from arena.constants import MAX_ROTORS
from arena.geometry import Array
from arena.kernels.rotations import euler, rotated_back, rotation_vector
from arena.recorder.columns import columns
from arena.recorder.samples import MAX_GAP_S, Held, Sample, Series, leading_quaternion, position_velocity
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
_NAN3, _NAN4, _NAN6, _NAN7, _NAN10, _NAN_OUTPUTS = ((math.nan,) * n for n in (3, 4, 6, 7, 10, MAX_ROTORS))
_NO_ESTIMATE, _NO_TRUTH = (math.nan,) * 19, (math.nan,) * 25


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
        self._pose.receive(exposed, now, (*map(float, q_nb), *map(float, p_n)))

    def _take_measurements(self, now: float) -> None:
        """Add the measurements that have arrived since the last call. Measurements that were added before are skipped.

        A measurement is new if it is another object than at the last call. Times cannot show this, because the clock of the
        logger may not have advanced since the last call.
        """
        telemetry, before = self.telemetry, self._taken
        newest = (telemetry.local, telemetry.attitude, telemetry.imu, telemetry.mag, telemetry.baro)
        self._taken = newest
        local, attitude, imu, mag, baro = newest
        if local is not None and local is not before[0]:
            self._local.receive(local.boot_s, now, (*local.pos.tolist(), *local.vel.tolist()))
        if attitude is not None and attitude is not before[1]:
            turned = (*attitude.q_nb.tolist(), *attitude.ang_vel.tolist())
            self._attitude.receive(attitude.boot_s, now, turned)
        if imu is None or imu is before[2]:
            return
        self._imu.receive(imu.boot_s, now, (*imu.acc_body.tolist(), *imu.ang_vel.tolist()))
        if mag is not None and mag is not before[3]:
            self._mag.receive(imu.boot_s, now, tuple(mag.mag.tolist()))
        if baro is not None and baro is not before[4]:
            self._baro.receive(imu.boot_s, now, (baro.pressure, baro.temperature, baro.alt))

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
        measured = (
            *_estimate(local, attitude),
            *(self._imu.at(time_s) or _NAN6),
            *(self._mag.at(time_s) or _NAN3),
            *_pose(self._pose.at(time_s)),
        )
        others = self._references(time_s)
        if self._index is not None:
            others += self._truth(truth, local, attitude)
        return f"{stamp:.4f},{_text(measured)},{self._info(time_s)},{_text(others)}\n"

    def _info(self, time_s: float) -> str:
        """Return the cells of the columns `info.*`: flight mode, armed, landed and battery, separated by commas."""
        heart, ground, status = (
            self._heart.at(time_s),
            self._ground.at(time_s),
            self._status.at(time_s),
        )
        mode_and_armed = f"{heart.mode},{heart.armed}" if heart is not None else ","
        landed = str(ground.landed) if ground is not None else ""
        return f"{mode_and_armed},{landed},{_text((status.battery,)) if status is not None else ''}"

    def _references(self, time_s: float) -> Sample:
        """Return the values of references, setpoints and actuator outputs: the columns from pos_ref to
        act.output, in the order of `arena.recorder.columns`.
        """
        pos, vel, yaw = self._position_reference(time_s)
        attitude, rates, thrust = _NAN7, _NAN3, math.nan
        if (wanted := self._attitude_setpoint.at(time_s)) is not None:
            attitude, rates, thrust = _with_euler(wanted.q_nb), tuple(wanted.ang_vel.tolist()), wanted.thrust
        actuators = self._actuators.at(time_s)
        outputs = actuators.output.tolist() if actuators is not None else _NAN_OUTPUTS
        air = self._baro.at(time_s) or _NAN3
        return (*pos, *attitude[4:], yaw, *vel, *attitude[:4], *rates, thrust, *air, *outputs)

    def _position_reference(self, time_s: float) -> tuple[Sample, Sample, float]:
        """Return the position, velocity and yaw references [NED]. They are from the user program if it
        publishes them, else from the setpoint.

        The setpoint is the one that the autopilot reports. NaN if unknown.
        """
        pos, vel, yaw = _NAN3, _NAN3, math.nan
        for reference in (self._setpoint.at(time_s), self._program_reference.at(time_s)):
            if reference is not None:
                pos, vel = _replaced(pos, reference.pos), _replaced(vel, reference.vel)
                yaw = reference.yaw if math.isfinite(reference.yaw) else yaw
        return pos, vel, yaw

    def _truth(self, truth: Truth | None, local: Sample | None, attitude: Sample | None) -> Sample:
        if truth is None:
            return _NO_TRUTH
        i = self._index or 0
        q_nb = truth.q_nb[i].tolist()
        p_v = (*truth.p_n[i].tolist(), *truth.v_n[i].tolist())
        error = _NAN6 if local is None else [a - b for a, b in zip(local, p_v, strict=True)]
        turned = _NAN3 if attitude is None else rotation_vector(q_nb, attitude[:4])  # type: ignore[arg-type]
        return (*p_v, *q_nb, *euler(q_nb), *truth.omega_b[i].tolist(), *error, *turned)


def _estimate(local: Sample | None, attitude: Sample | None) -> Sample:
    """Return the estimated position, velocity, velocity in body axes, attitude, Euler angles and body rates (19,)."""
    if attitude is None:
        return _NO_ESTIMATE if local is None else (*local, *_NO_ESTIMATE[6:])
    q_nb, rates = attitude[:4], attitude[4:]
    body = _NAN3 if local is None else rotated_back(q_nb, local[3:])  # type: ignore[arg-type]
    return (*(local or _NAN6), *body, *q_nb, *euler(q_nb), *rates)  # type: ignore[arg-type]


def _pose(pose: Sample | None) -> Sample:
    """Return the captured position, attitude and Euler angles (10,). pose: quaternion and position (7,)."""
    return _NAN10 if pose is None else (*pose[4:], *pose[:4], *euler(pose[:4]))  # type: ignore[arg-type]


def _with_euler(q_nb: Array) -> Sample:
    """Return an attitude as quaternion and Euler angles (7,)."""
    q = tuple(q_nb.tolist())
    return (*q, *euler(q))


def _replaced(values: Sample, newer: Array) -> Sample:
    """Return `values` with each element replaced by the element of `newer`, if that is finite."""
    return tuple(
        [new if math.isfinite(new) else old for old, new in zip(values, newer.tolist(), strict=True)]
    )


def _text(numbers: Sample) -> str:
    """Return numbers as cells with seven digits. The cell of a number that is not finite is empty."""
    text = _format(len(numbers)) % numbers
    return text.replace("-inf", "").replace("inf", "").replace("nan", "") if "n" in text else text


@functools.cache
def _format(count: int) -> str:
    return ",".join(["%.7g"] * count)


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
