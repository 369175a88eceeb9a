"""The slice of the copilot as values: its rules, and what it knows of each vehicle."""

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
    """What is watched, rule -> (what is done, its figures by their YAML names).

    escalate_after_s: a rule still broken so long after its answer [s] gets the next step, up to `at_most`.
    latency_s: age of a captured pose when it arrives [s].
    """

    do: Mapping[str, Do]
    figure: Mapping[str, float]
    escalate_after_s: float
    at_most: Step
    latency_s: float

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> Rules:
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
        return self.do[rule] != "none"


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """low, high: corners of the box its origin must stay in [m] [NED] (3,); the floor is no wall: it may land.

    accel, jerk: of a horizontal stop [m/s2], [m/s3]; up, down: of the stop of a climb and of a descent [m/s2].
    poses: the capture system sees it, and it flies by that.  tools, panic: where it hears us.
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
