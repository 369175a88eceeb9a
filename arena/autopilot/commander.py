"""Flight mode, arming and failsafes of one vehicle.

The commander decides from plain values: no arrays, no messages, no clock. `Autopilots` calls `update` 50
times a second. Requests from clients call `request_mode`, `arm` and `disarm`. Texts for the user are appended
to `texts` as (MAV_SEVERITY, text); the MAVLink interface sends them as STATUSTEXT, as PX4 does.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from arena.autopilot import events
from arena.autopilot.arming_checks import arming_problems
from arena.autopilot.commander_inputs import CommanderInputs, CommanderParams, gcs_lost
from arena.autopilot.events import Event
from arena.autopilot.failsafe_rules import (
    BY_SEVERITY,
    EXCEPTION_BIT,
    MANUAL_ACTIONS,
    NOT_ARMABLE,
    home_or_land,
)
from arena.autopilot.flight_modes import MANUAL_MODES, POSITION_MODES, THRUST_MODES, Mode
from arena.autopilot.manual_control import NO_MANUAL_CONTROL
from arena.autopilot.manual_mode_rules import (
    missing_for_manual,
    possible_mode,
    stick_problem,
    sticks_take_over,
)

EMERGENCY, CRITICAL, WARNING, NOTICE, INFO = 0, 2, 4, 5, 6  # MAV_SEVERITY


_MODES_BY_ESTIMATE = frozenset({Mode.POSCTL, Mode.ALTCTL, Mode.STABILIZED})
"""Manual modes between which a vehicle changes when the estimate becomes valid or invalid."""
_REQUESTABLE = {*MANUAL_MODES, *POSITION_MODES, Mode.OFFBOARD}


@dataclass(slots=True)
class Commander:
    """Flight mode, arming state and failsafe state of one vehicle.

    mode: the current flight mode
    intended: the flight mode that was requested last
    armed_since: time of arming [s], infinite while disarmed
    took_off: True if a take-off was detected since arming
    failsafe: reason of the active failsafe, "" if none is active
    had_manual_control: True if stick positions (RC or joystick) were received since arming
    disarmed_why: reason of the last disarming, "" before the first
    texts: messages for the user, (MAV_SEVERITY, text); the MAVLink interface removes each when it sends it
    events: the same as events of the MAVLink event protocol, for what PX4 has an event, too; removed likewise
    """

    name: str
    mode: Mode = Mode.HOLD
    intended: Mode = Mode.HOLD
    armed: bool = False
    armed_since: float = float("inf")
    took_off: bool = False
    failsafe: str = ""
    had_manual_control: bool = False
    disarmed_why: str = ""
    texts: list[tuple[int, str]] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    _landed_since: float | None = None
    _pending: tuple[float, Mode] | None = None
    _battery_level: int = 0
    _fence: str = ""
    _tilted_since: float | None = None
    _manual_control_lost: bool = False
    _mode_was_requested: bool = False

    # -- requests --------------------------------------------------------------------------------------------

    def request_mode(self, mode: Mode | None, s: CommanderInputs, params: CommanderParams) -> str:
        """Change the flight mode. Return "" on success, or the reason of the refusal.

        A disarmed vehicle accepts every mode, because arming checks the conditions of the mode. LAND is
        always accepted.
        """
        if mode is None or mode not in _REQUESTABLE:
            why = f"mode {mode.label} is not supported by the built-in autopilot" if mode else "no such mode"
        elif self.mode is Mode.TERMINATE and self.armed:
            why = "flight is terminated"
        else:
            why = self._missing_for(mode, s, params) if self.armed and mode is not Mode.LAND else ""
        if why:
            self.report(CRITICAL, f"Mode change denied: {why}", events.mode_denied(mode))
        else:
            self.intended, self._mode_was_requested = mode or Mode.HOLD, True
            self._enter(self.intended, "")
        return why

    def _missing_for(self, mode: Mode, s: CommanderInputs, params: CommanderParams) -> str:
        if mode is Mode.OFFBOARD and s.offboard_age > params.com_of_loss_t:
            return "no offboard setpoints: stream them at 2 Hz or more first"
        if (
            mode in POSITION_MODES or (mode is Mode.OFFBOARD and s.offboard_needs_position)
        ) and not s.position_ok:
            return "no valid local position"
        return missing_for_manual(mode, s) or self._missing_for_auto(mode, s)

    def _missing_for_auto(self, mode: Mode, s: CommanderInputs) -> str:
        if mode in (Mode.MISSION, Mode.RTL) and not s.global_ok:
            return "no valid global position"
        if mode is Mode.RTL and not s.home_ok:
            return "no home position"
        return "no valid mission available" if mode is Mode.MISSION and not s.mission_ok else ""

    def arm_checks(self, s: CommanderInputs, params: CommanderParams) -> list[str]:
        """Return every reason to refuse arming; an empty list if the vehicle may arm."""
        return arming_problems(self.mode, s, params)

    def arm(self, s: CommanderInputs, params: CommanderParams, *, why: str = "by external command") -> str:
        """Arm the vehicle. Return "" on success, or the reasons of the refusal."""
        throttle = stick_problem(self.mode, s)
        reasons = [*([throttle] if throttle else []), *self.arm_checks(s, params)]
        if self.armed:
            return ""
        if reasons:
            self.report(CRITICAL, f"Arming denied: {reasons[0]}", events.ARMING_DENIED())
            return "; ".join(reasons)
        self.armed, self.armed_since, self.took_off, self._landed_since = True, s.now, False, None
        self._pending, self._battery_level, self._fence = None, 0, ""
        self._tilted_since, self.had_manual_control, self._manual_control_lost = None, False, False
        self.failsafe = ""
        self.report(INFO, f"Armed {why}", events.armed(why))
        return ""

    def disarm(self, s: CommanderInputs, *, force: bool = False, why: str = "by external command") -> str:
        """Disarm (in the air only with `force`). Return "" on success, or the reason of the refusal."""
        if not self.armed:
            return ""
        if not force and not s.landed:
            self.report(CRITICAL, "Disarming denied: not landed", events.NOT_LANDED())
            return "not landed"
        self.armed, self.armed_since, self.took_off, self._pending = False, float("inf"), False, None
        self.disarmed_why = why
        self.report(INFO, f"Disarmed {why}", events.disarmed(why))
        if self.mode in NOT_ARMABLE:
            self._enter(Mode.HOLD, "")
        return ""

    def terminate(self, why: str) -> None:
        """Stop the motors, even in flight."""
        if self.mode is not Mode.TERMINATE:
            self._enter(Mode.TERMINATE, why)
            event = events.failsafe(self.intended, Mode.TERMINATE, why)
            self.report(EMERGENCY, f"Flight termination: {why}", event)

    def report(self, severity: int, text: str, event: Event | None = None) -> None:
        """Queue a text for the user (STATUSTEXT), and the MAVLink event with the same content if one is given."""
        self.texts.append((severity, text))
        if event is not None:
            self.events.append(event.with_text(text))

    # -- 50 times a second -----------------------------------------------------------------------------------

    def update(self, s: CommanderInputs, params: CommanderParams) -> None:
        """Detect the take-off, run the failsafe checks, and disarm after the landing."""
        self._run_gesture(s, params)
        if not self.armed:
            if s.manual_control and not self._mode_was_requested:
                self.intended = self.mode = Mode.POSCTL  # as in PX4: the first stick positions select POSCTL
            return
        if s.flying and not (s.landed or self.took_off):
            self.took_off = True
            self.report(INFO, "Takeoff detected", events.TAKEOFF())
        for check in _CHECKS:
            check(self, s, params)
            if not self.armed:
                return
        self._run_pending(s)
        self._check_sticks(s, params)
        self._auto_disarm(s, params)

    def _run_gesture(self, s: CommanderInputs, params: CommanderParams) -> None:
        """Arm or disarm if the pilot has made the stick gesture: throttle low, and yaw right (arm) or left (disarm).

        In STABILIZED and ACRO this also disarms in the air (COM_DISARM_MAN).
        """
        gesture = s.manual.gesture if params.man_arm_gesture else ""
        if gesture == "arm" and not self.armed:
            if self.mode in MANUAL_MODES:
                self.arm(s, params, why="by stick gesture")
            else:
                self.report(CRITICAL, "Arming denied: switch to manual mode first", events.NOT_MANUAL())
        elif gesture == "disarm" and (s.landed or (self.mode in THRUST_MODES and params.com_disarm_man == 1)):
            self.disarm(s, force=True, why="by stick gesture")

    def _check_sticks(self, s: CommanderInputs, params: CommanderParams) -> None:
        """Change to a simpler mode while the estimate is not valid, and to POSCTL when the pilot moves the sticks.

        ALTCTL and STABILIZED change back to the selected mode when the estimate is valid again.
        """
        if self.mode in _MODES_BY_ESTIMATE and self.intended in (Mode.POSCTL, Mode.ALTCTL):
            possible = possible_mode(self.intended, s, params)
            if possible is self.intended and self.mode is not possible:
                self._enter(possible, "")
            elif possible is not self.mode:
                self._act(possible, f"no valid estimate for {self.intended.label}")
        in_delay = self._pending is not None
        takes = sticks_take_over(self.mode, s, params, failsafe=self.failsafe, in_delay=in_delay)
        if takes and possible_mode(Mode.POSCTL, s, params) in (Mode.POSCTL, Mode.ALTCTL):
            self.intended, self._pending = Mode.POSCTL, None
            self._enter(possible_mode(Mode.POSCTL, s, params), "")
            self.report(INFO, "Pilot took over using sticks", events.PILOT())

    def _check_attitude(self, s: CommanderInputs, params: CommanderParams) -> None:
        """Terminate the flight if the vehicle stays tilted too far (FD_FAIL_R, FD_FAIL_P) for FD_FAIL_R_TTRI.

        The delay prevents a termination when the tilt exceeds the limit only for a moment. In the first
        seconds after arming (COM_LKDOWN_TKO) the vehicle disarms instead, for any value of CBRK_FLIGHTTERM:
        it has tipped over at the take-off.
        """
        begins = s.now - self.armed_since < params.lockdown_s
        beyond = s.tilt_rad > params.fd_fail_rad and (self.took_off or begins)
        self._tilted_since = (self._tilted_since or s.now) if beyond else None
        if self._tilted_since is None or s.now - self._tilted_since < params.fd_fail_s:
            return
        if begins:
            self._disarm_by_failsafe(s, "attitude failure")
        elif params.cbrk_flightterm == 0:
            self.terminate("attitude failure")

    def _check_position(self, s: CommanderInputs, params: CommanderParams) -> None:
        """Run the failsafe if the present mode needs a position estimate and the estimate is not valid.

        In OFFBOARD the loss counts as lost offboard control, as in PX4. COM_OBL_RC_ACT 6 (terminate) and 7
        (disarm) are run at once. Its other actions need a position, so the vehicle descends instead.
        """
        if s.position_ok or self.mode is Mode.POSCTL:
            return
        if self.mode in POSITION_MODES or (self.mode is Mode.OFFBOARD and s.offboard_needs_position):
            what = "position" if not s.xy_valid else "heading" if not s.yaw_valid else "height"
            why = f"external vision lost, no valid {what}"
            if self.mode is Mode.OFFBOARD and params.com_obl_rc_act == 7:
                self._disarm_by_failsafe(s, why)
            elif self.mode is Mode.OFFBOARD and params.com_obl_rc_act == 6:
                self._act(Mode.TERMINATE, why)
            else:
                self._act(Mode.DESCEND, f"{why}: blind land")

    def _check_battery(self, s: CommanderInputs, params: CommanderParams) -> None:
        left = s.battery
        level = (
            (left <= params.bat_low_thr) + (left <= params.bat_crit_thr) + (left <= params.bat_emergen_thr)
        )
        if level <= self._battery_level:
            return
        self._battery_level = level
        severity, word = ((WARNING, "Low"), (CRITICAL, "Critical"), (EMERGENCY, "Emergency"))[level - 1]
        self.report(severity, f"{word} battery: {100 * s.battery:.0f} %", events.LOW_BATTERY[level - 1]())
        returns = level == 2 and params.com_low_bat_act == 3
        done = NOT_ARMABLE if returns else NOT_ARMABLE - {Mode.RTL}
        if (level >= 2 and params.com_low_bat_act in (2, 3)) and self.mode not in done:
            self._act_after_hold(home_or_land(s) if returns else Mode.LAND, s, params, "battery")

    def _check_fence(self, s: CommanderInputs, params: CommanderParams) -> None:
        """Run the failsafe action of GF_ACTION once when the vehicle leaves the geofence.

        The action is not repeated, so that the pilot can then select another mode.
        """
        crossed, self._fence = s.fence and not self._fence, s.fence
        action = params.gf_action
        if not crossed or action == 0:
            return
        self.report(CRITICAL, s.fence)
        reaction = {2: Mode.HOLD, 3: home_or_land(s), 4: Mode.TERMINATE, 5: Mode.LAND}.get(action)
        down = self.mode in (Mode.LAND, Mode.DESCEND, Mode.TERMINATE) or (
            self.mode is Mode.RTL and action == 2
        )
        if reaction is Mode.TERMINATE or (reaction and not down):
            self._act_after_hold(reaction, s, params, "geofence")

    def _check_offboard(self, s: CommanderInputs, params: CommanderParams) -> None:
        if s.offboard_age <= params.com_of_loss_t or self.mode is not Mode.OFFBOARD:
            return
        action = {3: home_or_land(s), 5: Mode.HOLD, 6: Mode.TERMINATE}.get(params.com_obl_rc_act, Mode.LAND)
        if params.com_obl_rc_act in MANUAL_ACTIONS and s.manual_control:
            self.intended = MANUAL_ACTIONS[params.com_obl_rc_act]
            action = possible_mode(self.intended, s, params)
        if params.com_obl_rc_act == 7:
            self._disarm_by_failsafe(s, "offboard control lost")
        else:
            self._act(action, "offboard control lost")

    def _check_data_link(self, s: CommanderInputs, params: CommanderParams) -> None:
        if not params.nav_dll_act:
            return
        coming_down = self.mode in (*NOT_ARMABLE, Mode.LAND)
        excepted = EXCEPTION_BIT.get(self.mode, 0) & params.com_dll_except
        if not (excepted or coming_down or self.failsafe) and gcs_lost(s, params):
            self._act_on_link_loss(params.nav_dll_act, s, params, "data link lost")

    def _check_manual_control(self, s: CommanderInputs, params: CommanderParams) -> None:
        """Run the failsafe action of NAV_RCL_ACT once when stick positions (RC or joystick) are no longer received."""
        self.had_manual_control = self.had_manual_control or s.manual_control
        if not self.had_manual_control:
            return
        excepted = EXCEPTION_BIT.get(self.intended, 0) & params.com_rcl_except
        lost = not s.manual_control and params.com_rc_in_mode != NO_MANUAL_CONTROL and not excepted
        crossed, self._manual_control_lost = lost and not self._manual_control_lost, lost
        if crossed:
            self._act_on_link_loss(params.nav_rcl_act, s, params, "manual control lost")

    def _act_on_link_loss(self, action: int, s: CommanderInputs, params: CommanderParams, why: str) -> None:
        """Run the failsafe action for a lost data link or RC, unless a mode of the same or higher severity is active.

        Severity increases in the order HOLD, RTL, LAND, DESCEND, TERMINATE. Action 6 (disarm) is always run.
        action: value of NAV_DLL_ACT or NAV_RCL_ACT; in HOLD every action is run
        """
        reaction = {1: Mode.HOLD, 2: home_or_land(s), 3: Mode.LAND, 5: Mode.TERMINATE}.get(action)
        if action == 6:
            self._disarm_by_failsafe(s, why)
        elif reaction and not (
            self.mode in BY_SEVERITY[1:] and BY_SEVERITY.index(self.mode) >= BY_SEVERITY.index(reaction)
        ):
            self._act_after_hold(reaction, s, params, why)

    def _disarm_by_failsafe(self, s: CommanderInputs, why: str) -> None:
        event = events.failsafe(self.intended, None, why)
        self.report(EMERGENCY, f"Failsafe activated: {why}: disarming", event)
        self.disarm(s, force=True, why="by failsafe")

    def _act_after_hold(self, mode: Mode, s: CommanderInputs, params: CommanderParams, why: str) -> None:
        """Hold position for COM_FAIL_ACT_T, then enter the flight mode of the failsafe.

        The pilot may select another mode during the hold. If an earlier failsafe is active, enter the mode at
        once.
        """
        waits = params.com_fail_act_t > 0 and mode not in (Mode.HOLD, Mode.TERMINATE) and s.position_ok
        if not waits or (self.failsafe and self.mode is not Mode.HOLD):
            self._act(mode, why)
            return
        until = self._pending[0] if self._pending else s.now + params.com_fail_act_t
        self._act(Mode.HOLD, why, events.failsafe(self.intended, mode, why, until - s.now))
        self._pending = (until, mode)

    def _run_pending(self, s: CommanderInputs) -> None:
        if self._pending and self.mode is Mode.HOLD and s.now >= self._pending[0]:
            _, mode = self._pending
            self._pending = None
            self._act(mode, self.failsafe)
        elif self._pending and self.mode is not Mode.HOLD:
            self._pending = None

    def _auto_disarm(self, s: CommanderInputs, params: CommanderParams) -> None:
        if not s.landed:
            self._landed_since = None
            return
        if self._landed_since is None:
            self._landed_since = s.now
            if self.took_off:
                self.report(INFO, "Landing detected", events.LANDING())
        wait = params.com_disarm_land if self.took_off else params.com_disarm_prflt
        if wait > 0 and s.now - self._landed_since >= wait and s.now - self.armed_since >= wait:
            self.disarm(s, why="by landing" if self.took_off else "by auto preflight disarming")

    def _act(self, mode: Mode, why: str, event: Event | None = None) -> None:
        if mode in (Mode.LAND, Mode.RTL, Mode.HOLD) and self.mode is Mode.DESCEND:
            return
        self.failsafe = why
        if mode is Mode.TERMINATE:
            self.terminate(why)
        else:
            self._enter(mode, why)
            event = event or events.failsafe(self.intended, mode, why)
            self.report(EMERGENCY, f"Failsafe activated: {why}: {mode.label}", event)

    def _enter(self, mode: Mode, failsafe: str) -> None:
        self.mode, self.failsafe = mode, failsafe


_CHECKS = (
    Commander._check_attitude,
    Commander._check_position,
    Commander._check_fence,
    Commander._check_battery,
    Commander._check_offboard,
    Commander._check_data_link,
    Commander._check_manual_control,
)
"""Failsafe checks, in the order in which they run."""
