"""Lines of generated parameters, and what every part of the generation shares. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from arena.params.facts.parameter_table import Parameter, Version, parameters
from arena.params.generation.requirements import Requirements


class Line(NamedTuple):
    """A generated parameter.

    meaning: its effect here.
    reason: who asked for it: `arena.yaml:7`, `profile iris`, `arena's default`, ...
    """

    name: str
    value: float
    meaning: str
    reason: str


class LineWriter:
    """The requirements of one vehicle, the parameters that its version has, and what turned out not to be possible."""

    def __init__(self, required: Requirements, version: Version) -> None:
        self.required, self.version = required, version
        self.known: Mapping[str, Parameter] = parameters(version)
        self.not_possible: list[str] = []

    def line(self, name: str, value: float, meaning: str, requirement: str) -> Line:
        """Return a line whose reason is that of a requirement (a key of `Requirements.reasons`)."""
        return Line(name, value, meaning, self.required.reasons.get(requirement, "arena's default"))

    def within_limits(self, name: str, value: float, requirement: str) -> float:
        """Return the nearest value that PX4 accepts, rounded for an INT32; a changed value is added to `not_possible`."""
        known = self.known[name]
        accepted = min(
            max(value, -math.inf if known.min is None else known.min),
            math.inf if known.max is None else known.max,
        )
        if abs(accepted - value) > 1e-6 * max(1.0, abs(value)):
            self.not_possible.append(
                f"{requirement} would be {name} {value:g}, outside the limits of PX4 {self.version}: {accepted:g} is set"
            )
        return round(accepted) if known.type == "INT32" else accepted
