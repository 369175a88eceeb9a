"""Roles in which a vehicle is commanded (program, ground station, pilot ...), and their changes. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Role(IntEnum):
    """Role in which a person or program commands a vehicle. The role with the higher number has priority."""

    NOBODY = 0
    GROUND_STATION = 1
    PROGRAM = 2
    COPILOT = 3
    EMERGENCY = 4
    PILOT = 5

    @property
    def words(self) -> str:
        """Name of the role as shown to the user; `land-all` for EMERGENCY."""
        return {Role.EMERGENCY: "land-all"}.get(self, self.name.lower().replace("_", " "))


@dataclass(frozen=True, kw_only=True)
class Change:
    """Change of authority over a vehicle: which role commands the vehicle now, why, and since when.

    holder: role that commands the vehicle now. why: the reason. at: time [s].
    """

    holder: Role
    why: str
    at: float

    def __str__(self) -> str:
        return f"{self.holder.words} has control: {self.why}" if self.holder else self.why
