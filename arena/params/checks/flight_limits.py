"""Rules for circuit breakers, attitude failure detector, landing, hover thrust and geofence. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import NamedTuple

from arena.params.checks.findings import CheckContext, Finding, Severity
from arena.params.checks.link_loss import current_action, settings_text
from arena.params.facts.parameter_table import Version, parameters

_MAX_LANDING_M_S = 1.0
_MAX_ARMED_AFTER_LANDING_S = 5.0


class _Breaker(NamedTuple):
    """A circuit breaker parameter of PX4, and the problem that it causes if a user sets it.

    since, until: first and last minor version with this problem.
    """

    name: str
    since: int
    until: int
    severity: Severity
    problem: str
    why: str


_BREAKERS = (
    _Breaker(
        "CBRK_FLIGHTTERM",
        9,
        9,
        "warning",
        "this circuit breaker switches off the reaction to an attitude failure",
        "an overturned vehicle keeps its propellers running; without the circuit breaker this version would only warn",
    ),
    _Breaker(
        "CBRK_FLIGHTTERM",
        10,
        18,
        "warning",
        "this circuit breaker switches off the reaction to an attitude failure",
        "an overturned vehicle keeps its propellers running",
    ),
    _Breaker(
        "CBRK_SUPPLY_CHK",
        9,
        13,
        "warning",
        "this circuit breaker switches off the check of the power supply",
        "the vehicle arms with a failing power supply",
    ),
    _Breaker(
        "CBRK_SUPPLY_CHK",
        14,
        18,
        "error",
        "this circuit breaker switches off the battery failsafes",
        "an empty battery causes neither a warning nor a reaction",
    ),
    _Breaker(
        "CBRK_VELPOSERR",
        9,
        13,
        "error",
        "this circuit breaker switches off the checks of position and velocity",
        "the loss of the position causes no reaction",
    ),
    _Breaker(
        "CBRK_RATE_CTRL",
        9,
        13,
        "error",
        "this circuit breaker switches off the rate controller",
        "nothing keeps the vehicle upright",
    ),
)


@cache
def _breaker_names(version: Version) -> tuple[str, ...]:
    return tuple(name for name in parameters(version) if name.startswith("CBRK_"))


def circuit_breakers(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding for each circuit breaker that disables a safety function or has an invalid value."""
    for b in _BREAKERS:
        parameter = ctx.table.get(b.name)
        if parameter and b.since <= ctx.minor <= b.until and ctx.value(b.name) == parameter.max:
            yield ctx.finding(b.severity, b.name, b.problem, expected="0", why=b.why, fix=f"set {b.name} 0")
    for name in _breaker_names(ctx.version):
        parameter = ctx.table[name]
        if ctx.value(name) not in (0, parameter.max):
            yield ctx.finding(
                "warning",
                name,
                f"neither 0 nor {parameter.max:g}",
                expected=f"0 or {parameter.max:g}",
                why="any other number has no effect",
                fix=f"set {name} 0, or {parameter.max:g} to switch the check off",
            )


def attitude_limits(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if the attitude failure detector is off, or so sensitive that a normal flight triggers it."""
    limits: Mapping[str, float] = {
        name: value for name in ("FD_FAIL_R", "FD_FAIL_P") if (value := ctx.value(name)) is not None
    }
    for name, limit in limits.items():
        if limit <= 0:
            yield ctx.finding(
                "warning",
                name,
                "an attitude failure is not detected",
                expected="60 deg",
                why="an overturned vehicle keeps its propellers running",
                fix=f"set {name} 60",
            )
    lowest = min((value for value in limits.values() if value > 0), default=None)
    if lowest is None:
        return
    for name in ("MPC_TILTMAX_AIR", *(("MPC_MAN_TILT_MAX",) if ctx.environment.rc else ())):
        tilt = ctx.value(name)
        if tilt is not None and tilt >= lowest:
            active = ctx.value("CBRK_FLIGHTTERM") == 0
            yield ctx.finding(
                "error" if active else "warning",
                name,
                f"the vehicle can tilt by {tilt:g} deg, but {lowest:g} deg counts as an attitude failure",
                expected=f"below {lowest:g} deg",
                why="a fast manoeuvre "
                + ("ends the flight" if active else "would end the flight without CBRK_FLIGHTTERM"),
                fix=f"set {name} {max(lowest - 15, 20):g}, or raise FD_FAIL_R and FD_FAIL_P",
                related=tuple(limits),
            )


def landing(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if the landing speed is too high, or if the motors run too long after a landing."""
    speed = ctx.value("MPC_LAND_SPEED")
    if speed is not None and speed > _MAX_LANDING_M_S:
        yield ctx.finding(
            "warning",
            "MPC_LAND_SPEED",
            f"the vehicle lands at {speed:g} m/s",
            expected=f"at most {_MAX_LANDING_M_S:g} m/s",
            why="the vehicle bounces; a descent without a position estimate also has this speed",
            fix="set MPC_LAND_SPEED 0.6",
        )
    name, delay = "COM_DISARM_LAND", ctx.value("COM_DISARM_LAND")
    if delay is not None and delay <= 0:
        yield ctx.finding(
            "warning",
            name,
            "the vehicle does not disarm after a landing",
            expected="2 s",
            why="the propellers run until the vehicle is disarmed by command; a landing is complete only when disarmed",
            fix=f"set {name} 2",
        )
    elif delay is not None and delay > _MAX_ARMED_AFTER_LANDING_S:
        yield ctx.finding(
            "note",
            name,
            f"the vehicle disarms {delay:g} s after a landing",
            expected=f"at most {_MAX_ARMED_AFTER_LANDING_S:g} s",
            why="the propellers run until then",
            fix=f"set {name} 2",
        )


def hover_thrust(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if the hover thrust is still PX4's default."""
    name, value = "MPC_THR_HOVER", ctx.value("MPC_THR_HOVER")
    if value is not None and value == ctx.default(name):
        yield ctx.finding(
            "note",
            name,
            f"the hover thrust is the default, {value:g}",
            expected="the thrust command at which this vehicle hovers",
            why="take-off and a descent without a position estimate start with this thrust",
            fix=f"set {name} to the thrust command in hover",
        )


def geofence(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if PX4's geofence is missing, is higher than the room, or causes no reaction."""
    radius, height = ctx.value("GF_MAX_HOR_DIST"), ctx.value("GF_MAX_VER_DIST")
    if current_action(ctx, "geofence") in ("none", "warn") and (radius or height):
        wanted = settings_text(ctx, "geofence", "land") or settings_text(ctx, "geofence", "hold")
        yield ctx.finding(
            "warning",
            "GF_ACTION",
            "a geofence is set, but its breach causes no reaction",
            expected=wanted,
            why="the vehicle flies on outside the geofence",
            fix=f"set {wanted}",
        )
    elif not radius and not height:
        yield ctx.finding(
            "note",
            "GF_MAX_HOR_DIST",
            "the autopilot has no geofence",
            expected="the room's size",
            why="the autopilot cannot keep the vehicle away from the walls",
            fix="set GF_MAX_HOR_DIST and GF_MAX_VER_DIST; both need a home position, which needs a global origin",
        )
    room_m = ctx.environment.height_m
    if room_m and height and height > room_m:
        yield ctx.finding(
            "note",
            "GF_MAX_VER_DIST",
            f"the geofence is higher than the room of {room_m:g} m",
            expected=f"below {room_m:g} m",
            why="the vehicle never reaches the upper limit of the geofence",
            fix=f"choose GF_MAX_VER_DIST below {room_m:g}",
        )
