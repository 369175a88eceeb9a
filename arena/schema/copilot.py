"""The YAML section `copilot`: safety rules that the copilot checks in flight.

An empty section enables all rules.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from arena.schema.base import NotNegative, Positive, Strict

Step = Literal["hold", "land", "terminate"]
Do = Literal["none", "hold", "land", "terminate"]
_STEPS = ("none", "hold", "land", "terminate")


class GeofenceRule(Strict):
    """Rule: the vehicle must be able to stop inside the geofence.

    Without a geofence, the room's walls count.
    """

    do: Do = "hold"
    """Action: none, hold, land or terminate."""
    reserve_m: NotNegative = 0.2
    """Distance added to the stopping distance [m]."""


class SeparationRule(Strict):
    """Rule: two vehicles must not come closer to each other than a minimum distance.

    The copilot checks the present distance and the predicted one. The vehicle that comes later in the YAML yields.
    """

    do: Do = "hold"
    """Action: none, hold, land or terminate."""
    at_m: Positive = 0.8
    """Smallest distance between the centres [m]."""
    ahead_s: Annotated[float, Field(gt=0, le=10)] = 3.0
    """Prediction time [s]."""


class TiltRule(Strict):
    """Rule: largest tilt of a vehicle."""

    do: Do = "land"
    """Action: none, hold, land or terminate."""
    above_deg: Annotated[float, Field(gt=0, le=180)] = 55.0
    """Largest tilt [deg]."""
    for_s: NotNegative = 0.3
    """Time before the rule acts [s]."""


class SpeedRule(Strict):
    """Rule: largest speed of a vehicle."""

    do: Do = "hold"
    """Action: none, hold, land or terminate."""
    above_m_s: Positive = 5.0
    """Largest speed [m/s]."""


class PoseAgeRule(Strict):
    """Rule: largest age of the motion capture pose, for vehicles that receive poses from a pose forwarder."""

    do: Do = "land"
    """Action: none, hold, land or terminate."""
    above_s: Positive = 0.5
    """Largest age [s]."""


class EstimateRule(Strict):
    """Rule: largest distance between the autopilot's position estimate and the motion capture position."""

    do: Do = "land"
    """Action: none, hold, land or terminate."""
    off_m: Positive = 0.3
    """Largest distance [m]."""
    for_s: NotNegative = 0.5
    """Time before the rule acts [s]."""


class BatteryRule(Strict):
    """Rule: lowest battery charge. It does not replace the autopilot's own failsafe."""

    do: Do = "land"
    """Action: none, hold, land or terminate."""
    below: Annotated[float, Field(gt=0, lt=1)] = 0.1
    """Lowest charge, from 0 to 1."""


class ProgramRule(Strict):
    """Rule: in OFFBOARD, the user program must send heartbeats.

    The rule applies from the first heartbeat after arming.
    """

    do: Do = "land"
    """Action: none, hold, land or terminate."""
    silent_s: Annotated[float, Field(ge=0.5, le=60)] = 1.0
    """Time without a heartbeat before the rule acts [s]."""


class Copilot(Strict):
    """Copilot process: it monitors all vehicles by motion capture and acts when a rule is violated.

    Its commands are hold, land and terminate.
    """

    on_loss: Literal["land", "restart", "warn"] = "land"
    """Reaction to the end of the copilot process: land and stop the arena, restart the copilot, or warn."""
    escalate_after_s: Annotated[float, Field(ge=0.5, le=60)] = 2.0
    """Time after which a rule that is still violated causes the next stronger action: hold, land, terminate [s]."""
    at_most: Step = "land"
    """Strongest action that is allowed. Only `terminate` stops the motors of a flying vehicle."""
    geofence: GeofenceRule = GeofenceRule.model_construct()
    """Vehicles stop before the geofence."""
    separation: SeparationRule = SeparationRule.model_construct()
    """Smallest distance between two vehicles."""
    tilt: TiltRule = TiltRule.model_construct()
    """Largest tilt of a vehicle."""
    speed: SpeedRule = SpeedRule.model_construct()
    """Largest speed of a vehicle."""
    pose_age: PoseAgeRule = PoseAgeRule.model_construct()
    """Largest age of motion capture poses."""
    estimate: EstimateRule = EstimateRule.model_construct()
    """Largest distance between the estimated and the captured position."""
    battery: BatteryRule = BatteryRule.model_construct()
    """Lowest battery charge."""
    program: ProgramRule = ProgramRule.model_construct()
    """The program sends heartbeats."""

    @model_validator(mode="after")
    def _within_at_most(self) -> Self:
        """Refuse a rule whose action (`do`) is stronger than `at_most`, the strongest allowed action."""
        for rule in RULES:
            do: str = getattr(self, rule).do
            if _STEPS.index(do) > _STEPS.index(self.at_most):
                raise ValueError(
                    f"expected {rule}.do no stronger than at_most, got {rule}.do: {do} and at_most: {self.at_most}. "
                    f"Set at_most: {do}, or choose a weaker {rule}.do"
                )
        return self


RULES = ("geofence", "separation", "tilt", "speed", "pose_age", "estimate", "battery", "program")
