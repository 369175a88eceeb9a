"""What is known of all vehicles at one instant, as the rules see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arena.copilot.braking import Stop
from arena.copilot.settings import Step

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Moment:
    """Arrays over the N vehicles. now [s].

    flying: armed and in the air, by its own last word.  open: flying, and in a mode that the copilot may end.
    held: told to hold, and not taken from there.
    placed: its pose is young enough to judge by; moving: so is its velocity.
    p_n [m], v_n [m/s] [NED] (N, 3), zero where not known.
    pose_age: [s], inf where never seen.  tilt [rad].
    stop: where each would stand.
    target [m] [NED] (N, 3), nan where it is commanded to no place; settled: that place stands still.
    off: estimate against capture [m], nan where not known.  battery: 0..1, nan where not known.
    offboard: in OFFBOARD.  silent_s: since its program's last heartbeat [s], nan where it never beat in this arming.
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
class Broken:
    """One rule that one vehicle breaks. row: which vehicle; why: a sentence's end.

    enough: the step with which it is answered, though it may be broken still; terminate where only its end is an answer.
    """

    row: int
    rule: str
    why: str
    enough: Step = "terminate"
