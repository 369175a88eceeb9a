"""Generation of PX4 parameters from an arena's requirements, for one PX4 version. Pure.

`Generated.not_possible` lists requirements for which a version has no parameter. The module `failsafes` makes the parameters of
failsafes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from arena.constants import GRAVITY_M_S2
from arena.params.facts.failsafe_table import rc_input_mode
from arena.params.facts.parameter_table import Version
from arena.params.generation.failsafes import failsafe_lines
from arena.params.generation.lines import Line, LineWriter
from arena.params.generation.requirements import Requirements

RETURN_SHARE = 0.6
"""Altitude to which AUTO.RTL climbs, divided by the ceiling's height [-]."""
VISION_NOISE_M, VISION_NOISE_RAD = 0.01, 0.05
"""Smallest noise that EKF2 assumes for poses, even if their covariance is smaller."""

_EV_CTRL = 15  # position 1, height 2, velocity 4, yaw 8
_AID_MASK = 8 | 16  # vision position and yaw, up to 1.13
_HEIGHT_FROM_VISION = 3  # EKF2_HGT_REF, EKF2_HGT_MODE
_NO_MAGNETOMETER = 5  # EKF2_MAG_TYPE
_TAKEOFF_M = 2.5  # default of MIS_TAKEOFF_ALT
_RETURN_ALTITUDES = {"RTL_RETURN_ALT": 30.0, "RTL_DESCEND_ALT": 10.0}  # most [m], where the room is higher
# velocity gains became accelerations in 1.11: old = new * hover thrust / g
_OLD_VELOCITY_GAINS = {
    f"MPC_{axis}_VEL_{term}_ACC": f"MPC_{axis}_VEL_{term}" for axis in ("XY", "Z") for term in "PID"
}


class Generated(NamedTuple):
    """The generated parameters of one vehicle, and the requirements that PX4 cannot meet.

    lines: one per parameter, with value and reason.
    not_possible: one sentence per requirement for which this version has no parameter.
    replaced: parameters whose value in a parameter file is not used, because the YAML or a failsafe needs another value.
    """

    lines: tuple[Line, ...]
    not_possible: tuple[str, ...]
    replaced: tuple[str, ...] = ()

    @property
    def values(self) -> dict[str, float]:
        """Return the generated parameters as {name: value}."""
        return {line.name: line.value for line in self.lines}


def generate(required: Requirements, version: Version | str) -> Generated:
    """Return the PX4 parameters with which a vehicle meets the requirements in this PX4 version.

    Parameters that the user sets replace generated parameters of the same name. But a parameter file does not replace a requirement
    that the user has written, such as a failsafe action.
    Raises InputError for a version that is not in the table.
    """
    writer = LineWriter(required, Version.of(version))
    lines: dict[str, Line] = {}
    for part in (_vision, _sensors, failsafe_lines, _geofence, _landing, _vehicle, _own):
        for line in part(writer):
            lines[line.name] = line
    replaced = (name for name in required.from_file if _is_replaced(writer, name))
    differing = sorted(name for name in replaced if lines[name].value != required.own[name])
    return Generated(tuple(lines.values()), tuple(writer.not_possible), tuple(differing))


def contradictions(required: Requirements, version: Version | str) -> dict[str, tuple[float, str]]:
    """Return the user's parameters that contradict a failsafe that the user has also written.

    The result is {name: (value that the failsafe needs, key of the failsafe, such as `failsafe.offboard_loss`)}. Values of a parameter
    file are not included, because such a file does not replace a failsafe.
    Raises InputError for a version that is not in the table.
    """
    writer = LineWriter(required, Version.of(version))
    needed = {line.name: line.value for line in failsafe_lines(writer)}
    found = {}
    for name in required.own.keys() & needed.keys() - required.from_file:
        key = writer.requirement_of[name]
        is_written = key.startswith("failsafe.") and key in required.written
        if is_written and not math.isclose(required.own[name], needed[name], rel_tol=1e-6):
            found[name] = needed[name], key
    return found


def _vision(w: LineWriter) -> Iterator[Line]:
    delay_ms = w.required.vision_delay_ms
    if delay_ms is None:
        return
    if "EKF2_EV_CTRL" in w.known:
        yield w.line("EKF2_EV_CTRL", _EV_CTRL, "fuse position, height, velocity and yaw of poses", "vision")
        yield w.line("EKF2_GPS_CTRL", 0, "no GPS", "vision")
    else:
        yield w.line("EKF2_AID_MASK", _AID_MASK, "fuse position and yaw of poses; no GPS", "vision")
    height = "EKF2_HGT_REF" if "EKF2_HGT_REF" in w.known else "EKF2_HGT_MODE"
    yield w.line(height, _HEIGHT_FROM_VISION, "height comes from poses", "vision")
    yield w.line("EKF2_MAG_TYPE", _NO_MAGNETOMETER, "no magnetometer: heading comes from poses", "vision")
    if not w.required.simulated:
        return
    yield w.line("EKF2_EVP_NOISE", VISION_NOISE_M, "smallest position noise assumed for poses [m]", "vision")
    yield w.line(
        "EKF2_EVA_NOISE", VISION_NOISE_RAD, "smallest attitude noise assumed for poses [rad]", "vision"
    )
    yield w.line("EKF2_EV_DELAY", delay_ms, "age of a pose on arrival [ms]", "vision_delay_ms")


