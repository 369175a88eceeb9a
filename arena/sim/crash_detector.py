"""Crash detection and flight record of each vehicle, from the true state only. Pure.

A crash is a contact with anything except the floor, a touchdown that is too fast, or a tilt that is too
large. The vehicle's class sets the limits. Only the first crash of a vehicle is recorded.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.kernels.arrays import array
from arena.kernels.flight_watch import FlightWatch
from arena.vehicle_models import CrashLimits

Array = NDArray[np.float64]

_MIN_FLIGHT_S = 0.1  # the contact of a standing body flickers: shorter gaps are not flights


@dataclass(kw_only=True)
class FlightRecord:
    """Crash, landings and extreme values of one vehicle's flight so far.

    crashed: reason and time of the first crash, "" if there was none
    touchdown_m_s: speed at the last landing [m/s], None before the first
    landed_p_n: body origin at the last landing [m] [NED], None before the first
    p_n: body origin now [m] [NED]
    airborne_s: total time off the floor [s]
    airborne: True if the vehicle is off the floor now
    max_tilt_rad: largest angle between the body's z axis and the vertical [rad]
    max_height_m: largest height of the body origin [m]
    """

    name: str
    crashed: str = ""
    touchdown_m_s: float | None = None
    landed_p_n: tuple[float, float, float] | None = None
    p_n: tuple[float, float, float] = (0.0, 0.0, 0.0)
    airborne_s: float = 0.0
    airborne: bool = False
    landings: int = 0
    max_tilt_rad: float = 0.0
    max_height_m: float = 0.0
    _airborne_since: float = field(default=math.inf, repr=False)

    def to_json(self) -> dict[str, Any]:
        """Return the flight record as a JSON-ready object with rounded values.

        The tilt is in degrees.
        """
        return {
            "crashed": self.crashed,
            "airborne": self.airborne,
            "airborne_s": round(self.airborne_s, 3),
            "landings": self.landings,
            "touchdown_m_s": None if self.touchdown_m_s is None else round(self.touchdown_m_s, 3),
            "landed_p_n": None if self.landed_p_n is None else [round(x, 4) for x in self.landed_p_n],
            "p_n": [round(x, 4) for x in self.p_n],
            "max_tilt_deg": round(math.degrees(self.max_tilt_rad), 2),
            "max_height_m": round(self.max_height_m, 3),
        }


class CrashDetector:
    """Detector of crashes and landings of all vehicles, with a flight record for each vehicle.

    It is updated once per sensor period.

    limits: crash limits of each vehicle
    p_n, v_n: position [m] and velocity [m/s] [NED], which `step` reads (V, 3)
    r_nb: rotation matrix of the attitude, which `step` reads (V, 3, 3)
    step_s: sensor period [s]
    """

    def __init__(
        self,
        names: Sequence[str],
        limits: Sequence[CrashLimits],
        *,
        p_n: Array,
        v_n: Array,
        r_nb: Array,
        step_s: float,
    ) -> None:
        self.records = [FlightRecord(name=name) for name in names]
        self._max_touchdown = [limit.touchdown_m_s for limit in limits]
        self._min_cos_tilt: Array = np.array([math.cos(limit.tilt_rad) for limit in limits])
        self._new: list[str] = []
        self._floor = np.ones(len(names), bool)
        self._p_n, self._r_nb = p_n, r_nb
        self._watch = FlightWatch(p_n, v_n, r_nb, self._floor, step_s)
        array(self._watch.min_cos_tilt)[:] = self._min_cos_tilt

    def step(self, *, now: float, floor: NDArray[np.bool_], others: Mapping[int, str]) -> None:
        """Update all flight records with the current true state.

        now: simulation time [s]
        floor: True for each vehicle that touches the floor (V,)
        others: name of the wall, ceiling, obstacle or vehicle that a vehicle touches, by row of the vehicle
        """
        for i, what in others.items():
            self._crash(i, now, f"touched {what}")
        self._floor[...] = floor
        if self._watch.step():
            self._record(now)
        self._watch.finish()

    def _record(self, now: float) -> None:
        """Record the vehicles that tilted too far, touched down or lifted off in this step."""
        cos_tilt = self._r_nb[:, 2, 2]
        for i in (cos_tilt < self._min_cos_tilt).nonzero()[0].tolist():
            tilt = math.acos(max(-1.0, float(cos_tilt[i])))
            self._crash(i, now, f"tilted {math.degrees(tilt):.0f} degrees")
        for i in (self._floor != np.asarray(self._watch.was_on_floor)).nonzero()[0].tolist():
            if self._floor[i]:
                self._touch_down(i, now)
            else:
                self.records[i]._airborne_since = now

    def events(self) -> list[str]:
        """Return one text line for each crash since the last call."""
        new, self._new = self._new, []
        return new

    def report(self) -> dict[str, dict[str, Any]]:
        """Return the flight record of each vehicle, by vehicle name, as JSON objects."""
        watch = self._watch
        for i, record in enumerate(self.records):
            record.airborne, record.airborne_s = not bool(self._floor[i]), watch.airborne_s[i]
            record.p_n = _triple(self._p_n[i])
            record.max_tilt_rad = math.acos(min(max(watch.least_cos_tilt[i], -1.0), 1.0))
            record.max_height_m = -watch.least_down[i] if math.isfinite(watch.least_down[i]) else 0.0
        return {record.name: record.to_json() for record in self.records}

    def _touch_down(self, i: int, now: float) -> None:
        """Record that a vehicle has touched the floor: as a landing, or as a crash if it was too fast.

        The recorded speed is the largest of the three steps before. The speed of this step contains the impact already, and pybullet
        can brake a body in the step before the contact, so that it does not get into the floor.
        """
        record, speed = self.records[i], self._watch.speed_before(i)
        if now - record._airborne_since >= _MIN_FLIGHT_S:
            record.touchdown_m_s, record.landings = speed, record.landings + 1
            record.landed_p_n = _triple(self._p_n[i])
        if speed > self._max_touchdown[i]:
            self._crash(i, now, f"touched down at {speed:.1f} m/s")

    def _crash(self, i: int, now: float, what: str) -> None:
        record = self.records[i]
        if not record.crashed:
            record.crashed = f"{what} at {now:.2f} s"
            self._new.append(f"{record.name} crashed: {record.crashed}")


def _triple(v: Array) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])
