"""Settings of the copilot, read from its JSON configuration (slice): the rules and the vehicles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

Step = Literal["hold", "land", "terminate"]
Do = Literal["none", "hold", "land", "terminate"]
Address = tuple[str, int]
STEP_HZ = 50.0
"""Rate at which the copilot checks the rules [Hz]."""
STEPS: tuple[Step, ...] = ("hold", "land", "terminate")


@dataclass(frozen=True, kw_only=True)
class Rules:
    """Rules of the copilot in one arena: actions and limits.

    do: rule -> action. figure: "rule.key" -> value, with the names of the YAML.
    escalate_after_s: time for which a violation may last after an order before the next step follows, up to
    `at_most` [s].
    latency_s: age of a captured pose when it arrives [s].
    """

    do: Mapping[str, Do]
    figure: Mapping[str, float]
    escalate_after_s: float
    at_most: Step
    latency_s: float

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> Rules:
        """Read the safety rules from the copilot's JSON configuration."""
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
        """Return whether a rule is switched on: its action `do` is not `none`."""
        return self.do[rule] != "none"


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """Settings of one vehicle: id, addresses, geofence and braking limits.

    low, high: corners of the fence [m] [NED] (3,); there is no lower limit, because the vehicle may land.
    accel, jerk: limits of a horizontal stop [m/s2], [m/s3].
    up, down: deceleration when a climb or a descent is stopped [m/s2].
    poses: the vehicle flies with motion capture. tools, panic: addresses of its tools port and panic link.
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
        """Read the settings of one vehicle from its entry in the copilot's JSON configuration."""
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
