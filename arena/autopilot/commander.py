"""One vehicle's mode, arming and failsafes: plain decisions on plain values, no arrays, no messages.

The fleet asks `update` some fifty times a second with what is sensed; the MAVLink face calls `request_mode`, `arm`, `disarm`.
Words that a person should read are left in `texts` as (severity, text), in PX4's manner.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from arena.autopilot.manual_control import NONE as NO_STICKS

EMERGENCY, CRITICAL, WARNING, NOTICE, INFO = 0, 2, 4, 5, 6  # MAV_SEVERITY


class Mode(Enum):
    """PX4's flight modes: (main, sub) of its custom_mode, and the words of its ground stations."""

    MANUAL = (1, 0, "MANUAL")
    ALTCTL = (2, 0, "ALTCTL")
    POSCTL = (3, 0, "POSCTL")
    TAKEOFF = (4, 2, "AUTO.TAKEOFF")
    HOLD = (4, 3, "AUTO.LOITER")
    MISSION = (4, 4, "AUTO.MISSION")
    RTL = (4, 5, "AUTO.RTL")
    LAND = (4, 6, "AUTO.LAND")
    ACRO = (5, 0, "ACRO")
    OFFBOARD = (6, 0, "OFFBOARD")
    STABILIZED = (7, 0, "STABILIZED")
    DESCEND = (4, 106, "DESCEND")  # inside only: told to the world as AUTO.LAND
    TERMINATE = (10, 0, "TERMINATION")  # nobody can ask for it

    @property
    def custom_mode(self) -> int:
        """The number in HEARTBEAT."""
        main, sub, _ = self.value
        return main << 16 | (sub % 100) << 24

    @property
    def words(self) -> str:
        return self.value[2]


def mode_of(main: int, sub: int) -> Mode | None:
    """None: no such mode."""
    return next((m for m in Mode if m.value[:2] == (main, sub if main == 4 else 0) and sub < 100), None)


_FLOWN = {Mode.TAKEOFF, Mode.HOLD, Mode.MISSION, Mode.RTL, Mode.LAND, Mode.OFFBOARD}
_NEEDS_POSITION = {Mode.TAKEOFF, Mode.HOLD, Mode.MISSION, Mode.RTL, Mode.LAND}
_EXCEPT = {
    Mode.MISSION: 1,
    Mode.HOLD: 2,
    Mode.TAKEOFF: 2,
    Mode.OFFBOARD: 4,
}  # bits of COM_DLL_EXCEPT and COM_RCL_EXCEPT
_WORSE = (
    Mode.HOLD,
    Mode.RTL,
    Mode.LAND,
    Mode.DESCEND,
    Mode.TERMINATE,
)  # the later, the worse: of two failsafes the worse acts
_BY_HAND = (0, 1, 2)  # COM_OBL_RC_ACT: position, altitude, stabilized
_GCS_QUIET_S = 2.5  # after its last heartbeat a ground station counts as gone, and COM_DL_LOSS_T begins
_NO_ARMING = {Mode.RTL, Mode.LAND, Mode.DESCEND, Mode.TERMINATE}


@dataclass(slots=True, kw_only=True)
class Sensed:
    """What the commander decides on. now [s]; battery remaining 0..1; offboard_age: since the last setpoint [s].

    global_ok: position and the origin are known; mission_ok: one is there that may be flown; fence: what is violated, in words;
    poses_rejected: the newest pose contradicts the estimate; sticks: a pilot's are there.
    """

    now: float
    xy_valid: bool
    z_valid: bool
    yaw_valid: bool
    landed: bool
    flying: bool
    tilt_rad: float
    battery: float
    offboard_age: float
    offboard_needs_position: bool
    gcs_age: float
    aligned: bool
    global_ok: bool = True
    home_ok: bool = True
    mission_ok: bool = False
    fence: str = ""
    poses_rejected: bool = False
    sticks: bool = False


@dataclass(slots=True, kw_only=True)
class Limits:
    """The parameters that decide, by PX4's names in lower case."""

    com_of_loss_t: float
    com_obl_rc_act: int
    com_fail_act_t: float
    com_disarm_land: float
    com_disarm_prflt: float
    com_low_bat_act: int
    bat_low_thr: float
    bat_crit_thr: float
    bat_emergen_thr: float
    nav_dll_act: int
    com_dl_loss_t: float
    cbrk_flightterm: int
    fd_fail_rad: float
    fd_fail_s: float = 0.3
    gf_action: int = 2
    com_dll_except: int = 0
    nav_rcl_act: int = 2
    com_rcl_except: int = 0
    com_rc_in_mode: int = 3
    com_rc_loss_t: float = 0.5


