"""Storage of the telemetry and poses that a user program has received.

The data groups (`uav.ekf`, ...) read their values from it; values that are older than their age limit raise StaleDataError.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from arena.errors import StaleDataError
from arena.uav.measurements import Measurements, RelativeSensors
from arena.uav.poses import Poses
from arena.wire.telemetry import Telemetry

# Age limit of a group, in multiples of `stale_s`: longer for what PX4 sends at a low rate.
_AGE_LIMITS = {
    "heartbeat": 6.0,
    "landed state": 6.0,
    "actuators": 2.0,
    "gps": 6.0,
    "battery": 20.0,
    "connection": 6.0,
}


class Stamped(Protocol):
    """Interface of a received value that contains its time of arrival [s]."""

    @property
    def received_at(self) -> float: ...


S = TypeVar("S", bound=Stamped)


@dataclass(frozen=True, kw_only=True)
class Body:
    """Constants of the vehicle: name, mass, size, number of rotors and thrust curve.

    mass: [kg]. radius, height: [m]. thrust_curve: settings from the vehicle's profile, see `arena.thrust_curve`.
    """

    ns: str
    mass: float
    radius: float
    height: float
    num_rotors: int
    thrust_curve: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Source:
    """Storage of one vehicle's received telemetry and poses.

    All data groups (`uav.ekf`, `uav.sen`, ...) read from it.

    ns: name of the vehicle.
    stale_s: age limit of most values [s]. Values that PX4 sends at a low rate have a multiple of it.
    refresh: function that reads the received data.
    now: function that returns the time by which ages are computed [s].
    """

    ns: str
    stale_s: float
    telemetry: Telemetry
    poses: Poses
    relative: Measurements = field(default_factory=lambda: Measurements(RelativeSensors(), 0))
    now: Callable[[], float]
    refresh: Callable[[], None]

    def fixed(self) -> Source:
        """Return a copy of this storage, for `UAV.snapshot`. Its values and its time never change."""
        self.refresh()
        instant = self.now()
        return Source(
            ns=self.ns,
            stale_s=self.stale_s,
            telemetry=copy.copy(self.telemetry),
            poses=copy.copy(self.poses),
            relative=copy.copy(self.relative),
            now=lambda: instant,
            refresh=lambda: None,
        )

    def limit_s(self, what: str) -> float:
        """Return the age above which a value is stale [s].

        what: name of the value, as in error messages.
        """
        return self.stale_s * _AGE_LIMITS.get(what, 1.0)

    def fresh(self, value: S | None, what: str, limit_s: float | None = None) -> S:
        """Return a received value that is fresh. Raises StaleDataError if it has not arrived or is too old.

        what: name of the data, for the age limit and the error message.  limit_s: age limit [s]; None: that of `limit_s`.
        """
        if value is None:
            raise StaleDataError(f"{self.ns}: no {what} has arrived yet")
        age = self.now() - value.received_at
        limit = self.limit_s(what) if limit_s is None else limit_s
        if age > limit:
            raise StaleDataError(f"{self.ns}: {what} is {age:.2f} s old (limit {limit:g} s)")
        return value

    def age(self, value: Stamped | None) -> float:
        """Return the age of a value [s]. It is infinite if the value has not arrived."""
        return math.inf if value is None else max(0.0, self.now() - value.received_at)
