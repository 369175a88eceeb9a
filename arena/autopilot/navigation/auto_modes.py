"""Between the fleet and what each vehicle was given to fly: missions checked, fences watched, navigators fed.

State lies with the vehicles that have a mission, a fence or a return; the others cost a comparison.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from arena.autopilot.commander import CRITICAL, Mode, Sensed
from arena.autopilot.control.setpoints import Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.mavlink.mavlink_interface import Face
from arena.autopilot.navigation import mission_feasibility
from arena.autopilot.navigation.geofence import Fence, areas, usable
from arena.autopilot.navigation.mission_items import FENCE, MISSION, local
from arena.autopilot.navigation.navigator import Navigator, Situation
from arena.autopilot.param_table import Params
from arena.geometry import yaw_from_quat

_MODES = (Mode.MISSION, Mode.RTL)


@dataclass(slots=True)
class _Watch:
    """What was last checked, and what came of it."""

    key: object = None
    fence: Fence = field(default_factory=Fence)
    fence_id: int = 0


class Auto:
    """dt: between two decisions [s]."""

    def __init__(self, params: Params, est: Estimator, faces: list[Face], dt: float) -> None:
        self.params, self.est, self.dt = params, est, dt
        self._watch = [_Watch() for _ in faces]
        self._navigators: dict[int, Navigator] = {}

    def sense(self, f: Face, s: Sensed) -> None:
        """Fill in what the commander wants to know of origin, home, mission and fence."""
        s.global_ok = f.origin is not None and s.xy_valid and s.z_valid
        s.home_ok = f.origin is not None and f.home_n is not None
        w = self._watch[f.i]
        home = tuple(f.home_n) if f.home_n else None
        key = (f.missions.version, f.origin, home, self.params.version)
        if key != w.key:
            self._check(f, s, w, home if home is None else (home[0], home[1], home[2]))
            w.key = key
        s.mission_ok = f.missions.valid
        if w.fence.home_n is not None or w.fence.areas:
            s.fence = w.fence.breach(self.est.p_n[f.i].tolist()) if s.xy_valid else ""

    def flies(self, f: Face) -> bool:
        """Is the present mode flown here?"""
        return f.commander.mode in _MODES or (f.commander.mode is Mode.HOLD and self._holds_elsewhere(f))

    def fly(self, f: Face, s: Sensed, sp: Setpoints) -> Mode | None:
        """Write the setpoint; a mode that the mission asks for, or None."""
        if f.origin is None or f.home_n is None:
            return Mode.HOLD
        n = self._navigator(f)
        situation = self._situation(f, s, f.origin, f.home_n)
        if f.commander.mode is Mode.HOLD:
            self._go(f, n, situation)
        elif n.mode is not f.commander.mode:
            n.enter(f.commander.mode, situation)
        f.goto = None
        if not math.isnan(f.speed_asked):
            n.change_speed(f.speed_asked if f.speed_asked > 0 else math.nan)
            f.speed_asked = math.nan
        n.fly(sp, situation, self.dt)
        return n.asked

    def rest(self, f: Face, *, armed: bool) -> None:
        """Something else flies, or nothing does."""
        n = self._navigators.get(f.i)
        if n is not None:
            n.leave(armed=armed)
        f.goto = None

    def _holds_elsewhere(self, f: Face) -> bool:
        n = self._navigators.get(f.i)
        return f.goto is not None or (n is not None and n.mode is Mode.HOLD)

    def _go(self, f: Face, n: Navigator, s: Situation) -> None:
        if f.goto is None:
            return
        lat, lon, alt, yaw = f.goto
        to = local(s.origin, lat, lon) if math.isfinite(lat) and math.isfinite(lon) else s.p_n[:2]
        d = s.origin[2] - alt if math.isfinite(alt) else s.p_n[2]
        if self._watch[f.i].fence.breach((to[0], to[1], d)):
            s.say(CRITICAL, "Reposition is outside geofence")
            to, d = s.p_n[:2], s.p_n[2]
        n.go((to[0], to[1], d), yaw, s)

    def _navigator(self, f: Face) -> Navigator:
        if f.i not in self._navigators:
            self._navigators[f.i] = Navigator(f.i, self.params, f.missions)
        return self._navigators[f.i]

    def _situation(
        self, f: Face, s: Sensed, origin: tuple[float, float, float], home: list[float]
    ) -> Situation:
        i = f.i
        p, v = self.est.p_n[i].tolist(), self.est.v_n[i].tolist()
        return Situation(
            now=s.now,
            p_n=(p[0], p[1], p[2]),
            v_n=(v[0], v[1], v[2]),
            yaw=float(yaw_from_quat(self.est.q_nb[i : i + 1])[0]),
            landed=s.landed,
            flying=s.flying,
            origin=origin,
            home_n=(home[0], home[1], home[2]),
            home_yaw=f.home_yaw,
            say=f.commander.say,
        )

    def _check(self, f: Face, s: Sensed, w: _Watch, home: tuple[float, float, float] | None) -> None:
        """A list, the home or a parameter has changed: fence and mission anew."""
        m, p, i = f.missions, self.params, f.i
        horizontal, vertical = float(p["GF_MAX_HOR_DIST"][i]), float(p["GF_MAX_VER_DIST"][i])
        kept = w.fence.areas
        if m.ids[FENCE] != w.fence_id and f.origin is not None and home is not None:
            here = (
                self.est.p_n[i].tolist()[:2]
                if f.commander.armed and not s.landed and p["GF_ACTION"][i] > 0
                else None
            )
            kept, why = usable(areas(m.items[FENCE], f.origin), home[:2], here)
            w.fence_id = m.ids[FENCE]
            for words in why:
                f.commander.say(CRITICAL, words)
        w.fence = Fence(
            areas=kept,
            home_n=home if horizontal > 0 or vertical > 0 else None,
            max_horizontal_m=horizontal,
            max_vertical_m=vertical,
        )
        m.valid = False
        if m.items[MISSION] and f.origin is not None and home is not None:
            why_not = mission_feasibility.why_not(
                m.items[MISSION],
                f.origin,
                home,
                w.fence,
                landed=s.landed,
                first_within_m=float(p["MIS_DIST_1WP"][i]),
                wanted=int(p["MIS_TKO_LAND_REQ"][i]),
            )
            m.valid = not why_not
            if why_not and (w.key is None or m.ids[MISSION] != 0):
                f.commander.say(CRITICAL, why_not)