@dataclass(slots=True)
class Commander:
    """State of one vehicle.

    mode: what it flies; intended: what was asked for last; `armed_since`, `took_off` and what was lost belong to the present
    arming.
    """

    name: str
    mode: Mode = Mode.HOLD
    intended: Mode = Mode.HOLD
    armed: bool = False
    armed_since: float = float("inf")
    took_off: bool = False
    failsafe: str = ""
    texts: list[tuple[int, str]] = field(default_factory=list)
    mode_since: float = 0.0
    _landed_since: float | None = None
    _pending: tuple[float, Mode] | None = None
    _battery_level: int = 0
    _fence: str = ""
    _tilted_since: float | None = None
    _had_sticks: bool = False
    _sticks_lost: bool = False

    # -- asked for from outside ----------------------------------------------------------------------------------------

    def request_mode(self, mode: Mode | None, s: Sensed, limits: Limits) -> str:
        """Change mode, or return why not. Disarmed, every mode may be chosen and arming is what is checked; LAND always may."""
        if mode is None or mode not in _FLOWN:
            why = f"mode {mode.words} is not there in the built-in autopilot" if mode else "no such mode"
        elif self.mode is Mode.TERMINATE and self.armed:
            why = "flight is terminated"
        else:
            why = self._lacks(mode, s, limits) if self.armed and mode is not Mode.LAND else ""
        if why:
            self.say(CRITICAL, f"Mode change denied: {why}")
        else:
            self.intended = mode or Mode.HOLD
            self._enter(self.intended, s.now, "")
        return why

    def _lacks(self, mode: Mode, s: Sensed, limits: Limits) -> str:
        if mode is Mode.OFFBOARD and s.offboard_age > limits.com_of_loss_t:
            return "no offboard setpoints: stream them at 2 Hz or more first"
        if (
            mode in _NEEDS_POSITION or (mode is Mode.OFFBOARD and s.offboard_needs_position)
        ) and not _position_ok(s):
            return "no valid local position"
        return self._auto_lacks(mode, s)

    def _auto_lacks(self, mode: Mode, s: Sensed) -> str:
        if mode in (Mode.MISSION, Mode.RTL) and not s.global_ok:
            return "no valid global position"
        if mode is Mode.RTL and not s.home_ok:
            return "no home position"
        return "no valid mission available" if mode is Mode.MISSION and not s.mission_ok else ""

    def arm_checks(self, s: Sensed, limits: Limits) -> list[str]:
        """Every reason not to arm, in words; empty when it may."""
        offboard = self.mode is Mode.OFFBOARD
        position = self.mode in _NEEDS_POSITION or (offboard and s.offboard_needs_position)
        checks = [
            (not s.aligned, "Attitude not valid: waiting for external vision"),
            (position and not s.xy_valid, "Horizontal position not valid: no external vision"),
            (s.aligned and s.poses_rejected, "Position not stable: the poses contradict the estimate"),
            (position and not s.z_valid, "Height not valid: no external vision"),
            (s.aligned and not s.yaw_valid, "Heading not valid: vision yaw rejected"),
            (offboard and s.offboard_age > limits.com_of_loss_t, "No offboard signal"),
            (self.mode in _NO_ARMING, f"Mode {self.mode.words} does not allow arming"),
            (s.battery <= limits.bat_crit_thr, f"Battery too low: {100 * s.battery:.0f} %"),
            (s.tilt_rad > limits.fd_fail_rad, f"Attitude: tilted by {57.3 * s.tilt_rad:.0f} degrees"),
            (limits.nav_dll_act > 0 and _gcs_lost(s, limits), "No connection to the ground control station"),
            (self.mode is Mode.MISSION and not s.mission_ok, "No valid mission available"),
            (s.fence != "" and limits.gf_action > 0, s.fence),
        ]
        return [words for failed, words in checks if failed]

    def arm(self, s: Sensed, limits: Limits, *, why: str = "by external command") -> str:
        """Arm, or return why not."""
        reasons = self.arm_checks(s, limits)
        if self.armed:
            return ""
        if reasons:
            self.say(CRITICAL, f"Arming denied: {reasons[0]}")
            return "; ".join(reasons)
        self.armed, self.armed_since, self.took_off, self._landed_since = True, s.now, False, None
        self._pending, self._battery_level, self._fence = None, 0, ""
        self._tilted_since, self._had_sticks, self._sticks_lost = None, False, False
        self.failsafe = ""
        self.say(INFO, f"Armed {why}")
        return ""

    def disarm(self, s: Sensed, *, force: bool = False, why: str = "by external command") -> str:
        """Disarm, or return why not: never in the air but by force."""
        if not self.armed:
            return ""
        if not force and not s.landed:
            self.say(CRITICAL, "Disarming denied: not landed")
            return "not landed"
        self.armed, self.armed_since, self.took_off, self._pending = False, float("inf"), False, None
        self.say(INFO, f"Disarmed {why}")
        if self.mode in _NO_ARMING:
            self._enter(Mode.HOLD, s.now, "")
        return ""

    def terminate(self, now: float, why: str) -> None:
        """Motors off, whatever it is doing."""
        if self.mode is not Mode.TERMINATE:
            self._enter(Mode.TERMINATE, now, why)
            self.say(EMERGENCY, f"Flight termination: {why}")

    def say(self, severity: int, text: str) -> None:
        self.texts.append((severity, text))

    # -- by itself -----------------------------------------------------------------------------------------------------

    def update(self, s: Sensed, limits: Limits) -> None:
        """Failsafes, take-off bookkeeping, automatic disarming."""
        if not self.armed:
            return
        if s.flying and not (s.landed or self.took_off):
            self.took_off = True
            self.say(INFO, "Takeoff detected")
        for check in (
            self._check_attitude,
            self._check_position,
            self._check_fence,
            self._check_battery,
            self._check_offboard,
            self._check_data_link,
            self._check_sticks,
        ):
            check(s, limits)
            if not self.armed:
                return
        self._run_pending(s)
        self._auto_disarm(s, limits)

    def _check_attitude(self, s: Sensed, limits: Limits) -> None:
        """Beyond the limit for so long: what tumbles turns through it, what has fallen over stays there."""
        beyond = s.tilt_rad > limits.fd_fail_rad and self.took_off
        self._tilted_since = (self._tilted_since or s.now) if beyond else None
        if (
            limits.cbrk_flightterm == 0
            and self._tilted_since is not None
            and s.now - self._tilted_since >= limits.fd_fail_s
        ):
            self.terminate(s.now, "attitude failure")

    def _check_position(self, s: Sensed, limits: Limits) -> None:
        """In OFFBOARD it counts as its loss, as in PX4: who stops the motors then stops them now, all others want a position."""
        needs = self.mode in _NEEDS_POSITION or (self.mode is Mode.OFFBOARD and s.offboard_needs_position)
        if needs and not _position_ok(s):
            what = "position" if not s.xy_valid else "heading" if not s.yaw_valid else "height"
            why = f"external vision lost, no valid {what}"
            if self.mode is Mode.OFFBOARD and limits.com_obl_rc_act == 7:
                self._drop(s, why)
            elif self.mode is Mode.OFFBOARD and limits.com_obl_rc_act == 6:
                self._act(Mode.TERMINATE, s.now, why)
            else:
                self._act(Mode.DESCEND, s.now, f"{why}: blind land")

    def _check_battery(self, s: Sensed, limits: Limits) -> None:
        below = [s.battery <= t for t in (limits.bat_low_thr, limits.bat_crit_thr, limits.bat_emergen_thr)]
        level = sum(below)
        if level <= self._battery_level:
            return
        self._battery_level = level
        severity, word = ((WARNING, "Low"), (CRITICAL, "Critical"), (EMERGENCY, "Emergency"))[level - 1]
        self.say(severity, f"{word} battery: {100 * s.battery:.0f} %")
        returns = level == 2 and limits.com_low_bat_act == 3
        done = _NO_ARMING if returns else _NO_ARMING - {Mode.RTL}
        if (level >= 2 and limits.com_low_bat_act in (2, 3)) and self.mode not in done:
            self._act_soon(_home_or_land(s) if returns else Mode.LAND, s, limits, "battery")

    def _check_fence(self, s: Sensed, limits: Limits) -> None:
        """Answered once, when it is crossed: who then chooses another mode flies."""
        crossed, self._fence = s.fence and not self._fence, s.fence
        action = limits.gf_action
        if not crossed or action == 0:
            return
        self.say(CRITICAL, s.fence)
        reaction = {2: Mode.HOLD, 3: _home_or_land(s), 4: Mode.TERMINATE, 5: Mode.LAND}.get(action)
        down = self.mode in (Mode.LAND, Mode.DESCEND, Mode.TERMINATE) or (
            self.mode is Mode.RTL and action == 2
        )
        if reaction is Mode.TERMINATE or (reaction and not down):
            self._act_soon(reaction, s, limits, "geofence")

    def _check_offboard(self, s: Sensed, limits: Limits) -> None:
        if self.mode is not Mode.OFFBOARD or s.offboard_age <= limits.com_of_loss_t:
            return
        action = {3: _home_or_land(s), 5: Mode.HOLD, 6: Mode.TERMINATE}.get(limits.com_obl_rc_act, Mode.LAND)
        if limits.com_obl_rc_act in _BY_HAND and s.sticks:
            action = Mode.HOLD  # what sticks in the middle ask for
        if limits.com_obl_rc_act == 7:
            self._drop(s, "offboard control lost")
        else:
            self._act(action, s.now, "offboard control lost")

    def _check_data_link(self, s: Sensed, limits: Limits) -> None:
        coming_down = self.mode in (*_NO_ARMING, Mode.LAND)
        excepted = _EXCEPT.get(self.mode, 0) & limits.com_dll_except
        if limits.nav_dll_act and not (excepted or coming_down or self.failsafe) and _gcs_lost(s, limits):
            self._answer_link(limits.nav_dll_act, s, limits, "data link lost")

    def _check_sticks(self, s: Sensed, limits: Limits) -> None:
        """Answered once, when they are lost: who then chooses another mode flies. Those that never came are not missed."""
        self._had_sticks = self._had_sticks or s.sticks
        excepted = _EXCEPT.get(self.intended, 0) & limits.com_rcl_except
        lost = self._had_sticks and not s.sticks and limits.com_rc_in_mode != NO_STICKS and not excepted
        crossed, self._sticks_lost = lost and not self._sticks_lost, lost
        if crossed:
            self._answer_link(limits.nav_rcl_act, s, limits, "manual control lost")

    def _answer_link(self, action: int, s: Sensed, limits: Limits, why: str) -> None:
        """action: of NAV_DLL_ACT or NAV_RCL_ACT. What comes down goes on coming down."""
        reaction = {1: Mode.HOLD, 2: _home_or_land(s), 3: Mode.LAND, 5: Mode.TERMINATE}.get(action)
        if action == 6:
            self._drop(s, why)
        elif reaction and not (self.mode in _WORSE[1:] and _WORSE.index(self.mode) >= _WORSE.index(reaction)):
            self._act_soon(reaction, s, limits, why)

    def _drop(self, s: Sensed, why: str) -> None:
        self.say(EMERGENCY, f"Failsafe activated: {why}: disarming")
        self.disarm(s, force=True, why="by failsafe")

    def _act_soon(self, mode: Mode, s: Sensed, limits: Limits, why: str) -> None:
        """After a hold of COM_FAIL_ACT_T in which a pilot may take over; at once where another failsafe acts already."""
        waits = limits.com_fail_act_t > 0 and mode not in (Mode.HOLD, Mode.TERMINATE) and _position_ok(s)
        if not waits or (self.failsafe and self.mode is not Mode.HOLD):
            self._act(mode, s.now, why)
            return
        until = self._pending[0] if self._pending else s.now + limits.com_fail_act_t
        self._act(Mode.HOLD, s.now, why)
        self._pending = (until, mode)

    def _run_pending(self, s: Sensed) -> None:
        if self._pending and self.mode is Mode.HOLD and s.now >= self._pending[0]:
            _, mode = self._pending
            self._pending = None
            self._act(mode, s.now, self.failsafe)
        elif self._pending and self.mode is not Mode.HOLD:
            self._pending = None

    def _auto_disarm(self, s: Sensed, limits: Limits) -> None:
        if not s.landed:
            self._landed_since = None
            return
        if self._landed_since is None:
            self._landed_since = s.now
            if self.took_off:
                self.say(INFO, "Landing detected")
        wait = limits.com_disarm_land if self.took_off else limits.com_disarm_prflt
        if wait > 0 and s.now - self._landed_since >= wait and s.now - self.armed_since >= wait:
            self.disarm(s, why="by landing" if self.took_off else "by auto preflight disarming")

    def _act(self, mode: Mode, now: float, why: str) -> None:
        if mode in (Mode.LAND, Mode.RTL, Mode.HOLD) and self.mode is Mode.DESCEND:
            return
        self.failsafe = why
        if mode is Mode.TERMINATE:
            self.terminate(now, why)
        else:
            self._enter(mode, now, why)
            self.say(EMERGENCY, f"Failsafe activated: {why}: {mode.words}")

    def _enter(self, mode: Mode, now: float, failsafe: str) -> None:
        if mode is not self.mode:
            self.mode, self.mode_since = mode, now
        self.failsafe = failsafe


def _home_or_land(s: Sensed) -> Mode:
    """What a failsafe that asks for a return can have."""
    return Mode.RTL if s.global_ok and s.home_ok and _position_ok(s) else Mode.LAND


def _gcs_lost(s: Sensed, limits: Limits) -> bool:
    return s.gcs_age > _GCS_QUIET_S + limits.com_dl_loss_t


def _position_ok(s: Sensed) -> bool:
    return s.xy_valid and s.z_valid and s.yaw_valid
