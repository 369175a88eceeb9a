"""History of a flight for the referee: takeoffs, touchdowns, crashes, and positions at the last action."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

from arena.smoke.language.model import Box, Observation, VehicleState
from arena.smoke.referee.verdict import Touchdown

_BOUNCE_S = 0.5  # a shorter time in the air is not a new flight
_ROW_PERIOD_S = 0.1
_MIN_TIMED_S = 1.0


@dataclass(kw_only=True)
class _VehicleHistory:
    """Takeoff, landing and touchdown of one vehicle, and its position at the last action.

    flown: true after the first take-off.
    in_flight: true from the first take-off until the observation in which the vehicle has landed, that one included.
    landed: true if the vehicle has flown, is on the floor and disarmed.
    aloft_s: simulation time of the last take-off [s].
    speed_m_s: speed at the last observation in the air [m/s].
    action_p_n: position at the last action [m] [NED].
    """

    flown: bool = False
    airborne: bool = False
    in_flight: bool = False
    landed: bool = False
    aloft_s: float = 0.0
    speed_m_s: float = 0.0
    action_p_n: tuple[float, float, float] | None = None
    touchdown: Touchdown | None = None


@dataclass(kw_only=True)
class FlightHistory:
    """History of a flight, updated with every observation.

    vehicles: names.  fence: volume that the vehicles must not leave.
    now: newest observation.  ended: the arena ended by itself.
    action_s: simulation time of the last action [s].  crashes: vehicle -> crash report.
    """

    vehicles: tuple[str, ...]
    fence: Box
    now: Observation = field(default_factory=lambda: Observation(time_s=0.0, vehicles={}))
    ended: bool = False
    action_s: float | None = None
    crashes: dict[str, str] = field(default_factory=dict)
    _histories: dict[str, _VehicleHistory] = field(default_factory=dict)
    _timed: list[tuple[float, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._histories = {name: _VehicleHistory() for name in self.vehicles}

    def update(self, now: Observation) -> None:
        """Update the history of the flight with a new observation."""
        self.now = now
        for name in self.vehicles:
            if (vehicle := now.vehicles.get(name)) is not None:
                self._update(self._histories[name], vehicle)
        if now.wall_s is not None and self.in_flight:
            self._timed[1:] = [(now.time_s, now.wall_s)]

    def action(self) -> None:
        """Record the time of an action, and the positions from which `drift_m` is measured.

        The positions are those of the vehicles in the newest observation.
        """
        self.action_s = self.now.time_s
        for name, history in self._histories.items():
            if name in self.now.vehicles:
                history.action_p_n = self.now.vehicles[name].p_n

    def _update(self, history: _VehicleHistory, vehicle: VehicleState) -> None:
        history.in_flight = (history.in_flight and not history.landed) or vehicle.airborne
        if vehicle.airborne and not history.airborne:
            history.aloft_s = self.now.time_s
        elif history.airborne and not vehicle.airborne:
            self._touch_down(history, vehicle)
        history.flown = history.flown or vehicle.airborne
        history.airborne = vehicle.airborne
        history.landed = history.flown and vehicle.down
        if vehicle.airborne:
            history.speed_m_s = math.hypot(*vehicle.v_n)
        if vehicle.crashed:
            self.crashes.setdefault(vehicle.name, vehicle.crashed)

    def _touch_down(self, history: _VehicleHistory, vehicle: VehicleState) -> None:
        if history.touchdown is not None and self.now.time_s - history.aloft_s < _BOUNCE_S:
            return
        history.touchdown = Touchdown(
            vehicle=vehicle.name,
            at_s=self.now.time_s,
            after_s=None if self.action_s is None else self.now.time_s - self.action_s,
            speed_m_s=history.speed_m_s,
            drift_m=self.drift_m(vehicle.name),
        )

    # -- queries

    @property
    def real_time_factor(self) -> float | None:
        """Simulated seconds per second of wall time since the first takeoff. None in the first second."""
        if not self._timed:
            return None
        (sim_0, wall_0), (sim_1, wall_1) = self._timed[0], self._timed[-1]
        return (
            (sim_1 - sim_0) / (wall_1 - wall_0) if sim_1 - sim_0 >= _MIN_TIMED_S and wall_1 > wall_0 else None
        )

    @property
    def in_flight(self) -> tuple[str, ...]:
        """Names of the vehicles in flight: from the first takeoff until the landing."""
        return tuple(name for name, history in self._histories.items() if history.in_flight)

    @property
    def still_up(self) -> tuple[str, ...]:
        """Names of the vehicles that must still land: they have taken off, but not landed.

        A crashed vehicle on the floor counts as landed.
        """
        return tuple(
            name
            for name, history in self._histories.items()
            if history.flown and not history.landed and (history.airborne or name not in self.crashes)
        )

    @property
    def touchdowns(self) -> tuple[Touchdown, ...]:
        """The last touchdown of each vehicle that has touched down."""
        return tuple(m.touchdown for m in self._histories.values() if m.touchdown is not None)

    def flown(self, name: str) -> bool:
        """Return whether the vehicle has taken off at least once."""
        return self._histories[name].flown

    def touchdown_m_s(self, name: str) -> float | None:
        """Return the speed at the last touchdown [m/s]. Return None in the air and before a touchdown."""
        history = self._histories[name]
        return None if history.touchdown is None or history.airborne else history.touchdown.speed_m_s

    def drift_m(self, name: str) -> float | None:
        """Return a vehicle's horizontal distance from its position at the last action [m], or None before any action."""
        start, vehicle = self._histories[name].action_p_n, self.now.vehicles.get(name)
        return None if start is None or vehicle is None else math.dist(start[:2], vehicle.p_n[:2])

    def separations(self) -> dict[tuple[str, str], float]:
        """Return pair of vehicles -> distance [m], for all pairs with at least one vehicle in flight."""
        here = [v for v in self.vehicles if v in self.now.vehicles]
        flying = set(self.in_flight)
        return {
            (a, b): math.dist(self.now.vehicles[a].p_n, self.now.vehicles[b].p_n)
            for a, b in itertools.combinations(here, 2)
            if a in flying or b in flying
        }
