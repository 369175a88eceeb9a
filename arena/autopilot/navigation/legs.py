"""Flight along one leg: computes the setpoint of each step and checks if the leg is complete. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

from arena.autopilot.control.flight_tasks import landing_speed
from arena.autopilot.control.setpoints import Setpoints
from arena.autopilot.control.trajectory import Trajectory, TrajectoryLimits, wrap_angle
from arena.autopilot.events import Event
from arena.autopilot.navigation.mission_items import Origin
from arena.autopilot.navigation.orbit import Orbit
from arena.autopilot.param_table import Params

Point = tuple[float, float, float]


class Report(Protocol):
    """Function that reports to the user: a text (STATUSTEXT), and optionally a MAVLink event with the same content."""

    def __call__(self, severity: int, text: str, event: Event | None = None) -> None: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """State of the vehicle at one step, as the navigator uses it.

    now: time since boot [s]
    p_n, v_n, yaw: estimated position [m] [NED], velocity [m/s] [NED] and heading [rad]
    landed: True if the vehicle is on the ground
    flying: True if the take-off is complete
    origin: place and direction of the local frame on Earth
    home_n, home_yaw: home position [m] [NED] and heading [rad]
    report: function that sends a text to the user, called with MAV_SEVERITY, text and the event with the same content
    """

    now: float
    p_n: Point
    v_n: Point
    yaw: float
    landed: bool
    flying: bool
    origin: Origin
    home_n: Point
    home_yaw: float
    report: Report


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """Leg of a flight: a movement to a target position, or a wait in place.

    kind: climb, go, land, stay (until another leg is set), orbit (until another leg is set), wait (for hold_s) or instant
        (complete at once)
    to: target position [m] [NED]
    yaw: heading [rad]; NaN points the nose along the path
    within_m, within_up_m: acceptance radius, horizontal and vertical [m]
    hold_s: time to stay at the target [s]
    reports: whether the end of this leg reports that the mission item is reached
    then: next stage of the same mission item, "" if the next item follows
    orbit: circle of a leg of kind orbit
    """

    kind: str
    to: Point = (0.0, 0.0, 0.0)
    yaw: float = math.nan
    within_m: float = 2.0
    within_up_m: float = 0.8
    hold_s: float = 0.0
    reports: bool = True
    then: str = ""
    orbit: Orbit | None = None


@dataclass(slots=True)
class LegFollower:
    """Flies one vehicle along its current leg.

    row: row of the vehicle in the arrays over all vehicles
    cruise: cruise speed [m/s], NaN for MPC_XY_CRUISE
    """

    row: int
    params: Params
    trajectory: Trajectory = field(default_factory=Trajectory)
    leg: Leg = field(default_factory=lambda: Leg(kind="stay"))
    cruise: float = math.nan
    _arrived_at: float = math.nan
    _heading_met: bool = False
    _circling: bool = False
    _circle_speed: float = 0.0

    def begin(self, s: Situation) -> None:
        """Start the trajectory at the vehicle's present position, velocity and heading."""
        self.trajectory.begin(s.p_n, s.v_n, s.yaw)

    def set_leg(self, leg: Leg) -> None:
        """Replace the current leg."""
        self.leg, self._arrived_at, self._heading_met = leg, math.nan, False
        self._circling = self._circling and leg.kind == "orbit"

    def is_complete(self, s: Situation) -> bool:
        """Return whether position and heading of the leg are reached and its hold time has passed."""
        leg = self.leg
        if leg.kind in ("stay", "instant", "orbit"):
            return leg.kind == "instant"
        if leg.kind == "land":
            return s.landed
        if math.isnan(self._arrived_at) and self._arrived(s):
            self._arrived_at = s.now
        if math.isnan(self._arrived_at):
            return False
        self._heading_met |= not math.isfinite(leg.yaw) or abs(wrap_angle(leg.yaw - s.yaw)) < math.radians(
            self._param("MIS_YAW_ERR")
        )
        self._heading_met |= self._param("MIS_YAW_TMT") >= 0 or leg.kind != "go"
        return self._heading_met and s.now - self._arrived_at >= leg.hold_s

    def _arrived(self, s: Situation) -> bool:
        leg = self.leg
        if leg.kind == "wait":
            return True
        if s.landed:
            return False
        if leg.kind == "climb":
            return s.p_n[2] < leg.to[2] + leg.within_up_m
        return (
            math.dist(leg.to[:2], s.p_n[:2]) <= leg.within_m and abs(leg.to[2] - s.p_n[2]) <= leg.within_up_m
        )

    def steer(self, sp: Setpoints, s: Situation, dt: float) -> None:
        """Compute the setpoint for the current leg, and store it in `sp`.

        dt: time since the last call [s]
        """
        leg, trajectory, limits = self.leg, self.trajectory, self._limits()
        if leg.kind == "stay" and not s.flying:
            # Keep descending on the ground: the land detector needs it to stay landed.
            sp.set_position(self.row, v_n=(0.0, 0.0, self._param("MPC_LAND_SPEED")), yaw=trajectory.yaw)
            return
        if leg.orbit is not None:
            self._fly_circle(leg.orbit, sp, s, dt)
            return
        trajectory.turn(self._heading(s), limits, dt)
        if leg.kind == "land":
            speed = landing_speed(s.home_n[2] - s.p_n[2], self.params, self.row)
            v = (0.0, 0.0, speed)
            sp.set_position(self.row, p_n=(leg.to[0], leg.to[1], math.nan), v_n=v, yaw=trajectory.yaw)
        elif leg.kind == "climb" and not s.flying:
            self._lift_off(sp, s)
        else:
            self._fly_to(leg.to, sp, s, dt)

    def _fly_to(self, to: Point, sp: Setpoints, s: Situation, dt: float) -> None:
        trajectory = self.trajectory
        trajectory.advance(to, s.p_n, self._limits(), dt)
        sp.set_position(
            self.row,
            p_n=tuple(trajectory.p_n),
            v_n=tuple(trajectory.v_n),
            a_n=tuple(trajectory.a_n),
            yaw=trajectory.yaw,
        )

    def _fly_circle(self, orbit: Orbit, sp: Setpoints, s: Situation, dt: float) -> None:
        """Compute and store the setpoint that leads the vehicle to a circle and then along it.

        The speed along the circle begins at 0.
        """
        limits = self._limits()
        if not self._circling and orbit.is_reached(s.p_n, self._param("NAV_MC_ALT_RAD")):
            self._circling, self._circle_speed = True, 0.0
        if not self._circling:
            self.trajectory.turn(
                math.atan2(orbit.centre[1] - s.p_n[1], orbit.centre[0] - s.p_n[0]), limits, dt
            )
            self._fly_to(orbit.nearest(s.p_n), sp, s, dt)
            return
        most = limits.accel * dt
        self._circle_speed += min(max(orbit.velocity - self._circle_speed, -most), most)
        target = orbit.setpoint(s.p_n, self._circle_speed)
        self.trajectory.turn(target.yaw, limits, dt)
        sp.set_position(self.row, p_n=target.p_n, v_n=target.v_n, a_n=target.a_n, yaw=self.trajectory.yaw)

    def _lift_off(self, sp: Setpoints, s: Situation) -> None:
        """Compute and store a setpoint with a climb rate, until the take-off is complete."""
        left = s.p_n[2] - self.leg.to[2]
        v = (0.0, 0.0, -min(self._param("MPC_TKO_SPEED"), max(left, 0.0) + 0.15))
        self.trajectory.begin(
            (self.trajectory.p_n[0], self.trajectory.p_n[1], s.p_n[2]),
            (0.0, 0.0, s.v_n[2]),
            self.trajectory.yaw,
        )
        sp.set_position(
            self.row,
            p_n=(self.trajectory.p_n[0], self.trajectory.p_n[1], math.nan),
            v_n=v,
            yaw=self.trajectory.yaw,
        )

    def _heading(self, s: Situation) -> float:
        """Return the heading setpoint [rad] of the current leg.

        It is the heading of the leg if the leg has one, else the direction to a distant target.

        NaN keeps the present heading.
        """
        leg = self.leg
        if math.isfinite(leg.yaw) or leg.kind in ("climb", "stay", "wait", "land"):
            return leg.yaw
        away = (leg.to[0] - s.p_n[0], leg.to[1] - s.p_n[1])
        return math.atan2(away[1], away[0]) if math.hypot(*away) > leg.within_m else math.nan

    def _limits(self) -> TrajectoryLimits:
        p = self._param
        fastest = p("MPC_XY_VEL_MAX")
        cruise = min(self.cruise if math.isfinite(self.cruise) else p("MPC_XY_CRUISE"), fastest)
        turn, jerk = math.radians(p("MPC_YAWRAUTO_MAX")), max(p("MPC_JERK_AUTO"), 0.5)
        return TrajectoryLimits(
            cruise=cruise,
            up=p("MPC_Z_V_AUTO_UP"),
            down=p("MPC_Z_V_AUTO_DN"),
            accel=p("MPC_ACC_HOR"),
            yaw_rate=turn,
            jerk=jerk,
            accel_up=p("MPC_ACC_UP_MAX"),
            accel_down=p("MPC_ACC_DOWN_MAX"),
            lead_m=p("MPC_XY_ERR_MAX"),
        )

    def _param(self, name: str) -> float:
        return float(self.params[name][self.row])
