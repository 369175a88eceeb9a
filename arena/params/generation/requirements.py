"""The requirements of an arena on a vehicle's PX4, independent of the PX4 version. Data only.

Defaults of the failsafes stand once, in `arena.schema.models`: here every field is given.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from arena.params.facts.failsafe_table import EVENTS, Event

Reaction = Literal["none", "warn", "hold", "return", "land", "terminate", "disarm"]
ACTION_ONLY_EVENTS: tuple[Event, ...] = tuple(
    event for event in EVENTS if event not in ("offboard_loss", "rc_loss", "data_link_loss", "low_battery")
)
"""Events that a key of the YAML's `failsafe` section of the same name configures by an action alone."""


@dataclass(frozen=True, kw_only=True)
class Failsafe:
    """The reaction to each kind of loss, and the time before it.

    offboard_loss, offboard_loss_after_s: no setpoints for this time [s].
    position_loss, position_loss_after_s: no poses for this time [s]; `land` descends without a position estimate.
    low_battery_warn, low_battery_land: remaining charge, 0 to 1 [-]; land None: the vehicle only warns.
    rc_loss: no RC input.
    data_link_loss, data_link_loss_after_s: no heartbeat of a ground station for this time [s].
    actions: every other event -> action, such as geofence.
    attitude, attitude_above_deg: roll or pitch above this angle [deg]; None leaves the vehicle's own setting.
    """

    offboard_loss: Reaction
    offboard_loss_after_s: float
    position_loss: Reaction
    position_loss_after_s: float
    low_battery_warn: float
    low_battery_land: float | None
    rc_loss: Reaction
    data_link_loss: Reaction
    data_link_loss_after_s: float
    actions: Mapping[Event, Reaction]
    attitude: Reaction | None
    attitude_above_deg: float


@dataclass(frozen=True, kw_only=True)
class FenceCylinder:
    """A geofence around the vehicle's home.

    radius_m: horizontal distance from home [m].
    height_m: height above home [m].
    """

    radius_m: float
    height_m: float


@dataclass(frozen=True, kw_only=True)
class Rotor:
    """Position of a rotor.

    x_m, y_m: forward and right of the centre of mass [m] [FRD].
    spin: +1 for counter-clockwise seen from above, -1 for clockwise.
    """

    x_m: float
    y_m: float
    spin: int


@dataclass(frozen=True, kw_only=True)
class Requirements:
    """Everything that an arena requires of one vehicle's PX4.

    system_id: MAV_SYS_ID.
    hover: thrust command in hover, 0 to 1 [-].
    vision_delay_ms: from the exposure to the arrival of a pose [ms]; None without external vision.
    gps, sticks: a GPS receiver; an RC transmitter.
    channels: RC channels; 0 leaves the vehicle's own mapping.
    failsafe: reactions to losses.
    landing_speed_m_s: None leaves the vehicle's own [m/s].
    ceiling_m: height of the room [m].
    fence: None for no geofence.
    rotors, moment_ratio_m: geometry, and reaction torque per thrust [m]; () leaves the vehicle's own.
    gains: gains of the profile, under the names of the newest PX4.
    own: parameters that the user names, as written.
    reasons: requirement (`hover`, `failsafe.offboard_loss`, `own.NAME`, ...) -> who asked for it, in words.
    """

    system_id: int
    hover: float
    vision_delay_ms: float | None
    gps: bool = False
    sticks: bool = False
    channels: int = 8
    failsafe: Failsafe
    landing_speed_m_s: float | None = None
    ceiling_m: float
    fence: FenceCylinder | None = None
    rotors: tuple[Rotor, ...] = ()
    moment_ratio_m: float = 0.05
    gains: Mapping[str, float] = field(default_factory=dict)
    own: Mapping[str, float] = field(default_factory=dict)
    reasons: Mapping[str, str] = field(default_factory=dict)
