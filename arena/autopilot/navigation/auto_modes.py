"""Flight of all vehicles in AUTO.MISSION, in AUTO.RTL and to reposition targets (DO_REPOSITION).

Checks missions and geofences, and runs a `Navigator` for each vehicle that flies a mission, a return or to a
reposition target. All other vehicles cost almost no computing time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from arena.autopilot import events
from arena.autopilot.commander import CRITICAL
from arena.autopilot.commander_inputs import CommanderInputs
from arena.autopilot.control.setpoints import Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.flight_modes import Mode
from arena.autopilot.navigation import mission_feasibility
from arena.autopilot.navigation.geofence import Fence, read_areas, usable_areas
from arena.autopilot.navigation.legs import Situation
from arena.autopilot.navigation.mission_items import FENCE, MISSION, Origin, local
from arena.autopilot.navigation.navigator import Navigator
from arena.autopilot.param_table import Params
from arena.autopilot.vehicle import Point, Vehicle

_MODES = (Mode.MISSION, Mode.RTL)


@dataclass(slots=True)
class _Checked:
    """Result of the newest check of a vehicle's mission and geofence, and the values that it depends on.

    key: the values that the check depends on; when they change, mission and geofence are checked again
    fence_id: identifier of the uploaded geofence that `fence.areas` was read from
    """

    key: object = None
    fence: Fence = field(default_factory=Fence)
    fence_id: int = 0


class AutoModes:
    """Flies the vehicles that are in AUTO.MISSION, in AUTO.RTL or on the way to a reposition target.

    dt: time between two calls of `fly` [s]
    """

    def __init__(self, params: Params, est: Estimator, vehicles: int, dt: float) -> None:
        self.params, self.est, self.dt = params, est, dt
        self._checked = [_Checked() for _ in range(vehicles)]
        self._navigators: dict[int, Navigator] = {}

    def check(self, v: Vehicle, s: CommanderInputs) -> None:
        """Check a vehicle's origin, home, mission and geofence. Write the results to the commander's inputs `s`."""
        s.global_ok = v.origin is not None and s.xy_valid and s.z_valid
        s.home_ok = v.origin is not None and v.home_n is not None
        checked = self._checked[v.row]
        key = (v.missions.version, v.origin, v.home_n, self.params.version)
        if key != checked.key:
            self._check_lists(v, s, checked, v.home_n)
            checked.key = key
        s.mission_ok = v.missions.valid
        s.has_fence = checked.fence.home_n is not None or bool(checked.fence.areas)
        s.fence = checked.fence.breach(self.est.p_n[v.row].tolist()) if s.has_fence and s.xy_valid else ""

    def is_flying(self, v: Vehicle) -> bool:
        """Return whether `AutoModes` flies the vehicle in its present mode.

        These modes are MISSION, RTL, and HOLD with a reposition target or an orbit.
        """
        mode = v.commander.mode
        if v.commander.failsafe:
            v.orbit = None
        return mode in _MODES or (mode is Mode.HOLD and (v.orbit is not None or self._is_repositioned(v)))

    def fly(self, v: Vehicle, s: CommanderInputs, sp: Setpoints) -> Mode | None:
        """Compute and store the vehicle's setpoint. Return the flight mode to change to; None to keep the mode.

        A vehicle without origin or home position changes to HOLD."""
        if v.origin is None or v.home_n is None:
            return Mode.HOLD
        n = self._navigator(v)
        situation = self._situation(v, s, v.origin, v.home_n)
        if v.commander.mode is Mode.HOLD:
            self._start_reposition(v, n, situation)
            if v.orbit is not None:
                n.fly_orbit(v.orbit, situation)
        elif n.mode is not v.commander.mode:
            n.enter(v.commander.mode, situation)
        v.reposition_target = None
        if not math.isnan(v.requested_speed):
            n.change_speed(v.requested_speed if v.requested_speed > 0 else math.nan)
            v.requested_speed = math.nan
        n.fly(sp, situation, self.dt)
        v.leg_target_n = n.target_n
        return n.requested_mode

    def is_inside_fence(self, v: Vehicle, points: list[Point]) -> bool:
        """Return whether all points [m] [NED] are inside the vehicle's geofence."""
        fence = self._checked[v.row].fence
        return not any(fence.breach(point) for point in points)

    def leave(self, v: Vehicle, *, armed: bool) -> None:
        """End the automatic flight of the vehicle, such as its mission, its return flight (RTL) or an orbit.

        Call this for every vehicle that is disarmed, or for which `is_flying` is false.
        """
        n = self._navigators.get(v.row)
        if n is not None:
            n.leave(armed=armed)
        v.reposition_target = v.leg_target_n = v.orbit = None

    def _is_repositioned(self, v: Vehicle) -> bool:
        n = self._navigators.get(v.row)
        return v.reposition_target is not None or (n is not None and n.mode is Mode.HOLD and n.orbit is None)

    def _start_reposition(self, v: Vehicle, n: Navigator, s: Situation) -> None:
        target = v.reposition_target
        if target is None:
            return
        given = math.isfinite(target.lat) and math.isfinite(target.lon)
        to = local(s.origin, target.lat, target.lon) if given else s.p_n[:2]
        d = s.origin.alt - target.alt if math.isfinite(target.alt) else s.p_n[2]
        if self._checked[v.row].fence.breach((to[0], to[1], d)):
            s.report(CRITICAL, "Reposition is outside geofence", events.OUTSIDE_FENCE())
            to, d = s.p_n[:2], s.p_n[2]
        n.reposition((to[0], to[1], d), target.yaw - s.origin.heading, s)

    def _navigator(self, v: Vehicle) -> Navigator:
        if v.row not in self._navigators:
            self._navigators[v.row] = Navigator(v.row, self.params, v.missions)
        return self._navigators[v.row]

    def _situation(self, v: Vehicle, s: CommanderInputs, origin: Origin, home: Point) -> Situation:
        p, velocity = self.est.p_n[v.row].tolist(), self.est.v_n[v.row].tolist()
        return Situation(
            now=s.now,
            p_n=(p[0], p[1], p[2]),
            v_n=(velocity[0], velocity[1], velocity[2]),
            yaw=v.yaw(),
            landed=s.landed,
            flying=s.flying,
            origin=origin,
            home_n=home,
            home_yaw=v.home_yaw,
            report=v.commander.report,
        )

    def _check_lists(self, v: Vehicle, s: CommanderInputs, checked: _Checked, home: Point | None) -> None:
        """Check geofence and mission again after an upload, or after a change of origin, home or a parameter."""
        store, p, i = v.missions, self.params, v.row
        horizontal, vertical = float(p["GF_MAX_HOR_DIST"][i]), float(p["GF_MAX_VER_DIST"][i])
        kept = checked.fence.areas
        if store.ids[FENCE] != checked.fence_id and v.origin is not None and home is not None:
            in_flight = v.commander.armed and not s.landed and p["GF_ACTION"][i] > 0
            here = self.est.p_n[i].tolist()[:2] if in_flight else None
            kept, reasons = usable_areas(read_areas(store.items[FENCE], v.origin), home[:2], here)
            checked.fence_id = store.ids[FENCE]
            for reason in reasons:
                v.commander.report(CRITICAL, reason)
        checked.fence = Fence(
            areas=kept,
            home_n=home if horizontal > 0 or vertical > 0 else None,
            max_horizontal_m=horizontal,
            max_vertical_m=vertical,
        )
        store.valid = False
        if store.items[MISSION] and v.origin is not None and home is not None:
            reason = mission_feasibility.why_infeasible(
                store.items[MISSION],
                v.origin,
                home,
                checked.fence,
                landed=s.landed,
                max_first_distance_m=float(p["MIS_DIST_1WP"][i]),
                required_items=int(p["MIS_TKO_LAND_REQ"][i]),
            )
            store.valid = not reason
            if reason and (checked.key is None or store.ids[MISSION] != 0):
                v.commander.report(CRITICAL, reason)
