"""Does the estimator fly by what the arena has: external vision, satellites or none? Pure.

Bits of EKF2_EV_CTRL (from 1.14): horizontal position 1, height 2, velocity 4, yaw 8. Of EKF2_AID_MASK (up to 1.13): satellites 1,
vision's position 8, its yaw 16. Read in PX4's src/modules/ekf2; the figures of noise and delay are those of camera systems.
"""

from __future__ import annotations

from collections.abc import Iterator

from arena.params.checks.findings import Finding, Look

_MOST_AMISS_MS = 20.0  # a tenth of a metre at 5 m/s
_MOST_NOISE_M = 0.05
_LONGEST_BLIND_S = 2.0
_NO_MAG = (5, 6)  # none; none after the first heading (since 1.16)
_HEIGHTS = ((0, "the barometer"), (1, "satellites"), (2, "a range finder"))
_NEW = 14  # EKF2_EV_CTRL in EKF2_AID_MASK's place


def estimator_runs(look: Look) -> Iterator[Finding]:
    why = "EKF2 alone takes external vision as this arena sends it"
    if look.value("EKF2_EN") == 0:
        yield look.finding("error", "EKF2_EN", "EKF2 is off", why, "set EKF2_EN 1, and LPE_EN and ATT_EN 0")
    group = look.value("SYS_MC_EST_GROUP")
    if group is not None and group != 2:
        yield look.finding(
            "error", "SYS_MC_EST_GROUP", "another estimator than EKF2 runs", why, "set SYS_MC_EST_GROUP 2"
        )


def vision_is_fused(look: Look) -> Iterator[Finding]:
    if not look.room.vision:
        return
    name = "EKF2_EV_CTRL" if look.minor >= _NEW else "EKF2_AID_MASK"
    position, yaw = (1, 8) if look.minor >= _NEW else (8, 16)
    bits = look.bits(name)
    whole = "11" if look.minor >= _NEW else "24"
    if not bits & position:
        yield look.finding(
            "error",
            name,
            "external vision is not fused: the position's bit is off",
            "without it there is no position in a room, and no offboard",
            f"set {name} {whole}",
        )
        return
    if look.minor >= _NEW and not bits & 2:
        yield look.finding(
            "warning",
            name,
            "the height of external vision is not fused: bit 2 is off",
            "the height comes from the barometer, which drifts by metres in a room",
            f"set {name} {bits | 2}",
        )
    if not bits & yaw:
        mag = look.value("EKF2_MAG_TYPE") not in _NO_MAG
        yield look.finding(
            "warning" if mag else "error",
            name,
            f"the yaw of external vision is not fused: bit {yaw} is off",
            "the heading comes from the magnetometer, which steel and motors turn"
            if mag
            else "no magnetometer is used either, so that there is no heading",
            f"set {name} {bits | yaw}",
            "EKF2_MAG_TYPE",
        )


def height_reference(look: Look) -> Iterator[Finding]:
    name = "EKF2_HGT_REF" if look.minor >= _NEW else "EKF2_HGT_MODE"
    value = look.value(name)
    source = next((words for number, words in _HEIGHTS if number == value), "an unknown source")
    if look.room.vision and value != 3:
        yield look.finding(
            "warning",
            name,
            f"the height refers to {source}",
            "a door or a fan moves the barometer by a metre, and there are no satellites indoors: the floor is"
            " not at zero",
            f"set {name} 3 (external vision)",
        )


def vision_delay(look: Look) -> Iterator[Finding]:
    name, value = "EKF2_EV_DELAY", look.value("EKF2_EV_DELAY")
    if not look.room.vision or value is None:
        return
    wanted = look.room.latency_ms
    right = (
        "to the cameras' latency and what forwarding takes, some 1 ms" if wanted is None else f"{wanted:g}"
    )
    fix = f"set {name} {right}"
    why = "poses are stamped on arrival: at 1 m/s, 100 ms too much or too little are 0.1 m of position, and oscillation"
    if wanted is not None and abs(value - wanted) > _MOST_AMISS_MS:
        yield look.finding(
            "warning", name, f"is {abs(value - wanted):g} ms from the arena's {wanted:g} ms", why, fix
        )
    elif wanted is None and value in (0, look.default(name)):
        unset = "0" if value == 0 else f"{value:g} ms, the default"
        yield look.finding("warning", name, f"the delay of external vision is unset ({unset})", why, fix)


def vision_noise(look: Look) -> Iterator[Finding]:
    name, value = "EKF2_EVP_NOISE", look.value("EKF2_EVP_NOISE")
    if look.room.vision and value is not None and value > _MOST_NOISE_M:
        yield look.finding(
            "note",
            name,
            f"external vision counts as {value:g} m inaccurate",
            "it is a floor under what the message says; cameras are good to millimetres",
            f"set {name} between 0.01 and 0.04",
        )


def magnetometer(look: Look) -> Iterator[Finding]:
    value = look.value("EKF2_MAG_TYPE")
    if look.room.vision and not look.room.gps and value is not None and value not in _NO_MAG:
        yield look.finding(
            "warning",
            "EKF2_MAG_TYPE",
            "the magnetometer is used in a room",
            "steel and motors turn the heading, and refuse arming; external vision gives it",
            "set EKF2_MAG_TYPE 5 (none)",
        )


def satellites_fused(look: Look) -> Iterator[Finding]:
    name = "EKF2_GPS_CTRL" if look.minor >= _NEW else "EKF2_AID_MASK"
    used = look.bits(name) if look.minor >= _NEW else look.bits(name) & 1
    if used and not look.room.gps:
        yield look.finding(
            "warning",
            name,
            "satellites are fused in a room",
            "what a receiver sees through a window pulls the position metres away",
            f"set {name} {0 if look.minor >= _NEW else look.bits(name) & ~1}",
        )


def satellites_required(look: Look) -> Iterator[Finding]:
    if look.room.gps:
        return
    if look.value("COM_ARM_WO_GPS") == 0:
        yield look.finding(
            "error",
            "COM_ARM_WO_GPS",
            "arming asks for satellites",
            "there are none in the room: it does not arm",
            "set COM_ARM_WO_GPS 1",
        )
    if look.value("SYS_HAS_GPS") == 1:
        yield look.finding(
            "warning",
            "SYS_HAS_GPS",
            "a receiver of satellites is expected",
            "PX4 v1.16 without one was never ready, and gave no reason",
            "set SYS_HAS_GPS 0",
        )


def blind_time(look: Look) -> Iterator[Finding]:
    name, value = "EKF2_NOAID_TOUT", look.value("EKF2_NOAID_TOUT")
    if value is not None and value * 1e-6 > _LONGEST_BLIND_S:
        yield look.finding(
            "warning",
            name,
            f"without a pose it flies on blind for {value * 1e-6:g} s",
            "5 s are the length of a room at 1.4 m/s",
            f"set {name} 1000000 (1 s)",
        )
