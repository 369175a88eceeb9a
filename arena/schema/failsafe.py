"""The sections `failsafe` and `geofence` of arena.yaml: reactions of the autopilots to failures and lost connections."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from arena.constants import OFFBOARD_LOSS_S
from arena.schema.base import NotNegative, Positive, Span, Strict

Share = Annotated[float, Field(gt=0, lt=1)]


class OffboardLoss(Strict):
    """Action and timeout for missing setpoints in OFFBOARD."""

    action: Literal["land", "hold", "return", "terminate", "disarm"] = "land"
    """Action of the vehicle."""
    after_s: Annotated[float, Field(gt=0, le=60)] = OFFBOARD_LOSS_S
    """Longest allowed time without a setpoint [s]."""


class PositionLoss(Strict):
    """Reaction to missing poses, or to poses that the estimator rejects."""

    action: Literal["land", "terminate", "disarm"] = "land"
    """Action of the vehicle. `land` descends vertically with the inertial sensors only."""
    after_s: Annotated[float, Field(ge=0.5, le=10)] = 1.0
    """Longest allowed time without a valid pose [s]."""


class LowBattery(Strict):
    """Reactions to a low battery charge (1 = full, 0 = empty)."""

    warn: Share = 0.15
    """Charge at which the vehicle warns."""
    land: Share | None = 0.07
    """Charge at which the vehicle lands; null: a low charge does not make the vehicle land."""

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.land is not None and self.land >= self.warn:
            raise ValueError(
                f"expected `land` (battery charge) below `warn`, got land: {self.land:g}, warn: {self.warn:g}"
            )
        return self


class RcLoss(Strict):
    """Action for missing RC input."""

    action: Literal["none", "hold", "return", "land", "terminate", "disarm"] | None = None
    """Action of the vehicle. Default: land if it has an RC transmitter, else none."""


class DataLinkLoss(Strict):
    """Action and timeout for missing heartbeats of the ground stations."""

    action: Literal["none", "hold", "return", "land", "terminate", "disarm"] = "none"
    """Action of the vehicle."""
    after_s: Annotated[float, Field(ge=5, le=300)] = 10.0
    """Time without a heartbeat [s]."""


class AttitudeLoss(Strict):
    """Reaction to too much roll or pitch, for example after a collision or a rotor failure."""

    action: Literal["none", "terminate"] = "none"
    """Action of the vehicle; `terminate` stops its motors. Without this key, hardware keeps its own setting."""
    above_deg: Annotated[int, Field(ge=50, le=90)] = 60
    """Roll or pitch that counts as a failure [deg]; must exceed the largest tilt in flight (`MPC_TILTMAX_AIR`, 45)."""


class FenceLoss(Strict):
    """Reaction of the autopilot when a vehicle leaves a geofence.

    The fence is the YAML's `geofence`, or a fence that was uploaded to the autopilot.
    """

    action: Literal["none", "warn", "hold", "return", "land", "terminate"] = "land"
    """Action of the vehicle."""


class Failsafe(Strict):
    """Reactions of the autopilots to failures and lost connections. They become PX4 parameters."""

    offboard_loss: OffboardLoss = OffboardLoss.model_construct()
    """Reaction to missing setpoints in OFFBOARD."""
    position_loss: PositionLoss = PositionLoss.model_construct()
    """Reaction to missing or rejected poses."""
    low_battery: LowBattery = LowBattery.model_construct()
    """Reactions to a low battery charge."""
    rc_loss: RcLoss = RcLoss.model_construct()
    """Reaction to missing RC input."""
    data_link_loss: DataLinkLoss = DataLinkLoss.model_construct()
    """Reaction to missing heartbeats of the ground stations."""
    geofence: FenceLoss = FenceLoss.model_construct()
    """Reaction to leaving a geofence."""
    attitude: AttitudeLoss = AttitudeLoss.model_construct()
    """Reaction to too much roll or pitch."""


class Geofence(Strict):
    """Geofence: a box in which the vehicles' centres must stay.

    `failsafe.geofence` sets the reaction to leaving the box.
    """

    north: Span | None = None
    """Lowest and highest north coordinate from the floor's centre [m]. Default: the room's walls."""
    east: Span | None = None
    """Lowest and highest east coordinate [m]. Default: the room's walls."""
    up: Positive | None = None
    """Height of the fence's ceiling above the floor [m]. Default: the room's height."""
    margin_m: NotNegative = 0.0
    """Distance by which the fence's walls and ceiling are moved inwards [m]."""
