"""State machine that decides which role (program, pilot, ground station ...) may command one vehicle. Pure.

Priority: pilot > emergency (land-all, kill-all) > copilot > program > setpoints of a ground station.

A pilot commands with a radio, not through arena. The pilot has control when the vehicle enters a manual mode that no
command requested, and when it leaves a landing of land-all or the copilot for a manual mode. A landing by land-all or the
copilot is latched: until `release`, programs and ground stations cannot arm, cannot take OFFBOARD and cannot weaken the
landing. docs/explanation/authority.md contains the tables of requests, states and locks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from arena.authority.requests import MOVING_KINDS, PROGRAM_MODES, Kind, Request
from arena.authority.roles import Change, Role
from arena.constants import PILOT_HAS_CONTROL
from arena.wire.px4_mode import MANUAL_MODES

COPILOT_HOLD_S = 1.0  # a hold of the copilot ends this long after its last command
_ASKED_S = 5.0  # a mode that appears within this time after a command for it was commanded
_INPUT_S, _INPUT_HEARTBEATS = 2.0, 2  # stick positions count as present this long, and for as many heartbeats
_SETPOINTS_S = 1.0  # a program that has sent setpoints within this time is in use
_STRENGTH = {"AUTO.LOITER": 1, "AUTO.RTL": 2, "AUTO.LAND": 3, "TERMINATION": 4}
_LAND, _KILL = 3, 4


@dataclass(frozen=True, kw_only=True)
class _Latch:
    by: Role
    strength: int


class Authority:
    """Decides who may command one vehicle, based on the requests to the vehicle and the heartbeats of its autopilot.

    Pass every request to `refusal` before it is sent to the vehicle, and every heartbeat of its autopilot to `on_state`.
    radio: false if no pilot has a radio (`radio: none`). A manual mode that no command requested then means that a pilot has
        control only while stick positions reach the vehicle. Without stick positions a failsafe may have chosen the mode.
    simulated: true if the vehicle is simulated, so that no pilot has a radio for it. An automatic mode that no command requested
        is then always a failsafe.
    holder: who commands the vehicle now.
    """

    def __init__(self, *, simulated: bool, radio: bool = True) -> None:
        self.holder = Role.NOBODY
        self._simulated = simulated
        self._input_needed = not (simulated or radio)
        self._input_at, self._heartbeats_since = float("-inf"), _INPUT_HEARTBEATS
        self._changes: list[Change] = []
        self._armed, self._mode = False, ""
        self._latch: _Latch | None = None
        self._obeyed = False
        self._taken, self._taken_until_disarmed, self._by_failsafe = "", False, False
        self._arming_off = ""
        self._asked: dict[str, tuple[Role, float]] = {}  # requested mode -> sender and time
        self._arm_asked: tuple[Role, float] | None = None
        self._hold_until = self._program_setpoint_at = float("-inf")

    # -- requests ------------------------------------------------------------------------------------------------------

    def refusal(self, role: Role, request: Request, now: float, *, sent: bool = True) -> str:
        """Return why a request must not be sent to the vehicle; "" if the request is allowed.

        The text has at most 50 bytes, so that it fits in one STATUSTEXT. An allowed request is remembered, because it
        can change who commands the vehicle.
        role: role of the sender. now: monotonic [s].
        sent: false if the caller does not send the request for another reason. The request is then not remembered.
        """
        if request.kind is Kind.SETPOINT and role is Role.PROGRAM and self.passes_program_setpoint(now):
            return ""
        why = self._refusal(role, request, now)
        if sent and not why:
            self._record(role, request, now)
        return why

    def passes_program_setpoint(self, now: float) -> bool:
        """Return True if a program's setpoint may be sent, because no landing, motor stop or failsafe forbids it.

        If the result is False, call `refusal`, which decides. This test is fast, because setpoints are the
        most frequent requests. If the result is True, the time of the setpoint is stored. now: monotonic [s].
        """
        if self._latch is not None or (self._taken and self._by_failsafe):
            return False
        self._program_setpoint_at = now
        return True

    def _refusal(self, role: Role, request: Request, now: float) -> str:
        kind = request.kind
        if kind is Kind.WRITE or (kind is Kind.FAILURE and self._simulated):
            return ""
        starts = kind is Kind.SPIN or (kind is Kind.ARM and not self._armed)
        gesture = kind is Kind.MANUAL_INPUT and not self._armed  # a stick gesture arms
        if self._arming_off and (starts or gesture):
            return f"arming refused: {self._arming_off}"
        if self.holder is Role.PILOT:
            return self._refusal_with_pilot(role, kind)
        if self._latch is not None and role < self._latch.by:
            return self._refusal_with_latch(self._latch, role, request)
        moves = gesture or kind in MOVING_KINDS or (kind is Kind.MODE and request.mode in PROGRAM_MODES)
        if moves and role < Role.COPILOT and now < self._hold_until:
            return "copilot holds the vehicle"
        if role is Role.PROGRAM and (why := self._refusal_to_program(kind, moves, now)):
            return why
        if (
            kind is Kind.SETPOINT
            and role is Role.GROUND_STATION
            and now - self._program_setpoint_at < _SETPOINTS_S
        ):
            return "a program sends setpoints"
        return ""

    def _refusal_to_program(self, kind: Kind, moves: bool, now: float) -> str:
        if kind is not Kind.SETPOINT and self._is_flown_with_sticks(now):
            return "a person flies with sticks"
        # after a failsafe, PX4 enters OFFBOARD again without a command as soon as setpoints arrive
        moves = moves or (kind is Kind.SETPOINT and self._by_failsafe)
        return f"{self._taken}: run `arena release`" if moves and self._taken else ""

    def _is_flown_with_sticks(self, now: float) -> bool:
        """Return whether the vehicle is armed, in a manual mode, and receives stick positions.

        The sticks may be those of an RC transmitter or of a joystick at a ground station.
        """
        return self._armed and self._mode in MANUAL_MODES and now - self._input_at <= _INPUT_S

    def _refusal_with_pilot(self, role: Role, kind: Kind) -> str:
        """Return why a request is refused while a pilot has control; "" if the request is allowed.

        A program's setpoints are allowed, because a pilot gives control back by switching to OFFBOARD. A simulated
        vehicle obeys land-all, because no pilot could land it.
        """
        if self._simulated and role is Role.EMERGENCY:
            return ""
        if role is Role.GROUND_STATION:
            return PILOT_HAS_CONTROL if kind in (Kind.SETPOINT, Kind.FAILURE) else ""
        return "" if kind is Kind.SETPOINT else PILOT_HAS_CONTROL

    def _refusal_with_latch(self, latch: _Latch, role: Role, request: Request) -> str:
        kind = request.kind
        person = role is Role.GROUND_STATION
        may_arm = not self._armed and self._mode != ""  # "": no heartbeat yet, so a person may be flying
        by_hand = (kind is Kind.MANUAL_INPUT and not may_arm) or (
            kind is Kind.MODE and request.mode in MANUAL_MODES
        )
        as_strong = kind is Kind.MODE and _STRENGTH.get(request.mode, 0) >= latch.strength
        if kind in (Kind.DISARM, Kind.KILL) or as_strong or (person and by_hand):
            return ""
        return f"{latch.by.words} has control: run `arena release`"

    def _record(self, role: Role, request: Request, now: float) -> None:
        kind = request.kind
        if kind is Kind.MANUAL_INPUT and role is Role.GROUND_STATION:
            self.on_manual_input(now)
        elif kind is Kind.ARM:
            self._arm_asked = role, now
        elif kind is Kind.MODE:
            self._asked = {m: found for m, found in self._asked.items() if now - found[1] <= _ASKED_S}
            self._asked[request.mode] = role, now
        if role not in (Role.COPILOT, Role.EMERGENCY):
            return
        strength = _KILL if kind is Kind.KILL else _STRENGTH.get(request.mode, 0) if kind is Kind.MODE else 0
        if strength >= _LAND:
            self._set_latch(role, strength, now)
        elif strength and role is Role.COPILOT:
            if now >= self._hold_until:
                self._change(Role.COPILOT, "the copilot commands hold", now)
            self._hold_until = now + COPILOT_HOLD_S

    def _set_latch(self, role: Role, strength: int, now: float) -> None:
        latch = self._latch
        if latch is not None and (latch.by, latch.strength) >= (role, strength):
            return
        self._latch = _Latch(by=role, strength=max(strength, latch.strength if latch is not None else 0))
        what = "stop of the motors" if strength >= _KILL else "landing"
        self._change(role, f"{what}, until `arena release`", now, always=True)

    # -- the vehicle ---------------------------------------------------------------------------------------------------

    def on_state(self, armed: bool, mode: str, now: float) -> None:
        """Update who commands the vehicle, from the arming state and mode in a heartbeat. now: monotonic [s]."""
        before, was_armed = self._mode, self._armed
        self._armed, self._mode = armed, mode
        if not armed:
            self._taken = "" if self._taken_until_disarmed else self._taken
            if was_armed or self.holder is Role.PILOT:
                self._on_disarmed(now)
            return
        self._heartbeats_since += 1
        if self._latch is not None and mode == "AUTO.LAND":
            self._obeyed = True
        if mode != before or not was_armed:
            self._on_mode(before if was_armed else "", mode, now)
        elif self.holder is Role.PILOT and not self._has_pilot(now):
            self._change(self._latched_role, f"{mode}, but no stick positions for {_INPUT_S:g} s", now)

    def on_manual_input(self, now: float) -> None:
        """Record that stick positions of an RC transmitter or a joystick reach the vehicle.

        With `radio: none` in the YAML, only stick positions show that a pilot has control.
        """
        self._input_at, self._heartbeats_since = now, 0
        unclear = self.holder is not Role.GROUND_STATION or self._obeyed
        if self._input_needed and self._armed and self._mode in MANUAL_MODES and unclear:
            self._change(Role.PILOT, self._mode, now)

    def _has_pilot(self, now: float) -> bool:
        """Return whether a pilot can have control. Without a radio (`radio: none`), only while stick positions arrive."""
        silent = self._heartbeats_since > _INPUT_HEARTBEATS and now - self._input_at > _INPUT_S
        return not (self._input_needed and silent)

    @property
    def _latched_role(self) -> Role:
        return self._latch.by if self._latch is not None else Role.NOBODY

    def _on_mode(self, before: str, mode: str, now: float) -> None:
        """Update who commands the armed vehicle after a mode change. before: previous mode; "" if it was disarmed."""
        role = self._role_that_asked(mode, armed_now=not before, now=now)
        # PX4 does not leave a commanded mode by itself
        self._by_failsafe = self._by_failsafe and (role is None or mode == "OFFBOARD")
        if mode in MANUAL_MODES:
            self._on_manual_mode(role, before, mode, now)
            return
        if mode == "OFFBOARD":
            if role is None and before and not self._by_failsafe:
                self._taken = ""  # the pilot's switch gives control to the program
            by_switch = "OFFBOARD, by the pilot's switch" if before else "OFFBOARD"
            why = "OFFBOARD commanded" if role is not None else by_switch
            self._change(role if role is not None else Role.PROGRAM, why, now)
            return
        if before == "OFFBOARD":
            self._on_offboard_left(role, mode)
        if role is not None:
            self._change(role, f"{mode} commanded", now)
        elif before == "OFFBOARD":
            self._change(Role.NOBODY, f"OFFBOARD has ended without a command: {mode}", now)
        elif self.holder is Role.PILOT:
            self._change(Role.NOBODY, f"pilot has left manual control: {mode}", now)

    def _on_manual_mode(self, role: Role | None, before: str, mode: str, now: float) -> None:
        took = before == "OFFBOARD" or (
            before and self.holder in (Role.PROGRAM, Role.COPILOT, Role.EMERGENCY)
        )
        who = f"{role.words} took control" if role is not None else f"{mode} ended OFFBOARD"
        if (role is None or self._obeyed) and self._has_pilot(now):
            role, who, self._by_failsafe = Role.PILOT, "pilot took control", False
        if role is None:
            self._change(self._latched_role, f"{mode}, but no stick positions of a pilot", now, always=True)
        else:
            self._change(role, mode, now)
        if took and role is not Role.PROGRAM:
            self._set_taken(who, until_disarmed=False)

    def _on_offboard_left(self, role: Role | None, mode: str) -> None:
        if role is Role.GROUND_STATION:
            self._set_taken("ground station took control", until_disarmed=False)
        elif role is None:
            self._set_taken(f"{mode} ended OFFBOARD"[:29], until_disarmed=self._simulated)
            self._by_failsafe = True

    def _on_disarmed(self, now: float) -> None:
        self._obeyed = False
        self._hold_until = float("-inf")
        if self.holder is not Role.NOBODY:
            self._change(Role.NOBODY, "disarmed", now)

    def _role_that_asked(self, mode: str, *, armed_now: bool, now: float) -> Role | None:
        """Return the role (such as program or ground station) that has requested the vehicle's new mode.

        None if no sender has requested this mode within the last 5 s, for example if the pilot or a failsafe has changed the mode.
        mode: new mode, such as AUTO.LAND.  now: time [s].
        armed_now: the vehicle was armed together with the change of the mode. If no sender has requested the mode, the sender
        that has requested arming within the last 5 s is returned.
        """
        asked = [
            found for m, found in self._asked.items() if _leads_to(m, mode) and now - found[1] <= _ASKED_S
        ]
        if asked:
            return max(asked, key=lambda found: found[1])[0]
        if armed_now and self._arm_asked is not None and now - self._arm_asked[1] <= _ASKED_S:
            return self._arm_asked[0]
        return None

    def _set_taken(self, why: str, *, until_disarmed: bool) -> None:
        if not self._taken or self._taken_until_disarmed:
            self._taken, self._taken_until_disarmed, self._by_failsafe = why, until_disarmed, False

    # -- requests of the operator --------------------------------------------------------------------------------------

    def release(self, by: str, now: float) -> None:
        """Release a vehicle that land-all or the copilot has landed or stopped (command `arena release`).

        Programs may then take OFFBOARD again.

        by: name of the person who releases the vehicle.
        """
        self._latch, self._taken, self._obeyed = None, "", False
        self._hold_until = float("-inf")
        holder = self.holder if self.holder is Role.PILOT else Role.NOBODY
        why = f"still, after the release by {by}" if holder else f"released by {by}"
        self._change(holder, why, now, always=True)

    def refuse_arming(self, why: str) -> None:
        """Refuse every request to arm the vehicle from now on, for example because the run is ending.

        The refusal lasts until this process ends.

        why: reason that the sender of a refused request gets, such as "the run is ending".
        """
        self._arming_off = self._arming_off or why[:30]

    @property
    def standing(self) -> dict[str, Any]:
        """State of the refusals of commands, to be passed to `restore` after a restart of this process.

        The result is {} if commands are not refused.

        latch: role that commanded the latched landing or motor stop, and its strength (3 landing, 4 motor stop).
        taken: text that says why programs cannot take OFFBOARD. until_disarmed: true if `taken` ends when the vehicle disarms.
        by_failsafe: a failsafe has ended OFFBOARD.
        pilot: true if the pilot has control.
        """
        found: dict[str, Any] = {"pilot": True} if self.holder is Role.PILOT else {}
        if self._latch is not None:
            found["latch"] = [int(self._latch.by), self._latch.strength]
        if self._taken:
            found |= {"taken": self._taken, "until_disarmed": self._taken_until_disarmed}
            found |= {"by_failsafe": True} if self._by_failsafe else {}
        return found

    def restore(self, standing: Mapping[str, Any], now: float) -> None:
        """Refuse again the commands that were refused before this process was restarted.

        The supervisor requests this after it has restarted the process, or if the process was not ready when `land-all`
        commanded a landing. A pilot who has control keeps control.

        standing: last value of `standing` that was reported before the restart, by this process or by another process that
        passes commands to the vehicle; or the landing.
        """
        pilot = self.holder is Role.PILOT
        if taken := standing.get("taken"):
            self._set_taken(str(taken), until_disarmed=standing.get("until_disarmed") is True)
            self._by_failsafe = self._by_failsafe or standing.get("by_failsafe") is True
        if latch := standing.get("latch"):
            self._set_latch(Role(latch[0]), int(latch[1]), now)
            if pilot:
                self._change(
                    Role.PILOT, "pilot keeps control; a landing is latched until `arena release`", now
                )
        if standing.get("pilot") is True:  # until the first heartbeats show the flight mode
            self._input_at, self._heartbeats_since = now, 0
            self._change(Role.PILOT, "as before a restart", now)

    @property
    def latched(self) -> bool:
        """True if land-all or the copilot has landed or stopped the vehicle, and nobody has released it."""
        return self._latch is not None

    @property
    def blocked(self) -> str:
        """Reason why programs must not fly the vehicle now; "" if they may. `release` ends it."""
        return f"{self._latch.by.words} has control" if self._latch is not None else self._taken

    @property
    def has_changes(self) -> bool:
        """True if the authority over the vehicle has changed since the last call of `take_changes`."""
        return bool(self._changes)

    def take_changes(self) -> list[Change]:
        """Return the changes of authority (who commands the vehicle, and why) since the last call."""
        found, self._changes = self._changes, []
        return found

    def _change(self, holder: Role, why: str, now: float, *, always: bool = False) -> None:
        """Set the role that commands the vehicle, and record the change for `take_changes`.

        holder: the role

        always: record it even if the role stays the same, because the reason is new.
        """
        if always or holder is not self.holder:
            self._changes.append(Change(holder=holder, why=why, at=now))
        self.holder = holder


def _leads_to(asked: str, mode: str) -> bool:
    """Return whether the present flight mode can be the result of a mode request.

    AUTO.TAKEOFF, for example, ends in AUTO.LOITER.

    asked: requested mode. mode: present mode
    """
    if asked == mode:
        return True
    if asked == "REPOSITION":
        return mode == "AUTO.LOITER"
    return asked == "AUTO.TAKEOFF" and mode == "AUTO.LOITER"
