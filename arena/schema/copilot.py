"""The section `copilot` of the YAML: rules that are watched in flight, and their actions. An empty section enables all rules."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from arena.schema.base import NotNegative, Positive, Strict

Step = Literal["hold", "land", "terminate"]
Do = Literal["none", "hold", "land", "terminate"]
_STEPS = ("none", "hold", "land", "terminate")


class GeofenceRule(Strict):
    """Stopping distance up to the geofence; without a geofence, up to the room's walls."""

    do: Do = "hold"
    """What is done: none, hold, land or terminate."""
    reserve_m: NotNegative = 0.2
    """Reserve beside the stopping distance [m]."""


class SeparationRule(Strict):
    """Distance between two vehicles, now and predicted. The later one in the YAML yields."""

    do: Do = "hold"
    """What is done: none, hold, land or terminate."""
    at_m: Positive = 0.8
    """Smallest distance of their centres [m]."""
    ahead_s: Annotated[float, Field(gt=0, le=10)] = 3.0
    """Prediction time [s]."""


class TiltRule(Strict):
    """Tilt of a vehicle."""

    do: Do = "land"
    """What is done: none, hold, land or terminate."""
    above_deg: Annotated[float, Field(gt=0, le=180)] = 55.0
    """Largest tilt [deg]."""
    for_s: NotNegative = 0.3
    """Time before the rule acts [s]."""


class SpeedRule(Strict):
    """Speed of a vehicle."""

    do: Do = "hold"
    """What is done: none, hold, land or terminate."""
    above_m_s: Positive = 5.0
    """Largest speed [m/s]."""


class PoseAgeRule(Strict):
    """Age of the motion capture pose of a vehicle that flies by it."""

    do: Do = "land"
    """What is done: none, hold, land or terminate."""
    above_s: Positive = 0.5
    """Largest age [s]."""


class EstimateRule(Strict):
    """Difference between the autopilot's estimate and the motion capture."""

    do: Do = "land"
    """What is done: none, hold, land or terminate."""
    off_m: Positive = 0.3
    """Largest difference [m]."""
    for_s: NotNegative = 0.5
    """Time before the rule acts [s]."""


class BatteryRule(Strict):
    """Charge of a battery, independent of the autopilot's own failsafe."""

    do: Do = "land"
    """What is done: none, hold, land or terminate."""
    below: Annotated[float, Field(gt=0, lt=1)] = 0.1
    """Lowest charge, from 0 to 1."""


class ProgramRule(Strict):
    """Heartbeat of the program in OFFBOARD, once it has sent one since arming."""

    do: Do = "land"
    """What is done: none, hold, land or terminate."""
    silent_s: Annotated[float, Field(ge=0.5, le=60)] = 1.0
    """Time before the rule acts [s]."""


class Copilot(Strict):
    """A process that watches every vehicle by the motion capture, and orders hold, land or terminate by these rules."""

    on_loss: Literal["land", "restart", "warn"] = "land"
    """What happens when the copilot itself ends: land and stop the arena, restart the copilot, or warn."""
    escalate_after_s: Annotated[float, Field(ge=0.5, le=60)] = 2.0
    """Time after which a rule that is still violated gets the next step: hold, land, terminate [s]."""
    at_most: Step = "land"
    """Strongest step. Only `terminate` may stop the motors of a flying vehicle."""
    geofence: GeofenceRule = GeofenceRule()
    """Stopping before the fence."""
    separation: SeparationRule = SeparationRule()
    """Distance between vehicles."""
    tilt: TiltRule = TiltRule()
    """Tilt."""
    speed: SpeedRule = SpeedRule()
    """Speed."""
    pose_age: PoseAgeRule = PoseAgeRule()
    """Age of poses."""
    estimate: EstimateRule = EstimateRule()
    """Estimate against motion capture."""
    battery: BatteryRule = BatteryRule()
    """Battery charge."""
    program: ProgramRule = ProgramRule()
    """The program's heartbeat."""

    @model_validator(mode="after")
    def _within_at_most(self) -> Copilot:
        """Refuse a rule whose action `at_most` forbids."""
        for rule in RULES:
            do: str = getattr(self, rule).do
            if _STEPS.index(do) > _STEPS.index(self.at_most):
                raise ValueError(
                    f"at_most: {do}, which {rule}.do asks for, or a gentler {rule}.do; at_most is {self.at_most}"
                )
        return self


RULES = ("geofence", "separation", "tilt", "speed", "pose_age", "estimate", "battery", "program")