def _sensors(w: LineWriter) -> Iterator[Line]:
    gps, rc = w.required.gps, w.required.sticks
    if "SYS_HAS_GPS" in w.known:
        yield w.line("SYS_HAS_GPS", int(gps), "a GPS receiver" if gps else "no GPS receiver", "gps")
    elif not gps:
        yield w.line("COM_ARM_WO_GPS", 1, "arming without GPS is allowed", "gps")
    if w.required.declination_deg is not None:
        declination = round(w.required.declination_deg, 2)
        yield w.line(
            "EKF2_MAG_DECL",
            declination,
            "declination of the simulated magnetic field [deg]",
            "declination_deg",
        )
    source, meaning = ("radio", "by RC") if rc else ("joystick", "by joystick only")
    if not (rc or w.required.joystick):
        source, meaning = "none", ""
    yield w.line(
        "COM_RC_IN_MODE",
        rc_input_mode(source, w.version),
        f"manual control {meaning}" if meaning else "no manual control",
        "sticks",
    )
    if rc and w.required.channels and w.required.simulated:
        yield w.line("RC_CHAN_CNT", w.required.channels, "RC channels", "sticks")
        for channel, axis in enumerate(("ROLL", "PITCH", "THROTTLE", "YAW"), 1):
            yield w.line(f"RC_MAP_{axis}", channel, f"RC channel of {axis.lower()}", "sticks")


def _geofence(w: LineWriter) -> Iterator[Line]:
    """Yield the parameters of PX4's geofence: a cylinder that contains the whole box of the YAML.

    PX4 has no geofence in the shape of a box.
    """
    fence = w.required.fence
    if fence is None:
        return
    if w.required.vision_delay_ms is None and not w.required.gps:
        w.not_possible.append(
            "geofence: not set, because without poses and GPS the vehicle has no home position"
        )
        return
    radius = math.ceil(fence.radius_m * 1e3 - 1e-6) / 1e3
    yield w.line(
        "GF_MAX_HOR_DIST", radius, "from home to the farthest corner of the geofence [m]", "geofence"
    )
    height = round(fence.height_m, 3)
    yield w.line("GF_MAX_VER_DIST", height, "from home to the top of the geofence [m]", "geofence")
    if not w.required.simulated and "GF_SOURCE" in w.known:
        w.needed.add("GF_SOURCE")
        yield w.line("GF_SOURCE", 0, "the geofence uses the estimated position, not GPS", "geofence")
    if fence.height_m <= _TAKEOFF_M:
        altitude = round(RETURN_SHARE * fence.height_m, 2)
        yield w.line("MIS_TAKEOFF_ALT", altitude, "AUTO.TAKEOFF stays inside the geofence [m]", "geofence")


def _landing(w: LineWriter) -> Iterator[Line]:
    required = w.required
    ceiling = min(required.ceiling_m, required.fence.height_m if required.fence else math.inf)
    altitude = round(RETURN_SHARE * ceiling, 2)
    meanings = {
        "RTL_RETURN_ALT": "AUTO.RTL stays below the ceiling [m]",
        "RTL_DESCEND_ALT": "height at which AUTO.RTL waits before it lands [m]",
    }
    for name, most in _RETURN_ALTITUDES.items():
        value = w.within_limits(name, min(altitude, most), f"ceiling_m: {ceiling:g} m")
        yield w.line(name, value, meanings[name], "ceiling_m")
    if required.simulated:
        yield w.line("MPC_TKO_RAMP_T", 1.0, "time to reach full thrust at take-off [s]", "takeoff")
    if required.landing_speed_m_s is not None:
        speed = w.within_limits("MPC_LAND_SPEED", required.landing_speed_m_s, "landing_speed_m_s")
        yield w.line("MPC_LAND_SPEED", speed, "landing speed [m/s]", "landing_speed_m_s")


def _vehicle(w: LineWriter) -> Iterator[Line]:
    required = w.required
    yield w.line("MAV_SYS_ID", required.system_id, "MAVLink system id", "system_id")
    if not required.simulated:
        return
    yield w.line("MPC_THR_HOVER", required.hover, "thrust command in hover [-]", "hover")
    for name, value in required.gains.items():
        old = _OLD_VELOCITY_GAINS.get(name)
        if name in w.known:
            yield w.line(name, value, "gain of the profile", "gains")
        elif old in w.known:
            converted = value * required.hover / GRAVITY_M_S2
            yield w.line(str(old), converted, f"gain of the profile, converted from {name}", "gains")
        else:
            w.not_possible.append(f"gains: PX4 {w.version} has no {name} ({value:g})")
    if not required.rotors:
        return
    if "CA_ROTOR_COUNT" not in w.known:
        w.not_possible.append(
            f"geometry: PX4 {w.version} reads the rotor geometry from a mixer file, not from parameters"
        )
        return
    yield w.line("CA_ROTOR_COUNT", len(required.rotors), "number of rotors", "rotors")
    for k, rotor in enumerate(required.rotors):
        moment = rotor.spin * required.moment_ratio_m
        yield w.line(f"CA_ROTOR{k}_PX", rotor.x_m, f"rotor {k + 1}: forward [m]", "rotors")
        yield w.line(f"CA_ROTOR{k}_PY", rotor.y_m, f"rotor {k + 1}: right [m]", "rotors")
        yield w.line(f"CA_ROTOR{k}_KM", moment, f"rotor {k + 1}: reaction torque per thrust [m]", "rotors")


def _own(w: LineWriter) -> Iterator[Line]:
    required = w.required
    for name, value in required.own.items():
        if _is_replaced(w, name):
            continue
        if name not in w.known:
            w.not_possible.append(f"params: PX4 {w.version} has no {name}")
        meaning = "this vehicle's own value" if name in required.measured else "as written"
        yield w.line(name, value, meaning, f"own.{name}")


def _is_replaced(w: LineWriter, name: str) -> bool:
    """Return whether the value of a parameter in the `params_file` is not used: the YAML or a failsafe sets the parameter."""
    needed = name in w.needed or w.requirement_of.get(name) in w.required.written
    return needed and name in w.required.from_file
