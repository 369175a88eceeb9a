"""The columns of a log. The first ones have the names and the order of the thesis's files, so that its tools read ours.

Metres, metres per second, radians, seconds, pascals, teslas; frames NED and (imu, ang_vel) FRD; quaternions wxyz.
An empty cell: the value was never heard, is older than its limit, or is not controlled.
"""

from __future__ import annotations

NED = ("north", "east", "down")
RPY = ("roll", "pitch", "yaw")
WXYZ = ("w", "x", "y", "z")


def _of(group: str, parts: tuple[str, ...]) -> list[str]:
    return [f"{group}.{part}" for part in parts]


THESIS: tuple[str, ...] = (
    "time.seconds",
    *_of("ekf.pos", NED),
    *_of("ekf.vel", NED),
    *_of("ekf.vel_body", NED),
    *_of("ekf.att_q", WXYZ),
    *_of("ekf.att_euler", RPY),
    *_of("ekf.ang_vel", RPY),
    *_of("imu.acc_body", NED),
    *_of("imu.ang_vel", RPY),
    *_of("imu.mag", NED),
    *_of("mocap.pos", NED),
    *_of("mocap.att_q", WXYZ),
    *_of("mocap.att_euler", RPY),
    *_of("info", ("flight_mode", "is_armed", "is_landed", "battery")),
    *_of("pos_ref", NED),
    *_of("att_euler_ref", RPY),
)

FURTHER: tuple[str, ...] = (
    "pos_ref.yaw",
    *_of("vel_ref", NED),
    *_of("att_q_ref", WXYZ),
    *_of("ang_vel_ref", RPY),
    "thrust_ref",
    *_of("baro", ("pressure", "temperature", "alt")),
    *_of("act.output", ("1", "2", "3", "4")),
)

# What the simulated world knows. err: the estimate minus the truth at the instant of the estimate.
TRUTH: tuple[str, ...] = (
    *_of("truth.pos", NED),
    *_of("truth.vel", NED),
    *_of("truth.att_q", WXYZ),
    *_of("truth.att_euler", RPY),
    *_of("truth.ang_vel", RPY),
    *_of("err.pos", NED),
    *_of("err.vel", NED),
    *_of("err.att_euler", RPY),
)


def columns(simulated: bool) -> tuple[str, ...]:
    """Every column of a log, in order."""
    return THESIS + FURTHER + (TRUTH if simulated else ())
