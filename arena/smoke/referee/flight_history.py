"""What a referee remembers of a flight: who has flown, who is in flight, how each came down, where each was at the last deed."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

from arena.smoke.language.model import Box, Now, VehicleNow
from arena.smoke.referee.verdict import Row, Touchdown

_BOUNCE_S = 0.5  # in the air for less than this is not a further flight
_ROW_S = 0.1


@dataclass(kw_only=True)
class _Memory:
    """Of one vehicle. in_flight: since its take-off, until it has landed, that look included. aloft_s: when it left the floor."""

    flown: bool = False
    airborne: bool = False
    in_flight: bool = False
    landed: bool = False
    aloft_s: float = 0.0
    speed_m_s: float = 0.0
    deed_p_n: tuple[float, float, float] | None = None
    touchdown: Touchdown | None = None


@dataclass(kw_only=True)
class Flight:
    """Fed with every look. fence: where vehicles may be."""

    vehicles: tuple[str, ...]
    fence: Box
    now: Now = field(default_factory=lambda: Now(time_s=0.0, vehicles={}))
    ended: bool = False
    deed_s: float | None = None
    rows: list[Row] = field(default_factory=list)
    crashes: dict[str, str] = field(default_factory=dict)
    _of: dict[str, _Memory] = field(default_factory=dict)
    _row_s: float = -math.inf

    def __post_init__(self) -> None:
        self._of = {name: _Memory() for name in self.vehicles}

    def see(self, now: Now) -> None:
        self.now = now
        for name in self.vehicles:
            if (vehicle := now.vehicles.get(name)) is not None:
                self._see(self._of[name], vehicle)
        if now.time_s >= self._row_s + _ROW_S - 1e-6:
            self._row_s = now.time_s
            self.rows.extend(self._rows())

    def deed(self) -> None:
        """Something is done to the arena now."""
        self.deed_s = self.now.time_s
        for name, memory in self._of.items():
            if name in self.now.vehicles:
                memory.deed_p_n = self.now.vehicles[name].p_n

    def _see(self, memory: _Memory, vehicle: VehicleNow) -> None:
        memory.in_flight = (memory.in_flight and not memory.landed) or vehicle.airborne
        if vehicle.airborne and not memory.airborne:
            memory.aloft_s = self.now.time_s
        elif memory.airborne and not vehicle.airborne:
            self._touches(memory, vehicle)
        memory.flown = memory.flown or vehicle.airborne
        memory.airborne = vehicle.airborne
        memory.landed = memory.flown and vehicle.down
        if vehicle.airborne:
            memory.speed_m_s = math.hypot(*vehicle.v_n)
        if vehicle.crashed:
            self.crashes.setdefault(vehicle.name, vehicle.crashed)

    def _touches(self, memory: _Memory, vehicle: VehicleNow) -> None:
        if memory.touchdown is not None and self.now.time_s - memory.aloft_s < _BOUNCE_S:
            return
        memory.touchdown = Touchdown(
            vehicle=vehicle.name,
            at_s=self.now.time_s,
            after_s=None if self.deed_s is None else self.now.time_s - self.deed_s,
            speed_m_s=memory.speed_m_s,
            drift_m=self.drift_m(vehicle.name),
        )

    # -- what is known

    @property
    def in_flight(self) -> tuple[str, ...]:
        return tuple(name for name, memory in self._of.items() if memory.in_flight)

    @property
    def still_up(self) -> tuple[str, ...]:
        """Those that have flown and are not down; one that has crashed and lies there is."""
        return tuple(
            name
            for name, memory in self._of.items()
            if memory.flown and not memory.landed and (memory.airborne or name not in self.crashes)
        )

    @property
    def touchdowns(self) -> tuple[Touchdown, ...]:
        return tuple(m.touchdown for m in self._of.values() if m.touchdown is not None)

    def flown(self, name: str) -> bool:
        return self._of[name].flown

    def touchdown_m_s(self, name: str) -> float | None:
        """None in the air, and before the first."""
        memory = self._of[name]
        return None if memory.touchdown is None or memory.airborne else memory.touchdown.speed_m_s

    def drift_m(self, name: str) -> float | None:
        start, vehicle = self._of[name].deed_p_n, self.now.vehicles.get(name)
        return None if start is None or vehicle is None else math.dist(start[:2], vehicle.p_n[:2])

    def separations(self) -> dict[tuple[str, str], float]:
        """Distance of each pair of which one is in flight at least [m]."""
        here = [v for v in self.vehicles if v in self.now.vehicles]
        flying = set(self.in_flight)
        return {
            (a, b): math.dist(self.now.vehicles[a].p_n, self.now.vehicles[b].p_n)
            for a, b in itertools.combinations(here, 2)
            if a in flying or b in flying
        }

    def _rows(self) -> list[Row]:
        apart = self.separations()
        return [
            Row(
                time_s=self.now.time_s,
                vehicle=v.name,
                p_n=v.p_n,
                height_m=v.height_m,
                speed_m_s=math.hypot(*v.v_n),
                tilt_deg=math.degrees(v.tilt_rad),
                mode=v.mode,
                nearest_m=min((d for pair, d in apart.items() if v.name in pair), default=None),
            )
            for v in self.now.vehicles.values()
        ]
