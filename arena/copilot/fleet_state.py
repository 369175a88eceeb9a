"""State of all vehicles at one instant, and violations of the copilot's rules."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arena.copilot.braking import Stop
from arena.copilot.settings import Step

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def length(vectors: Array) -> Array:
    """Return the lengths (...,) of vectors (..., 3). For few vectors this is faster than `np.linalg.norm`."""
    lengths: Array = np.sqrt((vectors * vectors).sum(-1))
    return lengths


@dataclass(frozen=True, kw_only=True)
class FleetState:
    """State of N vehicles at one instant, one row per vehicle.

    now: time of this state [s].
    flying: armed and in the air, according to the last message.
    open: flying, and in a mode that the copilot may change.
    held: the copilot's order to hold is in force.
    placed: the pose is recent. moving: a recent velocity is known.
    p_n: position [m] [NED] (N, 3). v_n: velocity [m/s] [NED] (N, 3). Both are zero if unknown.
    pose_age: [s], inf before the first pose. tilt: [rad].
    stop: predicted stop after a hold command.
    target: commanded position [m] [NED] (N, 3), NaN if there is none. settled: the target does not move.
    off: distance of the autopilot's estimate from the captured track [m], NaN if unknown.
    battery: 0..1, NaN if unknown.
    offboard: in OFFBOARD.
    silent_s: time since the program's last heartbeat [s], NaN before the first heartbeat since arming.
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
    """Violation of one of the copilot's rules by one vehicle.

    row: index of the vehicle. why: the reason, for the event log.
    enough: step after which the copilot does not escalate further, even if the violation continues;
    `terminate` if it may escalate up to termination.
    """

    row: int
    rule: str
    why: str
    enough: Step = "terminate"
