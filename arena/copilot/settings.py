"""The copilot's slice as values: rules and vehicles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

Step = Literal["hold", "land", "terminate"]
Do = Literal["none", "hold", "land", "terminate"]
Address = tuple[str, int]
STEPS: tuple[Step, ...] = ("hold", "land", "terminate")


@dataclass(frozen=True, kw_only=True)
class Rules:
    """The rules of an arena.

    do: rule -> action. figure: "rule.key" -> value, by the names of the YAML.
    escalate_after_s: a violation that lasts so long after its order [s] gets the next step, up to `at_most`.
    latency_s: age of a captured pose on arrival [s].
    """

    do: Mapping[str, Do]
    figure: Mapping[str, float]
    escalate_after_s: float
    at_most: Step
    latency_s: float

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> Rules:
        """Return the rules of a slice."""
        rules = settings["rules"]
        figures = {
            f"{rule}.{key}": float(x)
            for rule, keys in rules.items()
            for key, x in keys.items()
            if key != "do"
        }
        return cls(
            do={rule: keys["do"] for rule, keys in rules.items()},
            figure=figures,
            at_most=settings["at_most"],
            escalate_after_s=float(settings["escalate_after_s"]),
            latency_s=float(settings["latency_s"]),
        )

    def on(self, rule: str) -> bool:
        """Return whether a rule is active."""
        return self.do[rule] != "none"


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """A vehicle as the copilot needs it.

    low, high: corners of the fence [m] [NED] (3,); there is no lower limit, as the vehicle may land.
    accel, jerk: of a horizontal stop [m/s2], [m/s3]. up, down: of the stop of a climb and of a descent [m/s2].
    poses: the vehicle flies by motion capture. tools, panic: addresses of its tools port and panic link.
    """

    name: str
    id: int
    body: str
    simulated: bool
    poses: bool
    tools: Address
    panic: Address
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    accel: float
    jerk: float
    up: float
    down: float

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> Vehicle:
        """Return the vehicle of one row of the slice."""
        fence, braking = row["fence"], row["braking"]
        (north_lo, north_hi), (east_lo, east_hi) = fence["north"], fence["east"]
        return cls(
            name=row["name"],
            id=int(row["id"]),
            body=row["body"],
            simulated=bool(row["simulated"]),
            poses=bool(row["poses"]),
            tools=(row["tools"][0], int(row["tools"][1])),
            panic=(row["panic"][0], int(row["panic"][1])),
            low=(north_lo, east_lo, -fence["up"]),
            high=(north_hi, east_hi, float("inf")),
            **{key: float(braking[key]) for key in ("accel", "jerk", "up", "down")},
        )
