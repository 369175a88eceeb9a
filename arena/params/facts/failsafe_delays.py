"""How long each failsafe waits, by version: `delays("offboard_loss", "1.13")`.

Read and measured as `meanings` says, which has what they then do.
"""

from __future__ import annotations

from typing import NamedTuple

from arena.params.facts.failsafe_actions import NEWEST, Event
from arena.params.facts.parameter_table import Version


class Delay(NamedTuple):
    """seconds = value * scale + fixed_s."""

    event: Event
    parameter: str
    since: int
    until: int
    scale: float
    fixed_s: float
    why: str


_WAITS = (
    "it holds so long first, where hold can run (a global position); hold, disarm and terminate come at once"
)

DELAYS: tuple[Delay, ...] = (
    Delay(
        "offboard_loss",
        "COM_OF_LOSS_T",
        9,
        9,
        1.0,
        0.5,
        "0.5 s after the last setpoint it holds (position with sticks)",
    ),
    Delay("offboard_loss", "COM_OF_LOSS_T", 10, 10, 1.0, 0.5, "0.5 s come on top"),
    Delay(
        "offboard_loss",
        "COM_OF_LOSS_T",
        11,
        NEWEST,
        1.0,
        0.0,
        "then at once: COM_FAIL_ACT_T is not waited for",
    ),
    Delay("sticks_loss", "COM_RC_LOSS_T", 9, NEWEST, 1.0, 0.0, "none comes from the radio or the joystick"),
    Delay("sticks_loss", "COM_RCL_ACT_T", 12, 13, 1.0, 0.0, "it holds so long first"),
    Delay("sticks_loss", "COM_FAIL_ACT_T", 14, NEWEST, 1.0, 0.0, _WAITS),
    Delay("data_link_loss", "COM_DL_LOSS_T", 9, 11, 1.0, 0.0, "no ground station's heartbeat"),
    Delay(
        "data_link_loss", "COM_DL_LOSS_T", 12, 12, 1.0, 1.5, "it counts from 1.5 s after the last heartbeat"
    ),
    Delay(
        "data_link_loss",
        "COM_DL_LOSS_T",
        13,
        NEWEST,
        1.0,
        2.5,
        "it counts from 2.5 s after the last heartbeat",
    ),
    Delay("data_link_loss", "COM_FAIL_ACT_T", 14, NEWEST, 1.0, 0.0, _WAITS),
    Delay(
        "position_loss_in_offboard",
        "EKF2_NOAID_TOUT",
        9,
        NEWEST,
        1e-6,
        0.0,
        "so long EKF2 reckons on without any aid",
    ),
    Delay(
        "position_loss_in_offboard",
        "COM_POS_FS_DELAY",
        9,
        15,
        1.0,
        0.0,
        "for an estimate that is not published any more",
    ),
    Delay("low_battery", "COM_BAT_ACT_T", 13, 13, 1.0, 0.0, "it holds so long first"),
    Delay("low_battery", "COM_FAIL_ACT_T", 14, NEWEST, 1.0, 0.0, _WAITS),
    Delay("geofence", "COM_FAIL_ACT_T", 14, NEWEST, 1.0, 0.0, _WAITS),
    Delay("motor_failure", "COM_FAIL_ACT_T", 14, NEWEST, 1.0, 0.0, _WAITS),
)
"""COM_FAIL_ACT_T: failsafe/framework.cpp (checkFailsafe) starts it for actions that a user may take over after it (Auto); the
fallback of a mode that cannot run, which the loss of offboard or of the position is, is not among them. Measured with 1.16 and
COM_FAIL_ACT_T 5: position mode 1.03 s after the last setpoint.

COM_DL_LOSS_T: HEARTBEAT_TIMEOUT_US of msg/telemetry_status.msg comes before it; measured with 1.16 and 10 s: 12.3 s.

EKF2_NOAID_TOUT: from 1.14 on 0.4 s sooner, and 0.6 s at the least, where poses stop altogether (EKF/ev_control.cpp); on time
where they come and are rejected. Measured with 1.16: 0.6 s of 1 s, 2.6 s of 3 s."""


def delays(event: Event, version: Version | str) -> tuple[Delay, ...]:
    """What passes before the event is noticed and answered, in order."""
    minor = Version.of(version).minor
    return tuple(d for d in DELAYS if d.event == event and d.since <= minor <= d.until)
