"""The verdict on each vehicle, from the truth alone. Pure.

A crash is a contact with anything but the floor, a touchdown above 1.5 m/s, or a tilt above 60 degrees. The
first one stands.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TOUCHDOWN_M_S = 1.5
TILT_RAD = math.radians(60.0)
_COS_TILT = math.cos(TILT_RAD)
# A standing body's contact flickers; that is not a flight.
_FLIGHT_S = 0.1


@dataclass(kw_only=True)
class Verdict:
    """One vehicle. crashed: the reason, with its time, or "".

    touchdown_m_s: speed at the last landing [m/s] and landed_p_n where that was, body origin [m] [NED]; None
    before the first. airborne_s: time off the floor so far [s]. max_tilt_rad: of the body's z axis from the
    vertical. max_height_m: of its origin.
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
    _aloft_since: float = field(default=math.inf, repr=False)

    def to_json(self) -> dict[str, Any]:
        """What the room tells of it: SI, rounded; the tilt in degrees."""
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


class Judge:
    """Watches the fleet, one call per sensor period."""

    def __init__(self, names: Sequence[str], *, step_s: float) -> None:
        self.verdicts = [Verdict(name=name) for name in names]
        self._step_s = step_s
        self._told: list[str] = []
        self._cos_tilt, self._down = np.ones(len(names)), np.full(len(names), math.inf)
        self._aloft_s = np.zeros(len(names))
        self._floor = np.ones(len(names), bool)
        self._p_n: Array = np.full((len(names), 3), math.nan)
        self._v_n: Array = np.zeros((len(names), 3))

    def watch(
        self,
        *,
        now: float,
        p_n: Array,
        v_n: Array,
        cos_tilt: Array,
        floor: NDArray[np.bool_],
        others: Mapping[int, str],
    ) -> None:
        """now [s]; p_n [m] (V, 3), v_n [m/s] (V, 3), NED; cos_tilt: body z along down [-] (V,); floor: does
        it touch the floor (V,); others: what else it touches, by vehicle. The arrays are kept, not copied.
        """
        for i, what in others.items():
            self._crash(i, now, f"touched {what}")
        np.minimum(self._cos_tilt, cos_tilt, out=self._cos_tilt)
        np.minimum(self._down, p_n[:, 2], out=self._down)
        for i in (cos_tilt < _COS_TILT).nonzero()[0].tolist():
            self._crash(
                i, now, f"tilted {math.degrees(math.acos(max(-1.0, float(cos_tilt[i])))):.0f} degrees"
            )
        for i in (floor != self._floor).nonzero()[0].tolist():
            if floor[i]:
                self._touch_down(i, now, p_n[i])
            else:
                self.verdicts[i]._aloft_since = now
        self._floor, self._p_n, self._v_n = floor, p_n, v_n
        self._aloft_s += ~floor * self._step_s

    def events(self) -> list[str]:
        """Lines since the last call: one per crash."""
        told, self._told = self._told, []
        return told

    def report(self) -> dict[str, dict[str, Any]]:
        """Vehicle name -> its verdict as JSON."""
        for i, v in enumerate(self.verdicts):
            v.airborne, v.airborne_s = not bool(self._floor[i]), float(self._aloft_s[i])
            v.p_n = _triple(self._p_n[i])
            v.max_tilt_rad = math.acos(float(np.clip(self._cos_tilt[i], -1.0, 1.0)))
            v.max_height_m = -float(self._down[i]) if math.isfinite(self._down[i]) else 0.0
        return {v.name: v.to_json() for v in self.verdicts}

    def _touch_down(self, i: int, now: float, p_n: Array) -> None:
        """The speed is that of the step before: the contact has already taken it out of this one's."""
        verdict, speed = self.verdicts[i], math.sqrt(float((self._v_n[i] * self._v_n[i]).sum()))
        if now - verdict._aloft_since >= _FLIGHT_S:
            verdict.touchdown_m_s, verdict.landings = speed, verdict.landings + 1
            verdict.landed_p_n = _triple(p_n)
        if speed > TOUCHDOWN_M_S:
            self._crash(i, now, f"touched down at {speed:.1f} m/s")

    def _crash(self, i: int, now: float, what: str) -> None:
        if not self.verdicts[i].crashed:
            self.verdicts[i].crashed = f"{what} at {now:.2f} s"
            self._told.append(f"{self.verdicts[i].name} crashed: {self.verdicts[i].crashed}")


def _triple(v: Array) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])
