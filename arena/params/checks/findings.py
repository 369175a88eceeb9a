"""`Finding`, the result of a parameter check, and `CheckContext`, the input of a rule. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

from arena.params.facts.parameter_table import Parameter, Type, Version, defaults, parameters

Severity = Literal["error", "warning", "note"]


class Finding(NamedTuple):
    """A problem that a parameter check has found, with its consequence and advice.

    severity: error: the vehicle cannot fly in the arena, or a failsafe does not work.
        warning: the vehicle flies or lands worse than it could.  note: for information.
    name: name of the parameter.
    value: value found; None if the vehicle does not have the parameter.
    expected: correct value or range.
    problem: what is wrong.
    why: consequence of the problem.
    fix: what to do.
    """

    severity: Severity
    name: str
    value: float | None
    expected: str
    problem: str
    why: str
    fix: str


@dataclass(frozen=True, kw_only=True)
class Environment:
    """Equipment and room of an arena (motion capture, GPS, RC, height) for the parameter rules.

    vision: whether the vehicle gets poses from motion capture.
    gps: whether the vehicle has a GPS receiver with reception.
    rc: whether there is an RC transmitter with a pilot.
    joystick: whether a person may fly with the joystick of a ground station.
    latency_ms: delay from the camera exposure to the arrival of a pose at the autopilot [ms]; None if unknown.
    height_m: height of the room [m]; None if unknown.
    """

    vision: bool = True
    gps: bool = False
    rc: bool = False
    joystick: bool = False
    latency_ms: float | None = None
    height_m: float | None = None


@dataclass(frozen=True, kw_only=True)
class CheckContext:
    """Input of a parameter rule: the parameters of one vehicle, with PX4's defaults for missing values.

    given: parameter -> value in the file, log or vehicle.
    types: parameter -> type in the file; empty if the file has no types.
    """

    given: Mapping[str, float]
    version: Version
    environment: Environment
    types: Mapping[str, Type] = field(default_factory=dict)

    @cached_property
    def table(self) -> Mapping[str, Parameter]:
        """Return {parameter name: definition} for every parameter of this PX4 version."""
        return parameters(self.version)

    @cached_property
    def values(self) -> Mapping[str, float]:
        """All parameter values: the given values, and PX4's defaults for missing parameters."""
        return {**defaults(self.version), **self.given}

    @property
    def minor(self) -> int:
        return self.version.minor

    def value(self, name: str) -> float | None:
        """Return the value of a parameter, or None if this PX4 version has no such parameter."""
        return self.values.get(name) if name in self.table else None

    def default(self, name: str) -> float | None:
        """Return the default value of a parameter, or None if this PX4 version has no such parameter."""
        return self.table[name].default if name in self.table else None

    def bits(self, name: str) -> int:
        """Return the value of a bit mask parameter as an integer.

        Return 0 if this PX4 version does not have the parameter, or if the value is not finite.
        """
        value = self.value(name)
        return int(value) if value is not None and math.isfinite(value) else 0

    def finding(
        self,
        severity: Severity,
        name: str,
        problem: str,
        *,
        expected: str,
        why: str,
        fix: str,
        related: tuple[str, ...] = (),
    ) -> Finding:
        """Create a finding. Its severity becomes "note" if only PX4's default values cause the problem.

        The reason: a parameter that is not in the file may have another value than the default in the vehicle.
        related: other parameters that the problem depends on.
        """
        if not any(parameter in self.given for parameter in (name, *related)):
            severity = "note"
            problem = f"{problem} (not given; this is the default of PX4 {self.version})"
        return Finding(severity, name, self.values.get(name), expected, problem, why, fix)


Rule = Callable[[CheckContext], Iterator[Finding]]
