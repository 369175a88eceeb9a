"""Generation of the PX4 parameters that configure an arena's failsafes. Pure.

The parameters are those of one PX4 version. `facts.failsafe_table` has the parameter values of each action.
Events for which the YAML sets only an action (`Failsafe.actions`) need no code here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from arena.errors import InputError
from arena.params.facts.failsafe_table import (
    EVENTS,
    Action,
    Event,
    delays,
    settings_for,
    supported_actions,
)
from arena.params.generation.lines import Line, LineWriter
from arena.params.generation.requirements import Failsafe, Reaction

_EMERGENCY_SHARE = 0.7  # emergency charge, as a share of the charge at which the vehicle lands
_EXCEPT_ALL = (
    7  # COM_RCL_EXCEPT: missions, hold and take-off, offboard; landing and return are never interrupted
)
_RC_LOSS_S = 0.5  # PX4's default
_MEANINGS: Mapping[Action, str] = {"none": "no reaction", "warn": "a warning only"}
_POSITION_ACTIONS = ("land", "hold", "return")  # without a position estimate PX4 descends instead


def failsafe_lines(w: LineWriter) -> Iterator[Line]:
    """Yield the PX4 parameters of all failsafes that the arena requires.

    A required action that the PX4 version does not have is added to `w.not_possible`, as a sentence.
    """
    failsafe = w.required.failsafe
    yield from _offboard_loss(w, failsafe)
    yield from _position_loss(w, failsafe)
    yield from _battery(w, failsafe)
    yield from _rc_loss(w, failsafe)
    yield from _data_link_loss(w, failsafe)
    for event, action in failsafe.actions.items():
        yield from _reaction(w, event, event, action)
    yield from _attitude(w, failsafe)
    if not w.required.simulated:
        for line in _changed_by_others(w, failsafe):
            w.needed.add(line.name)
            yield line
    for name in ("COM_FAIL_ACT_T", "COM_RCL_ACT_T", "COM_BAT_ACT_T"):
        if name in w.known:
            yield w.line(name, 0.0, "failsafes act at once, without a hold before [s]", "failsafe")


def _changed_by_others(w: LineWriter, f: Failsafe) -> Iterator[Line]:
    """Yield the parameters with which the failsafes of a real vehicle do not act as configured, if somebody has changed them.

    PX4's defaults are right. A simulated vehicle starts with them; a real vehicle keeps what its last user has set.
    """
    if f.low_battery_land is not None and "CBRK_SUPPLY_CHK" in w.known:
        meaning = "the battery failsafe is on (hardware in the loop switches it off)"
        yield w.line("CBRK_SUPPLY_CHK", 0, meaning, "failsafe.low_battery")
    if f.rc_loss != "none" and w.required.sticks and "COM_RC_LOSS_T" in w.known:
        yield w.line(
            "COM_RC_LOSS_T", _RC_LOSS_S, "time without RC before the failsafe [s]", "failsafe.rc_loss"
        )
    actions = (f.offboard_loss, f.position_loss, f.rc_loss, f.data_link_loss, *f.actions.values())
    if "return" in actions and "RTL_LAND_DELAY" in w.known:
        yield w.line("RTL_LAND_DELAY", 0.0, "AUTO.RTL lands at home at once [s]", "failsafe")


def _offboard_loss(w: LineWriter, f: Failsafe) -> Iterator[Line]:
    key, rc = "offboard_loss", w.required.sticks
    # 1.12 and 1.13 use one of two parameters, depending on COM_RCL_EXCEPT; so both get the same action
    two = "COM_OBL_ACT" in w.known
    when = EVENTS["offboard_loss_without_rc" if two else "offboard_loss"]
    yield from _reaction(w, key, "offboard_loss_without_rc", f.offboard_loss, when=when)
    if two:
        yield from _reaction(w, key, "offboard_loss", f.offboard_loss, report=rc)
    meaning = "time without setpoints before the failsafe [s]"
    yield _delay(w, key, "offboard_loss", "COM_OF_LOSS_T", f.offboard_loss_after_s, meaning)


def _position_loss(w: LineWriter, f: Failsafe) -> Iterator[Line]:
    if w.required.vision_delay_ms is None:
        return
    event: Event = "position_loss_in_offboard"
    meaning = "time without poses before the failsafe [us]"
    yield _delay(w, "position_loss", event, "EKF2_NOAID_TOUT", f.position_loss_after_s, meaning)
    if f.position_loss == "land":  # 1.17 and newer change to altitude mode in any case
        yield from _reaction(w, "position_loss", "position_loss_in_position_mode", "descend", report=False)
    wanted: Action = "descend" if f.position_loss == "land" else f.position_loss
    if wanted == "descend" and (f.offboard_loss in _POSITION_ACTIONS or w.version.minor < 12):
        return
    settings = _settings(w, event, wanted)
    same_as_offboard_loss = _settings(w, "offboard_loss_without_rc", f.offboard_loss)
    if not settings or any(same_as_offboard_loss.get(n, value) != value for n, value in settings.items()):
        w.not_possible.append(
            f"failsafe.position_loss: PX4 {w.version} has no separate action when poses stop in OFFBOARD: it takes the action of"
            f" offboard_loss ({f.offboard_loss}), or descends if that action needs a position; {f.position_loss} is not set"
        )


def _battery(w: LineWriter, f: Failsafe) -> Iterator[Line]:
    key = "failsafe.low_battery"
    action: Reaction = "warn" if f.low_battery_land is None else "land"
    yield from _reaction(w, "low_battery", "low_battery", action)
    warning = w.within_limits("BAT_LOW_THR", f.low_battery_warn, f"{key}: warn")
    yield w.line("BAT_LOW_THR", warning, "charge at which the vehicle warns [-]", key)
    if f.low_battery_land is not None:
        critical = w.within_limits("BAT_CRIT_THR", f.low_battery_land, f"{key}: land")
        limits = w.known["BAT_EMERGEN_THR"]
        emergency = min(max(round(_EMERGENCY_SHARE * critical, 3), limits.min or 0.0), limits.max or 1.0)
        yield w.line("BAT_CRIT_THR", critical, "charge at which the vehicle lands [-]", key)
        yield w.line(
            "BAT_EMERGEN_THR",
            emergency,
            "charge that counts as an emergency; the vehicle lands, too [-]",
            key,
        )


def _rc_loss(w: LineWriter, f: Failsafe) -> Iterator[Line]:
    rc = w.required.sticks
    yield from _reaction(w, "rc_loss", "rc_loss_in_offboard", f.rc_loss if rc else "none")
    if rc and f.rc_loss != "none":
        yield from _reaction(w, "rc_loss", "rc_loss", f.rc_loss)
    elif rc:
        yield from _reaction(w, "rc_loss", "rc_loss", "none", report=False)
        if "COM_RCL_EXCEPT" in w.known:
            yield w.line("COM_RCL_EXCEPT", _EXCEPT_ALL, "no reaction when RC is lost", "failsafe.rc_loss")
    elif w.required.joystick and w.version.minor >= 13:
        # programs fly on when a joystick is switched off; a person without a joystick cannot fly
        yield from _reaction(w, "rc_loss", "rc_loss", "land", report=False)
        yield w.line(
            "COM_RCL_EXCEPT",
            _EXCEPT_ALL,
            "only flight by hand ends when the joystick is lost",
            "failsafe.rc_loss",
        )
    if f.rc_loss != "none" and not rc:
        w.not_possible.append(
            f"failsafe.rc_loss: {f.rc_loss} is not set, because the vehicle has no RC. "
            "Set `sticks: true` if it has (hardware: `radio: required`)"
        )


def _data_link_loss(w: LineWriter, f: Failsafe) -> Iterator[Line]:
    action, key = f.data_link_loss, "data_link_loss"
    if action == "terminate" and w.version.minor >= 14:
        w.not_possible.append(
            f"failsafe.data_link_loss: PX4 {w.version} counts the ground station as lost while it boots, and cannot undo a"
            " termination, so the vehicle could never fly: terminate is not set; use disarm"
        )
        action = "none"
    yield from _reaction(w, key, "data_link_loss", action)
    if action != "none":
        meaning = "time without a ground station before the failsafe [s]"
        yield from _reaction(w, key, "data_link_loss_in_offboard", action, when=EVENTS["data_link_loss"])
        yield _delay(w, key, "data_link_loss", "COM_DL_LOSS_T", f.data_link_loss_after_s, meaning)


def _attitude(w: LineWriter, f: Failsafe) -> Iterator[Line]:
    if f.attitude is None:
        return
    # newer versions have no `none`: a warning is the mildest action
    none: Action = "none" if "none" in supported_actions("attitude_failure", w.version) else "warn"
    yield from _reaction(w, "attitude", "attitude_failure", none if f.attitude == "none" else f.attitude)
    for name in ("FD_FAIL_R", "FD_FAIL_P") if f.attitude != "none" else ():
        limit = w.within_limits(
            name, f.attitude_above_deg, f"failsafe.attitude: {f.attitude_above_deg:g} deg"
        )
        yield w.line(name, limit, "angle that counts as an attitude failure [deg]", "failsafe.attitude")


def _reaction(
    w: LineWriter, key: str, event: Event, action: Action, *, when: str = "", report: bool = True
) -> Iterator[Line]:
    """Yield the parameters that make PX4 take the failsafe action `action` after `event`.

    key: key in the YAML's section `failsafe`.
    when: description of the event; "" for that of `EVENTS`.
    report: if the version does not have the action, add the reason to `w.not_possible`.
    """
    try:
        settings = settings_for(event, action, w.version)
    except InputError as error:
        if report:
            w.not_possible.append(f"failsafe.{key}: {error}")
        return
    for name, value in settings.items():
        yield w.line(
            name, value, f"{_MEANINGS.get(action, action)} when {when or EVENTS[event]}", f"failsafe.{key}"
        )


def _settings(w: LineWriter, event: Event, action: Action) -> Mapping[str, int]:
    try:
        return settings_for(event, action, w.version)
    except InputError:
        return {}


def _delay(w: LineWriter, key: str, event: Event, name: str, seconds: float, meaning: str) -> Line:
    """Return the parameter that sets PX4's delay between an event and its failsafe action.

    seconds: wanted total delay [s]. The fixed delay that PX4 adds to the parameter's value is subtracted.
    """
    delay = next((d for d in delays(event, w.version) if d.parameter == name), None)
    scale, fixed = (delay.scale_s, delay.fixed_s) if delay else (1.0, 0.0)
    value = w.within_limits(name, (seconds - fixed) / scale, f"failsafe.{key}: {seconds:g} s")
    return w.line(name, value, meaning, f"failsafe.{key}")
