"""Rules of the copilot, such as geofence and speed: finds the vehicles that violate a rule.

Pure; a rule with a duration stores when its condition began.

An unknown value never violates a rule: it is NaN, and comparisons with NaN are false, or a mask excludes it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from arena.copilot.fleet_state import FleetState, Mask, Violation, length
from arena.copilot.separation import SeparationResult, separation
from arena.copilot.settings import Rules, Vehicle

_OUTWARDS_M_S, _FLEES_M_S = 0.1, 0.5
_SIDES = (("south", "north"), ("west", "east"), ("ceiling", "floor"))


class RuleChecker:
    """Checker of all rules of the copilot, such as geofence, separation and speed.

    For a rule with a duration it stores when the condition began. Call `violations` once per step.
    """

    def __init__(self, rules: Rules, vehicles: Sequence[Vehicle]) -> None:
        self._rules = rules
        self._names = [v.name for v in vehicles]
        self._low = np.array([v.low for v in vehicles], dtype=np.float64)
        self._high = np.array([v.high for v in vehicles], dtype=np.float64)
        self._poses = np.array([v.poses for v in vehicles], dtype=np.bool_)
        self._since = {rule: np.full(len(vehicles), np.inf) for rule in ("tilt", "estimate")}
        self.found = SeparationResult(broken=(), meeting=(), closest=math.inf)

    def violations(self, m: FleetState) -> list[Violation]:
        """Return all violations of rules by flying vehicles.

        Vehicles that the copilot must not command are included.
        """
        each = {
            "geofence": self._geofence,
            "separation": self._separation,
            "tilt": self._tilt,
            "speed": self._speed,
            "pose_age": self._pose_age,
            "estimate": self._estimate,
            "battery": self._battery,
            "program": self._program,
        }
        return [b for rule, of in each.items() if self._rules.on(rule) for b in of(m) if m.flying[b.row]]

    def _geofence(self, m: FleetState) -> Iterator[Violation]:
        reserve = self._rules.figure["geofence.reserve_m"]
        way = m.stop.way
        end = m.p_n + way
        judged = (m.placed & m.flying)[:, None]
        above, below = m.v_n > _OUTWARDS_M_S, m.v_n < -_OUTWARDS_M_S
        past_high = judged & m.moving[:, None] & above & (end > self._high - reserve)
        past_low = judged & m.moving[:, None] & below & (end < self._low + reserve)
        past_high |= judged & ~below & (m.p_n > self._high)
        past_low |= judged & ~above & (m.p_n < self._low)
        past = past_high | past_low
        for row, axis in np.argwhere(past) if past.any() else ():
            high = bool(past_high[row, axis])
            left = float(
                self._high[row, axis] - m.p_n[row, axis] if high else m.p_n[row, axis] - self._low[row, axis]
            )
            speed, needs = abs(float(m.v_n[row, axis])), abs(float(way[row, axis]))
            why = _fence_text(left, needs, reserve, speed, _SIDES[axis][high])
            # beyond the fence a landing is sufficient, unless the vehicle flies on outwards
            outwards = float(m.v_n[row, axis]) * (1.0 if high else -1.0)
            yield Violation(
                row=int(row),
                rule="geofence",
                why=why,
                enough="terminate" if outwards > _FLEES_M_S else "land",
            )

    def _separation(self, m: FleetState) -> Iterator[Violation]:
        figure = self._rules.figure
        self.found = separation(m, figure["separation.at_m"], figure["separation.ahead_s"], self._names)
        yield from self.found.broken

    def _tilt(self, m: FleetState) -> Iterator[Violation]:
        limit = self._rules.figure["tilt.above_deg"]
        for row in self._lasting(m, "tilt", m.placed & (m.tilt > math.radians(limit))):
            yield Violation(
                row=row,
                rule="tilt",
                why=f"its tilt is {math.degrees(m.tilt[row]):.0f} deg (at most {limit:g} deg)",
            )

    def _speed(self, m: FleetState) -> Iterator[Violation]:
        limit = self._rules.figure["speed.above_m_s"]
        speed = length(m.v_n)
        for row in _rows(m.placed & m.moving & (speed > limit)):
            yield Violation(
                row=row, rule="speed", why=f"it flies at {speed[row]:.1f} m/s (at most {limit:g} m/s)"
            )

    def _pose_age(self, m: FleetState) -> Iterator[Violation]:
        limit = self._rules.figure["pose_age.above_s"]
        for row in _rows(self._poses & (m.pose_age > limit)):
            why = f"no captured pose for {m.pose_age[row]:.2f} s (at most {limit:g} s)"
            yield Violation(row=row, rule="pose_age", why=why, enough="land")

    def _estimate(self, m: FleetState) -> Iterator[Violation]:
        limit = self._rules.figure["estimate.off_m"]
        known = self._poses & m.placed & np.isfinite(m.off)
        for row in self._lasting(m, "estimate", known & (m.off > limit)):
            why = f"its estimate is {m.off[row]:.2f} m from its captured track (at most {limit:g} m)"
            yield Violation(row=row, rule="estimate", why=why, enough="land")

    def _battery(self, m: FleetState) -> Iterator[Violation]:
        limit = self._rules.figure["battery.below"]
        for row in _rows(m.battery < limit):
            why = f"its battery is at {100 * m.battery[row]:.0f} % (at least {100 * limit:g} %)"
            yield Violation(row=row, rule="battery", why=why, enough="land")

    def _program(self, m: FleetState) -> Iterator[Violation]:
        limit = self._rules.figure["program.silent_s"]
        for row in _rows(m.offboard & (m.silent_s > limit)):
            why = f"no heartbeat of its program for {m.silent_s[row]:.1f} s in OFFBOARD (at most {limit:g} s)"
            yield Violation(row=row, rule="program", why=why)

    def _lasting(self, m: FleetState, rule: str, now_so: Mask) -> list[int]:
        """Return the rows of the flying vehicles that have violated a rule for the whole of its time `for_s`.

        now_so: mask of the vehicles that violate the rule now.
        """
        since = self._since[rule]
        so = now_so & m.flying
        since[:] = np.where(so, np.minimum(since, m.now), np.inf)
        return _rows(so & (m.now - since >= self._rules.figure[f"{rule}.for_s"]))


def _rows(mask: Mask) -> list[int]:
    """Return the rows at which a mask is true."""
    rows: list[int] = mask.nonzero()[0].tolist()
    return rows


def _fence_text(left: float, way: float, reserve: float, speed: float, side: str) -> str:
    if left < 0.0:
        return (
            f"it is {-left:.2f} m past the {side} side of the fence"
            if side != "ceiling"
            else f"it is {-left:.2f} m above the top of the fence"
        )
    limit = "top" if side == "ceiling" else f"{side} side"
    return (
        f"to stop from {speed:.1f} m/s it needs {way:.2f} m and {reserve:g} m in reserve, "
        f"and the {limit} of the fence is {left:.2f} m away"
    )
