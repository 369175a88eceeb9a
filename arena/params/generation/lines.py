"""Helper classes of the parameter generation: `Line` (one parameter) and `LineWriter`. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from arena.params.facts.parameter_table import Parameter, Version, parameters
from arena.params.generation.requirements import Requirements


class Line(NamedTuple):
    """A generated PX4 parameter, with the effect of its value and the reason for it.

    meaning: effect of this value, as text.
    reason: source of the requirement: `arena.yaml:7`, `profile iris`, `arena's default`, ...
    """

    name: str
    value: float
    meaning: str
    reason: str


class LineWriter:
    """Creates the generated parameters (`Line`) of one vehicle, and collects requirements that PX4 cannot meet.

    required: requirements of the vehicle.
    version: PX4 version of the vehicle.
    not_possible: one sentence per requirement that could not be met.
    requirement_of: parameter -> key of the requirement from which its newest line was made.
    needed: parameters without which a failsafe does not act; a parameter file does not replace them.
    """

    def __init__(self, required: Requirements, version: Version) -> None:
        self.required, self.version = required, version
        self.known: Mapping[str, Parameter] = parameters(version)
        self.not_possible: list[str] = []
        self.requirement_of: dict[str, str] = {}
        self.needed: set[str] = set()

    def line(self, name: str, value: float, meaning: str, requirement: str) -> Line:
        """Return a generated parameter, with the reason why the arena needs this value.

        meaning: effect of the value, as text.

        requirement: key of `Requirements.reasons`; its value becomes the line's reason.
        """
        self.requirement_of[name] = requirement
        return Line(name, value, meaning, self.required.reasons.get(requirement, "arena's default"))

    def within_limits(self, name: str, value: float, requirement: str) -> float:
        """Return `value`, or the nearest value that PX4 allows for the parameter `name`.

        The value is rounded if the parameter is an INT32. If the value had to change, a sentence is added to
        `not_possible`.
        """
        known = self.known[name]
        accepted = min(
            max(value, -math.inf if known.min is None else known.min),
            math.inf if known.max is None else known.max,
        )
        if abs(accepted - value) > 1e-6 * max(1.0, abs(value)):
            self.not_possible.append(
                f"{requirement} needs {name} {value:g}, which is outside the limits of PX4 {self.version}; {accepted:g} is set instead"
            )
        return round(accepted) if known.type == "INT32" else accepted
