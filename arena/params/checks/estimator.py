"""Rules for EKF2: it must fuse the arena's position sensors, with the right delay and noise. Pure.

The sensors are external vision, GPS or neither.

Bits of EKF2_EV_CTRL (PX4 1.14 and newer): horizontal position 1, height 2, velocity 4, yaw 8.
Bits of EKF2_AID_MASK (PX4 1.13 and older): GPS 1, vision position 8, vision yaw 16.
Sources: PX4's src/modules/ekf2; noise and delay as measured on motion capture systems.
"""

from __future__ import annotations

from collections.abc import Iterator

from arena.params.checks.findings import CheckContext, Finding

_DELAY_TOLERANCE_MS = 20.0  # an error of 0.1 m in position at 5 m/s
_MAX_VISION_NOISE_M = 0.05
_MAX_WITHOUT_AID_S = 2.0
_NO_MAGNETOMETER = (5, 6)  # none; none after the first heading (since 1.16)
_HEIGHT_SOURCES = {0: "the barometer", 1: "GPS", 2: "a range finder"}
_EV_CTRL_SINCE = 14  # EKF2_EV_CTRL replaced EKF2_AID_MASK


def estimator_runs(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if EKF2 is off, or if PX4 runs a different estimator."""
    why = "only EKF2 can use the poses that the arena sends"
    if ctx.value("EKF2_EN") == 0:
        fix = "set EKF2_EN 1, and LPE_EN and ATT_EN 0"
        yield ctx.finding("error", "EKF2_EN", "EKF2 is off", expected="1", why=why, fix=fix)
    group = ctx.value("SYS_MC_EST_GROUP")
    if group is not None and group != 2:
        problem = "an estimator other than EKF2 runs"
        yield ctx.finding(
            "error", "SYS_MC_EST_GROUP", problem, expected="2", why=why, fix="set SYS_MC_EST_GROUP 2"
        )


def vision_is_fused(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if EKF2 does not fuse the position, height or yaw of external vision."""
    if not ctx.environment.vision:
        return
    new = ctx.minor >= _EV_CTRL_SINCE
    name, position, yaw, whole = ("EKF2_EV_CTRL", 1, 8, "11") if new else ("EKF2_AID_MASK", 8, 16, "24")
    bits = ctx.bits(name)
    if not bits & position:
        yield ctx.finding(
            "error",
            name,
            f"external vision is not fused: bit {position} (position) is off",
            expected=whole,
            why="without external vision there is no position estimate indoors, and no OFFBOARD",
            fix=f"set {name} {whole}",
        )
        return
    if new and not bits & 2:
        yield ctx.finding(
            "warning",
            name,
            "the height of external vision is not fused: bit 2 is off",
            expected=f"{bits | 2}",
            why="the height comes from the barometer, which drifts by metres indoors",
            fix=f"set {name} {bits | 2}",
        )
    if not bits & yaw:
        has_magnetometer = ctx.value("EKF2_MAG_TYPE") not in _NO_MAGNETOMETER
        yield ctx.finding(
            "warning" if has_magnetometer else "error",
            name,
            f"the yaw of external vision is not fused: bit {yaw} is off",
            expected=f"{bits | yaw}",
            why="the heading comes from the magnetometer, which steel and motors disturb"
            if has_magnetometer
            else "the magnetometer is not used either, so there is no heading",
            fix=f"set {name} {bits | yaw}",
            related=("EKF2_MAG_TYPE",),
        )


def height_reference(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if EKF2's height reference is not external vision."""
    name = "EKF2_HGT_REF" if ctx.minor >= _EV_CTRL_SINCE else "EKF2_HGT_MODE"
    value = ctx.value(name)
    if ctx.environment.vision and value is not None and value != 3:
        source = next((words for mode, words in _HEIGHT_SOURCES.items() if mode == value), "unknown")
        yield ctx.finding(
            "warning",
            name,
            f"the height reference is {source}",
            expected="3 (external vision)",
            why="indoors there is no GPS, and a door or a fan shifts the barometer's height by a metre, so the floor is not at 0 m",
            fix=f"set {name} 3 (external vision)",
        )


def vision_delay(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if EKF2_EV_DELAY is not set, or differs from the arena's pose latency."""
    name, value = "EKF2_EV_DELAY", ctx.value("EKF2_EV_DELAY")
    if not ctx.environment.vision or value is None:
        return
    latency = ctx.environment.latency_ms
    why = "poses get their time stamp on arrival. A wrong delay causes oscillation and a position error: 0.01 m for each 10 ms at 1 m/s"
    if latency is not None and abs(value - latency) > _DELAY_TOLERANCE_MS:
        problem = f"differs by {abs(value - latency):g} ms from the arena's latency"
        yield ctx.finding(
            "warning", name, problem, expected=f"{latency:g} ms", why=why, fix=f"set {name} {latency:g}"
        )
    elif latency is None and value in (0, ctx.default(name)):
        unset = "0" if value == 0 else f"{value:g} ms, the default"
        yield ctx.finding(
            "warning",
            name,
            f"the delay of external vision is unset ({unset})",
            expected="the cameras' latency plus 1 ms of forwarding",
            why=why,
            fix=f"set {name} to the cameras' latency plus 1 ms of forwarding",
        )


def vision_noise(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if EKF2 assumes more noise for external vision than motion capture has."""
    name, value = "EKF2_EVP_NOISE", ctx.value("EKF2_EVP_NOISE")
    if ctx.environment.vision and value is not None and value > _MAX_VISION_NOISE_M:
        yield ctx.finding(
            "note",
            name,
            f"EKF2 assumes a noise of {value:g} m for external vision",
            expected="0.01 to 0.04 m",
            why="EKF2 never assumes less than this noise, but motion capture is accurate to millimetres",
            fix=f"choose {name} between 0.01 and 0.04",
        )


def magnetometer(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if EKF2 uses the magnetometer indoors."""
    value = ctx.value("EKF2_MAG_TYPE")
    indoors = ctx.environment.vision and not ctx.environment.gps
    if indoors and value is not None and value not in _NO_MAGNETOMETER:
        yield ctx.finding(
            "warning",
            "EKF2_MAG_TYPE",
            "the magnetometer is used indoors",
            expected="5 (none)",
            why="steel and motors turn the heading and can prevent arming; external vision gives the heading",
            fix="set EKF2_MAG_TYPE 5 (none)",
        )


def gps_is_fused(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if EKF2 fuses GPS in an arena without GPS."""
    new = ctx.minor >= _EV_CTRL_SINCE
    name = "EKF2_GPS_CTRL" if new else "EKF2_AID_MASK"
    used = ctx.bits(name) if new else ctx.bits(name) & 1
    if used and not ctx.environment.gps:
        wanted = 0 if new else ctx.bits(name) & ~1
        yield ctx.finding(
            "warning",
            name,
            "GPS is fused indoors",
            expected=f"{wanted}",
            why="a receiver that sees a satellite through a window pulls the position by metres",
            fix=f"set {name} {wanted}",
        )


def gps_is_required(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding for each preflight check that requires GPS in an arena without GPS."""
    if ctx.environment.gps:
        return
    if ctx.value("COM_ARM_WO_GPS") == 0:
        yield ctx.finding(
            "error",
            "COM_ARM_WO_GPS",
            "arming requires GPS",
            expected="1",
            why="there is no GPS indoors: the vehicle does not arm",
            fix="set COM_ARM_WO_GPS 1",
        )
    if ctx.value("SYS_HAS_GPS") == 1:
        yield ctx.finding(
            "warning",
            "SYS_HAS_GPS",
            "a GPS receiver is expected",
            expected="0",
            why="without a receiver, PX4 v1.16 never becomes ready to arm and gives no reason",
            fix="set SYS_HAS_GPS 0",
        )


def time_without_aid(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if EKF2 reports a valid position for too long after poses and GPS are lost."""
    name, value = "EKF2_NOAID_TOUT", ctx.value("EKF2_NOAID_TOUT")
    if value is not None and value * 1e-6 > _MAX_WITHOUT_AID_S:
        yield ctx.finding(
            "warning",
            name,
            f"without poses the vehicle flies on for {value * 1e-6:g} s before the failsafe",
            expected=f"at most {_MAX_WITHOUT_AID_S:g} s ({_MAX_WITHOUT_AID_S * 1e6:.0f} us)",
            why="at 1.4 m/s a vehicle crosses a room of 7 m in 5 s",
            fix=f"set {name} 1000000 (1 s)",
        )
