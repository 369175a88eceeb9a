"""Requirements of an arena that a vehicle's PX4 must meet, for any PX4 version. Data only.

The defaults of failsafes are defined in `arena.schema.models` only, so every field here must be given.
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
"""Events for which the YAML sets only an action, under `failsafe` with the same name."""


@dataclass(frozen=True, kw_only=True)
class Failsafe:
    """Required reactions of PX4 to failures and lost connections, with the delay of each reaction.

    offboard_loss, offboard_loss_after_s: action after this time without setpoints [s].
    position_loss, position_loss_after_s: action after this time without poses [s]; `land` descends without a position estimate.
    low_battery_warn, low_battery_land: charge at which the vehicle warns or lands, 0 to 1 [-]; None: the vehicle does not land.
    rc_loss: action without RC input.
    data_link_loss, data_link_loss_after_s: action after this time without a heartbeat of a ground station [s].
    actions: actions after other events, such as `geofence`: event -> action.
    attitude, attitude_above_deg: action for roll or pitch above this angle [deg]; None keeps the vehicle's own setting.
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
    """A geofence in the shape of a cylinder around the vehicle's home position.

    radius_m: horizontal distance from home [m].
    height_m: height above home [m].
    """

    radius_m: float
    height_m: float


@dataclass(frozen=True, kw_only=True)
class Rotor:
    """Position and direction of rotation of a rotor.

    x_m, y_m: distance forward and to the right of the centre of mass [m] [FRD].
    spin: +1 for counter-clockwise seen from above, -1 for clockwise.
    """

    x_m: float
    y_m: float
    spin: int


@dataclass(frozen=True, kw_only=True)
class Requirements:
    """All requirements of an arena for the PX4 of one vehicle.

    system_id: MAVLink system id (MAV_SYS_ID).
    simulated: the vehicle has the simulated body. A real body keeps its own hover thrust, gains, vision delay and noise, rotor
        geometry and RC mapping, because the values here are those of the simulation; measured values are in `own`.
    hover: thrust command in hover, 0 to 1 [-].
    vision_delay_ms: delay from the camera exposure to the arrival of a pose at the autopilot [ms]; None: no external vision.
    gps: whether the vehicle has a GPS receiver.
    declination_deg: declination of the simulated magnetic field [deg]; None: the vehicle keeps its own.
    sticks: whether the vehicle has an RC transmitter.
    joystick: whether a person may fly with the joystick of a ground station; ignored if `sticks` is true.
    channels: number of RC channels; 0 keeps the vehicle's own mapping.
    failsafe: reactions to failures and lost connections.
    landing_speed_m_s: landing speed [m/s]; None keeps the vehicle's own.
    ceiling_m: height of the room [m].
    fence: geofence; None: no geofence.
    rotors: rotor geometry; () keeps the vehicle's own.
    moment_ratio_m: reaction torque of a rotor divided by its thrust [m].
    gains: controller gains of the profile; parameter name of the newest PX4 -> value.
    own: parameters that the user sets; name -> value.
    measured: names in `own` that were measured on this vehicle.
    from_file: names in `own` whose value comes from a parameter file. A requirement that the user has written (`written`) replaces
        this value.
    written: requirements, as in `reasons`, that the user has written.
    reasons: requirement (`hover`, `failsafe.offboard_loss`, `own.NAME`, ...) -> text that says where it comes from.
    """

    system_id: int
    simulated: bool = True
    hover: float
    vision_delay_ms: float | None
    gps: bool = False
    declination_deg: float | None = None
    sticks: bool = False
    joystick: bool = False
    channels: int = 8
    failsafe: Failsafe
    landing_speed_m_s: float | None = None
    ceiling_m: float
    fence: FenceCylinder | None = None
    rotors: tuple[Rotor, ...] = ()
    moment_ratio_m: float = 0.05
    gains: Mapping[str, float] = field(default_factory=dict)
    own: Mapping[str, float] = field(default_factory=dict)
    measured: frozenset[str] = frozenset()
    from_file: frozenset[str] = frozenset()
    written: frozenset[str] = frozenset()
    reasons: Mapping[str, str] = field(default_factory=dict)
