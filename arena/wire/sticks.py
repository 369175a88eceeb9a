"""Stick positions of a pilot, and their fields in MAVLink messages. Pure."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Sticks:
    """Stick positions, -1..1 each [-].

    roll: to the right. pitch: forward. throttle: up. yaw: clockwise seen from above
    """

    roll: float = 0.0
    pitch: float = 0.0
    throttle: float = 0.0
    yaw: float = 0.0


CENTRED = Sticks()


def sticks_from_manual_control(x: int, y: int, z: int, r: int) -> Sticks:
    """Return the stick positions in a MANUAL_CONTROL message.

    As in PX4, a value out of range is replaced by the centre.

    x, y, r: pitch, roll and yaw, -1000..1000
    z: throttle, 0..1000
    """
    roll, pitch, yaw = (0.001 * value if abs(value) <= 1000 else 0.0 for value in (y, x, r))
    return Sticks(roll=roll, pitch=pitch, throttle=0.002 * z - 1.0 if 0 <= z <= 1000 else 0.0, yaw=yaw)


def sticks_from_channels(roll: int, pitch: int, throttle: int, yaw: int) -> Sticks:
    """Return the stick positions in the first four channels of an RC message [us].

    1500 us is the centre, 1000 and 2000 us are the ends. 0 and 65535 mean that a channel is not given.
    """
    roll_, pitch_, throttle_, yaw_ = (
        min(max((us - 1500) / 500.0, -1.0), 1.0) if us not in (0, 65535) else 0.0
        for us in (roll, pitch, throttle, yaw)
    )
    return Sticks(roll=roll_, pitch=pitch_, throttle=throttle_, yaw=yaw_)


def manual_control_fields(sticks: Sticks) -> tuple[int, int, int, int]:
    """Return the fields x, y, z, r of a MANUAL_CONTROL message with these stick positions."""
    x, y, r = (round(1000 * min(max(v, -1.0), 1.0)) for v in (sticks.pitch, sticks.roll, sticks.yaw))
    return x, y, round(500 * (min(max(sticks.throttle, -1.0), 1.0) + 1.0)), r
