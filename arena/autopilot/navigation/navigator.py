"""Flight of one vehicle along a mission (AUTO.MISSION), back home (AUTO.RTL) or to a reposition target.

Splits each mission item into legs and writes the setpoints. Pure.

The rules are PX4 v1.16's for a multirotor: climb before the first item if it is higher, acceptance radii,
required heading, hold times, jumps, landing from above the landing point, return height within a cone around
home.
"""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot import events
from arena.autopilot.commander import CRITICAL, INFO
from arena.autopilot.control.setpoints import Setpoints
from arena.autopilot.flight_modes import Mode
from arena.autopilot.navigation.legs import Leg, LegFollower, Point, Situation
from arena.autopilot.navigation.mission_feasibility import moves
from arena.autopilot.navigation.mission_items import MISSION, RALLY, Item, position_of
from arena.autopilot.navigation.mission_store import MissionStore
from arena.autopilot.navigation.orbit import Orbit
from arena.autopilot.param_table import Params

_RALLY_MARGIN_M = 2.0  # a rally point must be nearer than home by this
_MAX_JUMPS = 64


class Navigator:
    """Flies one vehicle along its mission, back home, or to a reposition target.

    row: row of the vehicle in the arrays over all vehicles
    mode: MISSION, RTL, or HOLD for a reposition target; None while the navigator does not fly the vehicle
    running: True while the vehicle flies a mission that is not finished
    requested_mode: flight mode that the mission requests, None if it requests none
    """

    def __init__(self, row: int, params: Params, missions: MissionStore) -> None:
        self.row, self.params, self.missions = row, params, missions
        self.mode: Mode | None = None
        self.running = False
        self.requested_mode: Mode | None = None
        self._follower = LegFollower(row, params)
        self._seen_changes = -1
        self._climb_d = math.nan
        self._jumps: dict[int, int] = {}
        self._activated = False
        self._disarmed = False
        self._destination: Point = (0.0, 0.0, 0.0)

    @property
    def target_n(self) -> Point:
        """Target position of the current leg [m] [NED]."""
        return self._follower.leg.to

    # -- interface -------------------------------------------------------------------------------------------

    def enter(self, mode: Mode, s: Situation) -> None:
        """Begin MISSION or RTL at the vehicle's present position."""
        self.mode, self.requested_mode = mode, None
        self._follower.begin(s)
        if mode is Mode.RTL:
            self._begin_return(s)
        else:
            self._begin_mission(s)

    def reposition(self, to: Point, yaw: float, s: Situation) -> None:
        """Fly to a point and hold there (DO_REPOSITION).

        to: target position [m] [NED]
        yaw: heading [rad], NaN points the nose along the path
        """
        if self.mode is not Mode.HOLD:
            self.mode, self.requested_mode = Mode.HOLD, None
            self._follower.begin(s)
        self._follower.set_leg(Leg(kind="stay", to=to, yaw=yaw))

    def fly_orbit(self, orbit: Orbit, s: Situation) -> None:
        """Fly on a circle until the vehicle gets another target (MAV_CMD_DO_ORBIT)."""
        if self.mode is not Mode.HOLD:
            self.mode, self.requested_mode = Mode.HOLD, None
            self._follower.begin(s)
        if self.orbit is not orbit:
            self._follower.set_leg(Leg(kind="orbit", to=orbit.centre, orbit=orbit))

    @property
    def orbit(self) -> Orbit | None:
        """Circle on which the vehicle flies; None if it does not fly on a circle."""
        return self._follower.leg.orbit if self.mode is Mode.HOLD else None

    def change_speed(self, speed: float) -> None:
        """Set the cruise speed [m/s]. NaN selects MPC_XY_CRUISE."""
        self._follower.cruise = speed

    def leave(self, *, armed: bool) -> None:
        """End the automatic flight of the vehicle, such as its mission, its return flight (RTL) or an orbit.

        armed: False if the vehicle is disarmed. The cruise speed is then reset, and a mission that has reached its last
            item begins again at the first item
        """
        if self.mode is Mode.MISSION:
            self.missions.set_progress(reached=-1)
        self.mode, self.running = None, False
        if not armed:
            self._disarmed, self._follower.cruise = True, math.nan

    def fly(self, sp: Setpoints, s: Situation, dt: float) -> None:
        """Compute and store the setpoint of this step; begin the next leg if the current leg is complete.

        dt: time step [s]
        """
        if self.mode is Mode.MISSION and self.missions.current_changes != self._seen_changes:
            self._start_current_item(s)
        if self._follower.is_complete(s):
            self._advance(s)
        self._follower.steer(sp, s, dt)

    # -- a mission -------------------------------------------------------------------------------------------

    def _begin_mission(self, s: Situation) -> None:
        m = self.missions
        if self._disarmed and self._activated and m.current + 1 == len(m.items[MISSION]):
            self._jumps.clear()
            self._follower.cruise = math.nan
            m.set_progress(current=0)
        self._activated, self._disarmed = True, False
        self._seen_changes = -1
        self._start_current_item(s)
        self._climb_d = self._first_climb(s)
        if self.running:
            self._load(s)

    def _start_current_item(self, s: Situation) -> None:
        """Check the mission again, and begin the item that a client has selected during the flight."""
        begun, self._seen_changes = self._seen_changes < 0, self.missions.current_changes
        if not (self.missions.items[MISSION] and self.missions.valid):
            rest = "refusing takeoff" if s.landed else "loitering"
            event = events.MISSION_REFUSED() if s.landed else events.MISSION_INVALID()
            s.report(CRITICAL, f"No valid mission available, {rest}", event)
            self.running = False
            self._follower.set_leg(Leg(kind="stay", to=s.p_n))
            return
        if not self.running:
            s.report(INFO, "Executing Mission", events.MISSION())
        self.running = True
        self.missions.set_progress(reached=-1)
        if not begun:
            self._load(s)

    def _first_climb(self, s: Situation) -> float:
        """Return the height [m] [NED down] to which the vehicle must climb before the mission; NaN if no climb is needed.

        This is the height of the first mission item that has a position.
        """
        first = next((x for x in self.missions.items[MISSION][self.missions.current :] if moves(x)), None)
        if first is None:
            return math.nan
        d = position_of(first, s.origin, s.home_n[2])[2]
        return d if s.p_n[2] - d > self._param("NAV_MC_ALT_RAD") else math.nan

    def _load(self, s: Situation) -> None:
        """Begin the current mission item.

        If the item is a jump, begin the item to which it jumps.
        """
        items = self.missions.items[MISSION]
        k = self._past_jumps(self.missions.current)
        if k is None or k >= len(items):
            self._finish(s)
            return
        self.missions.set_progress(current=k)
        self._follower.set_leg(self._leg_of(items[k], s, ""))

    def _past_jumps(self, k: int) -> int | None:
        items = self.missions.items[MISSION]
        for _ in range(_MAX_JUMPS):
            if k >= len(items) or items[k].command != mavlink.MAV_CMD_DO_JUMP:
                return k
            to, repeat = (int(x) if math.isfinite(x) else -1 for x in items[k].params[:2])
            if not 0 <= to < len(items):
                return None
            made = self._jumps.get(k, 0)
            if repeat < 0 or made < repeat:
                self._jumps[k] = made + 1
                k = to
            else:
                k += 1
        return None

    def _leg_of(self, item: Item, s: Situation, stage: str) -> Leg:
        """Return the next leg of a mission item. An item may need several legs, such as climb and approach.

        stage: the stage of the item that is complete, "" if none is
        """
        if not moves(item):
            return self._run_item(item, s)
        to = position_of(item, s.origin, s.home_n[2])
        if math.isfinite(self._climb_d):
            d, self._climb_d = self._climb_d, math.nan
            s.report(INFO, f"Climb to {s.home_n[2] - d:.1f} meters above home")
            within = self._param("NAV_MC_ALT_RAD")
            height = s.home_n[2] - d
            within = height / 2.0 if s.landed and 0.0 < height < within else within
            return Leg(
                kind="climb", to=(s.p_n[0], s.p_n[1], d), within_up_m=within, reports=False, then="climbed"
            )
        if item.command == mavlink.MAV_CMD_NAV_LAND:
            return self._landing_leg(to, s, stage)
        return self._leg_to(item, to, s)

    def _landing_leg(self, to: Point, s: Situation, stage: str) -> Leg:
        away = math.dist(to[:2], s.p_n[:2])
        if not s.landed and stage != "above" and away > self._param("NAV_ACC_RAD"):
            height = self._follower.leg.to[2] if self._follower.leg.kind == "go" else s.p_n[2]
            return Leg(
                kind="go", to=(to[0], to[1], height), within_m=self._param("NAV_ACC_RAD"), then="above"
            )
        return Leg(kind="land", to=to)

    def _leg_to(self, item: Item, to: Point, s: Situation) -> Leg:
        within, hold, kind = self._param("NAV_ACC_RAD"), 0.0, "go"
        yaw = math.radians(item.params[3]) - s.origin.heading
        if item.command == mavlink.MAV_CMD_NAV_WAYPOINT:
            within = item.params[1] if item.params[1] > 1e-6 else within
            hold = item.params[0] if item.params[0] > 0 else 0.0
        elif item.command == mavlink.MAV_CMD_NAV_LOITER_TIME:
            hold, yaw = max(item.params[0], 0.0), math.nan
        elif item.command == mavlink.MAV_CMD_NAV_LOITER_UNLIM:
            kind = "stay"
        else:
            yaw = math.nan
        return Leg(
            kind=kind, to=to, yaw=yaw, within_m=within, within_up_m=self._param("NAV_MC_ALT_RAD"), hold_s=hold
        )

    def _run_item(self, item: Item, s: Situation) -> Leg:
        """Carry out a mission item that has no position, such as a change of speed or a delay.

        An unsupported command has no effect.
        """
        command, p = item.command, item.params
        if command == mavlink.MAV_CMD_DO_CHANGE_SPEED:
            self._follower.cruise = p[1] if math.isfinite(p[1]) and p[1] > 0 else math.nan
        elif command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            self.requested_mode = Mode.RTL
            return Leg(kind="stay", to=self._here(s))
        elif command == mavlink.MAV_CMD_NAV_DELAY:
            hold = p[0] if math.isfinite(p[0]) and p[0] > 0 else 0.0
            return Leg(kind="wait", to=self._here(s), yaw=self._follower.trajectory.yaw, hold_s=hold)
        return Leg(kind="instant", to=self._here(s), yaw=self._follower.trajectory.yaw)

    def _here(self, s: Situation) -> Point:
        return self._follower.leg.to if self._follower.leg.kind == "go" else s.p_n

    def _advance(self, s: Situation) -> None:
        if self.mode is Mode.RTL:
            self._advance_return(s)
            return
        items, m = self.missions.items[MISSION], self.missions
        if self._follower.leg.reports:
            m.set_progress(reached=m.current)
        if self._follower.leg.then and m.current < len(items):
            self._follower.set_leg(self._leg_of(items[m.current], s, self._follower.leg.then))
        elif m.current < len(items) and items[m.current].autocontinue:
            after = self._past_jumps(m.current + 1)
            if after is None or after >= len(items):
                self._finish(s)
            else:
                m.set_progress(current=after)
                self._follower.set_leg(self._leg_of(items[after], s, ""))
        else:
            self._follower.set_leg(Leg(kind="stay", to=self._follower.leg.to, yaw=self._follower.leg.yaw))

    def _finish(self, s: Situation) -> None:
        event = events.MISSION_LANDED() if s.landed else events.MISSION_LOITERS()
        s.report(INFO, f"Mission finished, {'landed' if s.landed else 'loitering'}", event)
        self.running = False
        self._jumps.clear()
        self._follower.set_leg(Leg(kind="stay", to=s.p_n, yaw=self._follower.trajectory.yaw))

    # -- return to launch ------------------------------------------------------------------------------------

    def _begin_return(self, s: Situation) -> None:
        self._follower.cruise = math.nan
        self._destination = self._return_destination(s)
        if s.landed:
            self._follower.set_leg(Leg(kind="stay", to=s.p_n))
            return
        d = self._return_d(s)
        above = self._destination[2] - d
        s.report(
            INFO,
            f"RTL: start return at {math.ceil(s.origin.alt - d)} m ({math.ceil(above)} m above destination)",
        )
        if s.p_n[2] > d:
            self._follower.set_leg(Leg(kind="climb", to=(s.p_n[0], s.p_n[1], d), yaw=s.yaw, then="climbed"))
        else:
            self._move_home(d, s)

    def _return_destination(self, s: Situation) -> Point:
        """Return the target of the return flight [m] [NED]: home or a rally point.

        A rally point is used if it is nearer by more than _RALLY_MARGIN_M.
        """
        best, least = s.home_n, math.dist(s.home_n[:2], s.p_n[:2])
        for item in self.missions.items[RALLY]:
            point = position_of(item, s.origin, s.home_n[2])
            if math.dist(point[:2], s.p_n[:2]) + _RALLY_MARGIN_M < least:
                best, least = point, math.dist(point[:2], s.p_n[:2])
        return best

    def _return_d(self, s: Situation) -> float:
        """Return the down coordinate [m] [NED] of the return flight (RTL).

        RTL_CONE_ANG and RTL_RETURN_ALT determine it. It is never below the present height.
        """
        away = math.dist(self._destination[:2], s.p_n[:2])
        most, now = self._param("RTL_RETURN_ALT"), self._destination[2] - s.p_n[2]
        cone, within = self._param("RTL_CONE_ANG"), self._param("NAV_ACC_RAD")
        height = most
        if cone > 0 and away <= within:
            height = 2.0 * away
        elif cone > 0:
            if away <= self._param("RTL_MIN_DIST"):
                height = min(away / math.tan(math.radians(min(max(cone, 1.0), 89.0))), most)
            height = max(height, 2.0 * within)
        height = max(min(height, most), now) if cone > 0 else max(now, most)
        return self._destination[2] - height

    def _move_home(self, d: float, s: Situation) -> None:
        near = math.dist(self._destination[:2], s.p_n[:2]) < self._param("RTL_MIN_DIST")
        yaw = s.home_yaw if near else math.nan
        to = (self._destination[0], self._destination[1], d)
        self._follower.set_leg(
            Leg(kind="go", to=to, yaw=yaw, within_m=self._param("NAV_ACC_RAD"), then="above")
        )

    def _advance_return(self, s: Situation) -> None:
        delay, done = self._param("RTL_LAND_DELAY"), self._follower.leg.then
        low_d = max(self._follower.leg.to[2], self._destination[2] - self._param("RTL_DESCEND_ALT"))
        above = (self._destination[0], self._destination[1], low_d)
        if done == "climbed":
            self._move_home(self._follower.leg.to[2], s)
        elif done == "above" and abs(delay) > 1e-6:
            self._follower.set_leg(
                Leg(kind="go", to=above, yaw=s.home_yaw, then="low", hold_s=max(delay, 0.0))
            )
        elif done == "low" and delay < 0:
            s.report(INFO, "RTL: completed, loitering", events.RETURNED())
            self._follower.set_leg(Leg(kind="stay", to=above, yaw=s.home_yaw))
        elif self._follower.leg.kind == "land":
            self._follower.set_leg(Leg(kind="stay", to=s.p_n))
        else:
            s.report(INFO, "RTL: land at destination", events.RETURN_LANDS())
            self._follower.set_leg(Leg(kind="land", to=self._destination, yaw=s.home_yaw))

    def _param(self, name: str) -> float:
        return float(self.params[name][self.row])
