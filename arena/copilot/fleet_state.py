"""The state of all vehicles at one instant, and the violation of a rule."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arena.copilot.braking import Stop
from arena.copilot.settings import Step

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class FleetState:
    """Arrays over the N vehicles.

    now: [s].
    flying: armed and in the air, by the last message.
    open: flying, and in a mode that the copilot may end.
    held: under the order to hold.
    placed: the pose is recent. moving: a recent velocity is known.
    p_n: [m] [NED] (N, 3). v_n: [m/s] [NED] (N, 3). Zero where unknown.
    pose_age: [s], inf before the first pose. tilt: [rad].
    stop: predicted stop after a hold command.
    target: commanded position [m] [NED] (N, 3), NaN without one. settled: the target stands still.
    off: distance of the estimate from the captured track [m], NaN where unknown.
    battery: 0..1, NaN where unknown.
    offboard: in OFFBOARD. silent_s: time since the program's last heartbeat [s], NaN before the first in this arming.
    """

    now: float
    flying: Mask
    open: Mask
    held: Mask
    placed: Mask
    moving: Mask
    p_n: Array
    v_n: Array
    pose_age: Array
    tilt: Array
    stop: Stop
    target: Array
    settled: Mask
    off: Array
    battery: Array
    offboard: Mask
    silent_s: Array


@dataclass(frozen=True, kw_only=True)
class Violation:
    """The violation of a rule by a vehicle.

    row: index of the vehicle. why: the reason, for the event log.
    enough: the step that is sufficient although the violation persists; `terminate` when only its end is sufficient.
    """

    row: int
    rule: str
    why: str
    enough: Step = "terminate"
