"""The YAML's section `copilot`: what is watched in flight, and what is done then. Present, even empty, means on."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from arena.schema.base import NotNegative, Positive, Strict

Step = Literal["hold", "land", "terminate"]
Do = Literal["none", "hold", "land", "terminate"]
_STEPS = ("none", "hold", "land", "terminate")


class GeofenceRule(Strict):
    """The way that a vehicle needs to stop would pass the geofence; without one, the room's walls."""

    do: Do = "hold"
    """What is done: none, hold, land or terminate."""
    reserve_m: NotNegative = 0.2
    """Kept beside the stopping distance [m]."""


class SeparationRule(Strict):
    """Two vehicles are, or will be, too close to each other. The later in the YAML yields."""

    do: Do = "hold"
    """What is done: none, hold, land or terminate."""
    at_m: Positive = 0.8
    """Least distance of their centres [m]."""
    ahead_s: Annotated[float, Field(gt=0, le=10)] = 3.0
    """How far is looked ahead [s]."""


class TiltRule(Strict):
    """A vehicle leans too far."""

    do: Do = "land"
    """What is done: none, hold, land or terminate."""
    above_deg: Annotated[float, Field(gt=0, le=180)] = 55.0
    """Farther than this [deg]."""
    for_s: NotNegative = 0.3
    """For so long [s]."""


class SpeedRule(Strict):
    """A vehicle is too fast."""

    do: Do = "hold"
    """What is done: none, hold, land or terminate."""
    above_m_s: Positive = 5.0
    """Faster than this [m/s]."""


class PoseAgeRule(Strict):
    """The motion capture does not see a vehicle that flies by it."""

    do: Do = "land"
    """What is done: none, hold, land or terminate."""
    above_s: Positive = 0.5
    """For longer than this [s]."""


class EstimateRule(Strict):
    """The autopilot believes to be elsewhere than the motion capture sees it."""

    do: Do = "land"
    """What is done: none, hold, land or terminate."""
    off_m: Positive = 0.3
    """Farther off than this [m]."""
    for_s: NotNegative = 0.5
    """For so long [s]."""


class BatteryRule(Strict):
    """A battery is low, whatever its autopilot thinks of that."""

    do: Do = "land"
    """What is done: none, hold, land or terminate."""
    below: Annotated[float, Field(gt=0, lt=1)] = 0.1
    """Charge left, from 0 to 1."""


class ProgramRule(Strict):
    """In OFFBOARD, the program's own heartbeat has stopped, once it has beaten in this arming."""

    do: Do = "land"
    """What is done: none, hold, land or terminate."""
    silent_s: Annotated[float, Field(ge=0.5, le=60)] = 1.0
    """For so long [s]."""


class Copilot(Strict):
    """A process that watches every vehicle by the motion capture, and orders hold, land or terminate by these rules."""

    on_loss: Literal["land", "restart", "warn"] = "land"
    """What happens when the copilot itself ends: land and stop the arena, start it again, or only say so."""
    escalate_after_s: Annotated[float, Field(ge=0.5, le=60)] = 2.0
    """A rule that is broken so long after its answer gets the next step: hold, land, terminate [s]."""
    at_most: Step = "land"
    """The sternest step. Only `terminate` lets it stop the motors of a flying vehicle."""
    geofence: GeofenceRule = GeofenceRule()
    """Stopping in time before the fence."""
    separation: SeparationRule = SeparationRule()
    """Distance between vehicles."""
    tilt: TiltRule = TiltRule()
    """Leaning too far."""
    speed: SpeedRule = SpeedRule()
    """Flying too fast."""
    pose_age: PoseAgeRule = PoseAgeRule()
    """Not captured."""
    estimate: EstimateRule = EstimateRule()
    """Estimate against capture."""
    battery: BatteryRule = BatteryRule()
    """Charge."""
    program: ProgramRule = ProgramRule()
    """The program's heartbeat."""

    @model_validator(mode="after")
    def _within_at_most(self) -> Copilot:
        """A step that `at_most` forbids must not be asked for."""
        for rule in RULES:
            do: str = getattr(self, rule).do
            if _STEPS.index(do) > _STEPS.index(self.at_most):
                raise ValueError(
                    f"at_most: {do}, which {rule}.do asks for, or a gentler {rule}.do; at_most is {self.at_most}"
                )
        return self


RULES = ("geofence", "separation", "tilt", "speed", "pose_age", "estimate", "battery", "program")
