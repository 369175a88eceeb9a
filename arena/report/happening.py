"""Entry of a report's list of events, such as a takeoff, a fault or a landing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal[
    "crash", "failsafe", "fault", "pilot", "copilot", "process", "refused", "warning", "text", "flight", "mode", "arena", "step"
]  # fmt: skip
Level = Literal["bad", "warn", "good", "note"]


@dataclass(frozen=True, kw_only=True)
class Happening:
    """Entry of a report's list of events, such as a takeoff, a fault or a landing.

    at_s: time on the report's time axis [s], NaN if unknown.  vehicles: names of the vehicles concerned, () for all or none.
    level: "bad" is a crash or a failure, "warn" needs attention, "good" is a normal part of a flight, "note" is a detail.
    """

    at_s: float
    kind: Kind
    level: Level
    vehicles: tuple[str, ...]
    text: str
