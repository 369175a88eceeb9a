"""What was heard of one vehicle -> rows of its log. Pure: datagrams, poses, truth and time in, text out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from arena.geometry import Array, euler_from_quat, quat_conj, quat_log, quat_multiply, quat_rotate
from arena.recorder.columns import columns
from arena.wire.telemetry import Telemetry
from arena.wire.truth_page import Truth

_FAST_S, _SLOW_S, _BATTERY_S = 0.5, 3.0, 10.0
_SAME_CLOCK_S = 0.05
_NAN3, _NAN4 = np.full(3, np.nan), np.full(4, np.nan)

Cell = float | str | bool


class Recorder:
    """One vehicle. system_id: its MAV_SYS_ID; index: its row in the truth, None when it is real."""

    def __init__(self, system_id: int, index: int | None) -> None:
        self.telemetry = Telemetry(system_id)
        self.datagrams = self.poses = self.rows = 0
        self.first_heard: float | None = None
        self._index = index
        self._pose: tuple[float, Sequence[float] | Array, Sequence[float] | Array] | None = None
        self._boot: float | None = None

    @property
    def header(self) -> str:
        return ",".join(columns(self._index is not None)) + "\n"

    @property
    def armed(self) -> bool:
        heart = self.telemetry.heart
        return heart is not None and heart.armed

    def hear(self, datagram: bytes, now: float) -> None:
        """A datagram of the vehicle's stream. now [s]."""
        self.datagrams += 1
        if not self.telemetry.hear(datagram, now):
            return
        if self.first_heard is None:
            self.first_heard = now
        if (local := self.telemetry.local) is not None and local.heard == now:
            lag = now - local.boot_s
            self._boot = lag if self._boot is None else min(self._boot, lag)

    def hear_pose(self, p_n: Sequence[float] | Array, q_nb: Sequence[float] | Array, now: float) -> None:
        """A tracked motion-capture pose [m] [NED] (3,), wxyz (4,)."""
        self.poses += 1
        self._pose = now, p_n, q_nb

    def estimated_at(self) -> float | None:
        """When the newest estimate was made, in our time [s]: its own stamp, moved by the least delay seen.

        A simulated autopilot's stamps are simulation time already, and a few milliseconds of delay are then no offset.
        """
        local = self.telemetry.local
        if local is None or self._boot is None:
            return None
        return local.boot_s + (0.0 if abs(self._boot) < _SAME_CLOCK_S else self._boot)

    def row(self, now: float, stamp: float, truth: Truth | None = None, then: Truth | None = None) -> str:
        """One line. now: time that ages are counted to [s]; stamp: what the first column says [s];
        truth: the world now; then: the world at `estimated_at()`.
        """
        self.rows += 1
        cells: list[Cell] = [f"{stamp:.4f}"]
        for part in (
            self._ekf(now),
            self._imu(now),
            self._mocap(now),
            self._info(now),
            self._references(now),
        ):
            cells += part
        if self._index is not None:
            cells += self._truth(truth, then, now)
        return ",".join(map(_text, cells)) + "\n"

    def _ekf(self, now: float) -> list[Cell]:
        local, attitude = self.telemetry.local, self.telemetry.attitude
        has_local = local is not None and now - local.heard <= _FAST_S
        has_attitude = attitude is not None and now - attitude.heard <= _FAST_S
        pos, vel = (local.pos, local.vel) if local is not None and has_local else (_NAN3, _NAN3)
        q_nb, rates = (
            (attitude.q_nb, attitude.ang_vel) if attitude is not None and has_attitude else (_NAN4, _NAN3)
        )
        return _flat(pos, vel, quat_rotate(quat_conj(q_nb), vel), q_nb, euler_from_quat(q_nb), rates)

    def _imu(self, now: float) -> list[Cell]:
        imu, mag = self.telemetry.imu, self.telemetry.mag
        fresh = imu is not None and now - imu.heard <= _FAST_S
        acc, gyro = (imu.acc_body, imu.ang_vel) if imu is not None and fresh else (_NAN3, _NAN3)
        return _flat(acc, gyro, mag.mag if mag is not None and now - mag.heard <= _FAST_S else _NAN3)

    def _mocap(self, now: float) -> list[Cell]:
        heard, p_n, q_nb = self._pose or (-math.inf, _NAN3, _NAN4)
        if now - heard > _FAST_S:
            p_n, q_nb = _NAN3, _NAN4
        return _flat(p_n, q_nb, euler_from_quat(q_nb))

    def _info(self, now: float) -> list[Cell]:
        heart, ground, status = self.telemetry.heart, self.telemetry.ground, self.telemetry.status
        beats = heart is not None and now - heart.heard <= _SLOW_S
        return [
            heart.mode if heart is not None and beats else "",
            heart.armed if heart is not None and beats else "",
            ground.landed if ground is not None and now - ground.heard <= _SLOW_S else "",
            status.battery if status is not None and now - status.heard <= _BATTERY_S else "",
        ]

    def _references(self, now: float) -> list[Cell]:
        """pos_ref to act.output: see columns.py."""
        t = self.telemetry
        ref, att, baro, act = t.reference, t.attitude_reference, t.baro, t.actuators
        pos, vel, yaw = _NAN3, _NAN3, math.nan
        if ref is not None and now - ref.heard <= _FAST_S:
            pos, vel, yaw = ref.pos, ref.vel, ref.yaw
        q_nb, rates, thrust = _NAN4, _NAN3, math.nan
        if att is not None and now - att.heard <= _FAST_S:
            q_nb, rates, thrust = att.q_nb, att.ang_vel, att.thrust
        air = (
            [baro.pressure, baro.temperature, baro.alt]
            if baro is not None and now - baro.heard <= _FAST_S
            else _NAN3
        )
        motors = act.output[:4] if act is not None and now - act.heard <= _FAST_S else _NAN4
        return _flat(pos, euler_from_quat(q_nb), [yaw], vel, q_nb, rates, [thrust], air, motors)

    def _truth(self, truth: Truth | None, then: Truth | None, now: float) -> list[Cell]:
        if truth is None:
            return [math.nan] * 25
        i = self._index or 0
        q_nb = truth.q_nb[i]
        known = _flat(truth.p_n[i], truth.v_n[i], q_nb, euler_from_quat(q_nb), truth.omega_b[i])
        return known + self._error(then, i, now)

    def _error(self, then: Truth | None, i: int, now: float) -> list[Cell]:
        local, attitude = self.telemetry.local, self.telemetry.attitude
        if then is None or local is None or now - local.heard > _FAST_S:
            return [math.nan] * 9
        turned = _NAN3
        if attitude is not None and abs(attitude.boot_s - local.boot_s) < 0.03:
            # the estimate's attitude is some milliseconds off its position: brought there by the body rates
            q_nb = quat_multiply(attitude.q_nb, _turn(attitude.ang_vel, local.boot_s - attitude.boot_s))
            turned = quat_log(quat_multiply(quat_conj(then.q_nb[i]), q_nb))
        return _flat(local.pos - then.p_n[i], local.vel - then.v_n[i], turned)


def _turn(omega_b: Array, seconds: float) -> Array:
    """The rotation by these body rates, small: wxyz (4,)."""
    return np.concatenate([[1.0], 0.5 * seconds * omega_b])


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
    """Figures for the summary: means since the vehicle was first heard."""
    since = now - (now if recorder.first_heard is None else recorder.first_heard)
    each: Iterable[tuple[str, int]] = (
        ("log_hz", recorder.rows),
        ("mocap_hz", recorder.poses),
        ("datagrams_hz", recorder.datagrams),
    )
    found: dict[str, float | int] = {
        name: round(count / since, 2) if since > 1.0 else 0.0 for name, count in each
    }
    return {**found, "rows": recorder.rows, "damaged": recorder.telemetry.refused}
