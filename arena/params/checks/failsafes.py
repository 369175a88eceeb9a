"""Does each failsafe do, in this room, what it is there for: links, battery, attitude, fence, landing? Pure.

Which value means which action is `meanings`' to know; here it is judged. Figures: a room is some 5 m long and 3 m high.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from arena.params.checks.findings import Finding, Look, Severity
from arena.params.facts.failsafe_actions import Action, Event, action_of, row, sticks, ways
from arena.params.facts.failsafe_delays import delays

_SLOWEST_S = 1.5  # from the last setpoint to the failsafe
_SHORTEST_S = 0.25  # a busy computer pauses as long, and radios do
_LOW_ROOM_M = 3.0
_FASTEST_LANDING_M_S = 1.0
_DEAD_CELL_V = 3.2  # of a lithium polymer cell under load, below which the voltage collapses
_LONGEST_WAIT_S = 2.0
_LONGEST_ARMED_S = 5.0
_BY_HAND: tuple[Action, ...] = ("position", "altitude", "stabilized")
_DROPS: tuple[Action, ...] = ("disarm", "terminate")


def _way(look: Look, event: Event, action: Action) -> str:
    """The values that lead to the action, for people; "" where the version cannot."""
    if action not in row(event, look.version).ways:
        return ""
    return ", ".join(f"{name} {value}" for name, value in ways(event, action, look.version).items())


def _parameter(look: Look, event: Event) -> str:
    """The one that chooses; "" where the version leaves no choice."""
    return next((name for settings in row(event, look.version).ways.values() for name in settings), "")


def _action(look: Look, event: Event) -> Action | None:
    return action_of(event, look.all, look.version)


# --- the stream of setpoints


def offboard_loss_action(look: Look) -> Iterator[Finding]:
    name, action = "COM_OBL_RC_ACT", _action(look, "offboard_loss")
    fix = f"set {_way(look, 'offboard_loss', 'land')} (land)"
    alone = (
        look.minor >= 14 and not look.room.sticks
    )  # before, another parameter speaks where there are no sticks
    if action is None:
        yield look.finding(
            "error",
            name,
            f"PX4 {look.version} has no such action for lost setpoints",
            row("offboard_loss", look.version).why,
            fix,
        )
    elif action == "none":
        yield look.finding(
            "error", name, "setpoints that stop are not answered", "it flies on as it was, into the wall", fix
        )
    elif action in _BY_HAND:
        why = (
            "nobody holds sticks: it descends blind"
            if alone
            else "the pilot has to be quick, with sticks in hand; a program that died would better land"
        )
        yield look.finding(
            "error" if alone else "warning", name, f"setpoints that stop lead to {action} mode", why, fix
        )


def offboard_loss_action_without_sticks(look: Look) -> Iterator[Finding]:
    """Up to 1.13 a parameter of its own."""
    if look.minor >= 14:
        return
    action = _action(look, "offboard_loss_without_sticks")
    if action in (None, "none"):
        what = (
            "setpoints that stop, without sticks, are not answered"
            if action
            else "is no action for lost setpoints"
        )
        yield look.finding(
            "error",
            "COM_OBL_ACT",
            what,
            "it flies on as it was, or holds",
            f"set {_way(look, 'offboard_loss_without_sticks', 'land')} (land)",
        )


def offboard_loss_time(look: Look) -> Iterator[Finding]:
    name, value = "COM_OF_LOSS_T", look.value("COM_OF_LOSS_T")
    if value is None:
        return
    fixed = sum(d.fixed_s for d in delays("offboard_loss", look.version))
    total = value + fixed
    if value <= 0 and not fixed:
        yield look.finding(
            "error",
            name,
            "setpoints are too old as soon as they come",
            "offboard cannot be entered or kept",
            f"set {name} 0.5",
        )
    elif value <= 0:
        yield look.finding(
            "warning",
            name,
            f"the loss of setpoints is answered at once, {fixed:g} s after the last",
            "one pause of the program or of the radio as long, and the flight is over",
            f"set {name} 0.5, which makes {fixed + 0.5:g} s",
        )
    elif total < _SHORTEST_S:
        yield look.finding(
            "warning",
            name,
            f"setpoints may pause for {total:g} s only",
            "a busy computer or a radio pauses as long",
            f"set {name} 0.5",
        )
    elif total > _SLOWEST_S:
        yield look.finding(
            "warning",
            name,
            f"the loss of setpoints is answered after {total:g} s",
            "until then it flies on with the last one: a room is crossed in that time",
            f"set {name} {max(1.0 - fixed, 0.5):g}",
        )


# --- sticks and the ground station


def sticks_source(look: Look) -> Iterator[Finding]:
    name, value = "COM_RC_IN_MODE", look.value("COM_RC_IN_MODE")
    none = sticks("none", look.version)
    if value is None:
        return
    if look.room.sticks and look.minor >= 13 and value == none:
        yield look.finding(
            "error", name, "sticks are ignored", "the pilot cannot take over", f"set {name} 0 (the radio)"
        )
    elif not look.room.sticks and value != none and look.minor < 13:
        yield look.finding(
            "error" if value == 0 else "warning",
            name,
            "a radio is expected, and there is none",
            "without one it does not arm",
            f"set {name} {none} (none is needed)",
        )
    elif not look.room.sticks and value != none:
        yield look.finding(
            "warning",
            name,
            "sticks are expected, and there are none",
            "a radio or joystick that comes and goes sets off a failsafe in flight",
            f"set {name} {none} (none)",
        )


def sticks_loss(look: Look) -> Iterator[Finding]:
    if not look.room.sticks:
        return
    action = _action(look, "sticks_loss")
    fix = f"set {_way(look, 'sticks_loss', 'land')} (land)"
    if action is None or action == "none":
        yield look.finding(
            "error",
            "NAV_RCL_ACT",
            "the loss of the radio is not answered" if action else "is no such action",
            "with the pilot's last means gone it flies on",
            fix,
        )
    if look.minor >= 13 and look.bits("COM_RCL_EXCEPT") & 4:
        yield look.finding(
            "warning",
            "COM_RCL_EXCEPT",
            "the loss of the radio is ignored in offboard (bit 4)",
            "with a pilot in the room, his radio is the last means to end a flight",
            f"set COM_RCL_EXCEPT {look.bits('COM_RCL_EXCEPT') & ~4}",
        )


def data_link(look: Look) -> Iterator[Finding]:
    name, value = "NAV_DLL_ACT", look.value("NAV_DLL_ACT")
    if look.minor >= 14 and value and _action(look, "data_link_loss_in_offboard") not in ("none", None):
        way = _way(look, "data_link_loss_in_offboard", "none")
        yield look.finding(
            "note",
            name,
            "the loss of the ground station is answered in offboard too",
            "without one it does not arm, and closing it in flight ends the flight",
            f"keep one open, or set {way}",
        )


# --- actions that are wrong in a room, whatever leads to them


class _Cause(NamedTuple):
    """An event and how it is called. sticks: it is looked at where there are some only."""

    event: Event
    words: str
    sticks: bool = False


_CAUSES = (
    _Cause("offboard_loss", "setpoints that stop"),
    _Cause("offboard_loss_without_sticks", "setpoints that stop, without sticks,"),
    _Cause("sticks_loss", "the loss of the radio", sticks=True),
    _Cause("data_link_loss", "the loss of the ground station"),
    _Cause("low_battery", "an empty battery"),
    _Cause("geofence", "a breach of the fence"),
    _Cause("motor_failure", "the failure of a motor"),
)


def _led_to(look: Look, *actions: Action) -> Iterator[tuple[str, str, Action, Event]]:
    """(parameter, cause in words, action, event) of what leads to one of these, each parameter once."""
    seen = set()
    for cause in _CAUSES:
        name, action = _parameter(look, cause.event), _action(look, cause.event)
        if action in actions and action and name not in seen and (look.room.sticks or not cause.sticks):
            seen.add(name)
            yield name, cause.words, action, cause.event


def drops(look: Look) -> Iterator[Finding]:
    for name, words, action, event in _led_to(look, *_DROPS):
        land = _way(look, event, "land")
        yield look.finding(
            "warning",
            name,
            f"{words} leads to {action}",
            "the motors stop in the air, and it falls",
            f"set {land} (land)" if land else "choose another action",
        )


def returns(look: Look) -> Iterator[Finding]:
    height = look.value("RTL_RETURN_ALT")
    ceiling = look.room.height_m or _LOW_ROOM_M
    if height is None or height < ceiling:
        return
    for name, words, _, event in _led_to(look, "return"):
        land = _way(look, event, "land")
        yield look.finding(
            "warning",
            name,
            f"{words} leads to a return, which climbs to RTL_RETURN_ALT {height:g} m",
            "the ceiling comes first" if look.room.height_m else "a room's ceiling comes first",
            f"set {land} (land), or RTL_RETURN_ALT below {ceiling:g}",
            "RTL_RETURN_ALT",
        )


# --- the battery


def low_battery(look: Look) -> Iterator[Finding]:
    name = "COM_LOW_BAT_ACT"
    action, fix = _action(look, "low_battery"), f"set {name} 2 (land)"
    if action == "warn":
        yield look.finding(
            "warning", name, "an empty battery is told, and not answered", "it flies until it falls", fix
        )
    elif action is None and look.value(name) != 1:  # 1 is obeyed, and not offered any more
        yield look.finding("error", name, "is no such action", "an empty battery is not answered", fix)


def battery_thresholds(look: Look) -> Iterator[Finding]:
    low, critical, emergency = (look.value(f"BAT_{n}_THR") for n in ("LOW", "CRIT", "EMERGEN"))
    if low is None or critical is None or emergency is None:
        return
    if critical <= 0 and emergency <= 0:
        yield look.finding(
            "error",
            "BAT_CRIT_THR",
            "the battery's failsafe is never reached",
            "no charge is below none",
            "set BAT_CRIT_THR 0.1",
            "BAT_EMERGEN_THR",
        )
    elif emergency >= critical:
        yield look.finding(
            "warning",
            "BAT_EMERGEN_THR",
            f"is not below BAT_CRIT_THR {critical:g}",
            "the critical charge is never reached: the first answer is the last one",
            "set BAT_EMERGEN_THR below BAT_CRIT_THR",
            "BAT_CRIT_THR",
        )
    if critical >= low:
        yield look.finding(
            "warning",
            "BAT_CRIT_THR",
            f"is not below BAT_LOW_THR {low:g}",
            "nobody is warned before the failsafe acts",
            "set BAT_CRIT_THR below BAT_LOW_THR",
            "BAT_LOW_THR",
        )


def battery_is_measured(look: Look) -> Iterator[Finding]:
    prefix = "BAT1_" if look.minor >= 11 else "BAT_"
    empty, charged = look.value(f"{prefix}V_EMPTY"), look.value(f"{prefix}V_CHARGED")
    source, cells = look.value(f"{prefix}SOURCE"), look.value(f"{prefix}N_CELLS")
    if source == -1:
        yield look.finding(
            "error",
            f"{prefix}SOURCE",
            "no battery is measured",
            "its failsafe is never reached",
            f"set {prefix}SOURCE 0",
        )
    if source in (1, -1):  # it tells its charge itself
        return
    if cells is not None and cells <= 0:
        yield look.finding(
            "error",
            f"{prefix}N_CELLS",
            "how many cells the battery has is unset",
            "no charge is worked out of its voltage: its failsafe is never reached",
            f"set {prefix}N_CELLS to the battery's cells in series",
        )
    if empty is None or charged is None:
        return
    if empty >= charged:
        yield look.finding(
            "error",
            f"{prefix}V_EMPTY",
            f"is not below {prefix}V_CHARGED {charged:g} V",
            "no charge can be worked out of a voltage",
            f"set {prefix}V_EMPTY 3.6",
            f"{prefix}V_CHARGED",
        )
    elif empty < _DEAD_CELL_V:
        yield look.finding(
            "warning",
            f"{prefix}V_EMPTY",
            f"a cell counts as empty at {empty:g} V",
            "it collapses before: the battery's failsafe is not reached in time",
            f"set {prefix}V_EMPTY 3.6",
        )


# --- circuit breakers and the failure detector


class _Breaker(NamedTuple):
    """since, until: minor versions in which it matters so."""

    name: str
    since: int
    until: int
    severity: Severity
    what: str
    why: str


_BREAKERS = (
    _Breaker(
        "CBRK_FLIGHTTERM",
        9,
        9,
        "warning",
        "what follows an attitude failure is behind this circuit breaker",
        "a vehicle on its back goes on turning its propellers; this version warns only, even without the breaker",
    ),
    _Breaker(
        "CBRK_FLIGHTTERM",
        10,
        18,
        "warning",
        "what follows an attitude failure is behind this circuit breaker",
        "a vehicle on its back goes on turning its propellers",
    ),
    _Breaker(
        "CBRK_SUPPLY_CHK", 9, 13, "warning", "the power supply is not checked", "it arms with a failing one"
    ),
    _Breaker(
        "CBRK_SUPPLY_CHK",
        14,
        18,
        "error",
        "battery failsafes are behind this circuit breaker",
        "an empty battery is neither told nor answered",
    ),
    _Breaker(
        "CBRK_VELPOSERR",
        9,
        13,
        "error",
        "errors of position and velocity are behind this circuit breaker",
        "a lost position goes unnoticed",
    ),
    _Breaker(
        "CBRK_RATE_CTRL",
        9,
        13,
        "error",
        "the rate controller is behind this circuit breaker",
        "nothing holds it upright",
    ),
)


def breakers(look: Look) -> Iterator[Finding]:
    for b in _BREAKERS:
        fact = look.facts.get(b.name)
        if fact and b.since <= look.minor <= b.until and look.value(b.name) == fact.max:
            yield look.finding(b.severity, b.name, b.what, b.why, f"set {b.name} 0")
    for name, fact in look.facts.items():
        if name.startswith("CBRK_") and look.value(name) not in (0, fact.max):
            yield look.finding(
                "warning",
                name,
                f"is neither 0 nor {fact.max:g}",
                "any other number is without effect",
                f"set {name} 0, or {fact.max:g} to switch the check off",
            )


def attitude_limits(look: Look) -> Iterator[Finding]:
    limits: Mapping[str, float] = {
        n: v for n in ("FD_FAIL_R", "FD_FAIL_P") if (v := look.value(n)) is not None
    }
    for name, limit in limits.items():
        if limit <= 0:
            yield look.finding(
                "warning",
                name,
                "a failure of the attitude is not looked for",
                "a vehicle on its back goes on",
                f"set {name} 60",
            )
    lowest = min((v for v in limits.values() if v > 0), default=None)
    if lowest is None:
        return
    for name in ("MPC_TILTMAX_AIR", *(("MPC_MAN_TILT_MAX",) if look.room.sticks else ())):
        tilt = look.value(name)
        if tilt is not None and tilt >= lowest:
            acts = look.value("CBRK_FLIGHTTERM") == 0
            yield look.finding(
                "error" if acts else "warning",
                name,
                f"it may tilt to {tilt:g} deg, and a failure begins at {lowest:g}",
                "a brisk manoeuvre "
                + ("ends the flight" if acts else "would end the flight without the breaker"),
                f"set {name} {max(lowest - 15, 20):g}, or raise FD_FAIL_R and FD_FAIL_P",
                *limits,
            )


# --- what follows a failsafe, and the fence


def waits(look: Look) -> Iterator[Finding]:
    name, value = "COM_FAIL_ACT_T", look.value("COM_FAIL_ACT_T")
    if value is not None and value > _LONGEST_WAIT_S:
        yield look.finding(
            "warning",
            name,
            f"it holds for {value:g} s before most failsafes act",
            "that is for a pilot to take over; an empty battery may not last as long",
            f"set {name} 0",
        )


def landing(look: Look) -> Iterator[Finding]:
    speed = look.value("MPC_LAND_SPEED")
    if speed is not None and speed > _FASTEST_LANDING_M_S:
        yield look.finding(
            "warning",
            "MPC_LAND_SPEED",
            f"it lands with {speed:g} m/s",
            "it descends blind with that speed as well, and bounces",
            "set MPC_LAND_SPEED 0.6",
        )
    armed = look.value("COM_DISARM_LAND")
    if armed is not None and armed <= 0:
        yield look.finding(
            "warning",
            "COM_DISARM_LAND",
            "it does not disarm after a landing",
            "propellers turn until somebody disarms; landed means disarmed here",
            "set COM_DISARM_LAND 2",
        )
    elif armed is not None and armed > _LONGEST_ARMED_S:
        yield look.finding(
            "note",
            "COM_DISARM_LAND",
            f"it disarms {armed:g} s after a landing",
            "propellers turn meanwhile",
            "set COM_DISARM_LAND 2",
        )


def hover_thrust(look: Look) -> Iterator[Finding]:
    name, value = "MPC_THR_HOVER", look.value("MPC_THR_HOVER")
    if value is not None and value == look.default(name):
        yield look.finding(
            "note",
            name,
            f"the hover thrust is the default, {value:g}",
            "take-off, and a descent without a position, start from it",
            f"set {name} to what it hovers with",
        )


def fence(look: Look) -> Iterator[Finding]:
    across, up = look.value("GF_MAX_HOR_DIST"), look.value("GF_MAX_VER_DIST")
    action = _action(look, "geofence")
    if action in ("none", "warn") and (across or up):
        yield look.finding(
            "warning",
            "GF_ACTION",
            "there is a fence, and its breach is not answered",
            "it flies on beyond it",
            f"set {_way(look, 'geofence', 'land') or _way(look, 'geofence', 'hold')}",
        )
    elif not across and not up:
        yield look.finding(
            "note",
            "GF_MAX_HOR_DIST",
            "there is no fence in the autopilot",
            "nothing on board knows of the walls",
            "set GF_MAX_HOR_DIST and GF_MAX_VER_DIST; both want a home, and so an origin",
        )
    if look.room.height_m and up and up > look.room.height_m:
        yield look.finding(
            "note",
            "GF_MAX_VER_DIST",
            f"the fence is higher than the room of {look.room.height_m:g} m",
            "it is never reached",
            f"set GF_MAX_VER_DIST below {look.room.height_m:g}",
        )
