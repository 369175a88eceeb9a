"""What an arena needs of a vehicle's PX4, in words that no version changes. Values alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Reaction = Literal["none", "warn", "hold", "return", "land", "terminate", "disarm"]


@dataclass(frozen=True, kw_only=True)
class Failsafe:
    """What happens when something is lost, and after how long [s]. low_battery_*: charge left, 0 to 1; land None: it only warns.

    position_loss "land" is straight down without a position, as far as inertial sensors carry.
    attitude None: as the vehicle has it.
    """

    offboard_loss: Reaction = "land"
    offboard_loss_after_s: float = 1.0
    position_loss: Reaction = "land"
    position_loss_after_s: float = 1.0
    low_battery_warn: float = 0.15
    low_battery_land: float | None = 0.07
    rc_loss: Reaction = "none"
    data_link_loss: Reaction = "none"
    data_link_loss_after_s: float = 10.0
    geofence: Reaction = "land"
    attitude: Reaction | None = None
    attitude_above_deg: float = 60.0


@dataclass(frozen=True, kw_only=True)
class FenceAround:
    """across_m: from home, along the floor; up_m: above home [m]."""

    across_m: float
    up_m: float


@dataclass(frozen=True, kw_only=True)
class Rotor:
    """x: forward, y: right of the centre of mass [m]; spin: +1 counter-clockwise seen from above."""

    x_m: float
    y_m: float
    spin: int


@dataclass(frozen=True, kw_only=True)
class Needs:
    """vision_delay_ms: from exposure to the pose's arrival, None where no poses come.  hover: thrust command, 0 to 1.
    channels: of the radio, where there are sticks; 0: the vehicle knows them.

    ceiling_m: the room's height.  fence: the vehicle's own, None for none.
    gains: a profile's, by the newest names.  own: what a user names himself, as he writes it.
    asked: need (a field's name, `failsafe.offboard_loss`, `gains`, `own.NAME`, ...) -> who asked for it, in words.
    """

    system_id: int
    hover: float
    vision_delay_ms: float | None
    gps: bool = False
    sticks: bool = False
    channels: int = 8
    failsafe: Failsafe = Failsafe()
    landing_speed_m_s: float | None = None
    ceiling_m: float
    fence: FenceAround | None = None
    rotors: tuple[Rotor, ...] = ()
    moment_ratio_m: float = 0.05
    gains: Mapping[str, float] = field(default_factory=dict)
    own: Mapping[str, float] = field(default_factory=dict)
    asked: Mapping[str, str] = field(default_factory=dict)
