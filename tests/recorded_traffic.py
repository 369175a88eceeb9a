"""Synthetic traffic of a vehicle that flies on a circle: MAVLink datagrams, poses and true states, in the order of reception."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from pymavlink.dialects.v20 import common as mavlink
from record_files import UAV1, RecordFile

from arena.geometry import Array, quat_from_euler
from arena.mocap.client import CapturedFrame, Pose
from arena.wire.flight_record import RecordedVehicle
from arena.wire.truth_page import Truth

OFFBOARD, LOITER = 6 << 16, 4 << 16 | 3 << 24
NAN = float("nan")
AUTOPILOT_HZ = {
    "local": 30.0,
    "attitude": 50.0,
    "imu": 50.0,
    "target": 10.0,
    "attitude_target": 20.0,
    "servos": 10.0,
    "heartbeat": 1.0,
    "extended": 1.0,
    "status": 0.5,
    "estimator": 1.0,
}


@dataclass(frozen=True, kw_only=True)
class Received:
    """kind: kind of data.  time_s: time of reception [s].  data: datagram.  exposed_s: of a pose [s].  state: p_n, v_n, rpy (9,)."""

    kind: Literal["down", "up", "pose", "truth"]
    time_s: float
    data: bytes = b""
    exposed_s: float = 0.0
    state: Array | None = None


def state(t: float) -> Array:
    """Return position, velocity [NED] and roll, pitch, yaw of the vehicle (9,): a circle of 1 m radius at 2 rad/s."""
    circle = [np.cos(2 * t), np.sin(2 * t), -1.0, -2 * np.sin(2 * t), 2 * np.cos(2 * t), 0.0]
    return np.array([*circle, 0.2 * np.sin(t), 0.1 * np.cos(3 * t), t])


def traffic(
    seconds: float, *, system: int = 1, boot_s: float = 0.0, delay_s: float = 0.004, seed: int = 1
) -> list[Received]:
    """Return all data of a flight, ordered by time of reception.

    boot_s: time of the autopilot's clock at time zero [s].  delay_s: mean delay of the messages, in addition to 1 ms [s].
    """
    rng = np.random.default_rng(seed)
    out = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
    program = mavlink.MAVLink(None, srcSystem=system, srcComponent=191)
    found: list[Received] = []
    for kind, rate in AUTOPILOT_HZ.items():
        for t in np.arange(1, int(seconds * rate)) / rate:
            received = t + 0.001 + rng.exponential(delay_s)
            data = _message(kind, t, boot_s, rng).pack(out)
            found.append(Received(kind="down", time_s=received, data=data))
    for t in np.arange(1.0, seconds, 0.05):
        mask = 0b11 << 10 if rng.random() < 0.5 else 0b0100  # without yaw, or without down
        message = mavlink.MAVLink_position_target_local_ned_message(
            round(1e3 * (t + boot_s)), 1, mask, *state(t)[:6], 0, 0, 0, t, 0
        )
        found.append(Received(kind="up", time_s=t + 0.002, data=message.pack(program)))
    poses = [t for t in np.arange(0, seconds, 1 / 180) if not 3.0 < t < 3.8]
    found += [Received(kind="pose", time_s=t + 0.012, exposed_s=t, state=state(t)) for t in poses]
    found += [Received(kind="truth", time_s=t, state=state(t)) for t in np.arange(0, seconds, 1 / 30)]
    return sorted(found, key=lambda r: r.time_s)


def _message(kind: str, t: float, boot_s: float, rng: np.random.Generator) -> mavlink.MAVLink_message:
    s, ms = state(t), round(1e3 * (t + boot_s))
    q = quat_from_euler(s[6:])
    if kind == "local":
        return mavlink.MAVLink_local_position_ned_message(ms, *(s[:6] + rng.normal(0, 0.01, 6)))
    if kind == "attitude":
        return mavlink.MAVLink_attitude_quaternion_message(ms, *q, *rng.normal(0, 1, 3))
    if kind == "imu":
        updated = 0x3F | (0x01C0 if rng.random() < 0.4 else 0) | (0x1A00 if rng.random() < 0.3 else 0)
        return mavlink.MAVLink_highres_imu_message(
            ms * 1000, *rng.normal(0, 1, 9), 1013 + t, 0, t, 25, updated
        )
    if kind == "target":
        return mavlink.MAVLink_position_target_local_ned_message(ms, 1, 0, *s[:6], NAN, NAN, NAN, 0.5, NAN)
    if kind == "attitude_target":
        return mavlink.MAVLink_attitude_target_message(ms, 0, [*q], *rng.normal(0, 1, 3), 0.6)
    if kind == "servos":
        return mavlink.MAVLink_servo_output_raw_message(ms * 1000, 0, *rng.integers(900, 2100, 8))
    if kind == "heartbeat":
        armed = 128 if t > 2.0 else 0
        return mavlink.MAVLink_heartbeat_message(2, 12, 1 | armed, OFFBOARD if t > 2.5 else LOITER, 4, 3)
    if kind == "extended":
        return mavlink.MAVLink_extended_sys_state_message(0, 2 if t > 2.2 else 1)
    if kind == "status":
        return mavlink.MAVLink_sys_status_message(
            0, 0, 0, 0, 15800 - round(100 * t), 1250, 87, 0, 0, 0, 0, 0, 0
        )
    assert kind == "estimator"
    return mavlink.MAVLink_estimator_status_message(ms * 1000, 0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.01, 0.02)


def truth_of(received: Received) -> Truth:
    """Return the true state of one vehicle."""
    s = received.state
    assert s is not None
    q_nb, zeros = quat_from_euler(s[6:]), np.zeros((1, 3))
    return Truth(
        time_s=received.time_s,
        p_n=s[None, :3],
        q_nb=q_nb[None],
        v_n=s[None, 3:6],
        omega_b=zeros,
        accel_b=zeros,
        motors=np.zeros((1, 4)),
    )


def record_of(path: Path, data: list[Received], vehicle: RecordedVehicle = UAV1) -> Path:
    """Write the record of a flight with one vehicle, and return its path."""
    record = RecordFile(path, (vehicle,))
    log = record.channels
    for number, received in enumerate(data):
        if received.kind == "pose":
            log.on_frame(_frame(number, received, vehicle.body), vehicle.simulated, received.time_s)
        elif received.kind == "truth":
            if vehicle.simulated:
                log.on_truth(truth_of(received), received.time_s)
        else:
            log.on_datagrams([(vehicle.name, received.kind == "up", received.data, received.time_s)])
    record.close()
    return path


def _frame(number: int, received: Received, body: str) -> CapturedFrame:
    s = received.state
    assert s is not None
    pose = Pose(body, tuple(s[:3].tolist()), tuple(quat_from_euler(s[6:]).tolist()))
    return CapturedFrame(
        number=number, time_s=received.exposed_s, poses=(pose,), untracked=("other",), sent_s=None
    )
