"""Required PX4 parameters of each vehicle. In this module, `firmware` means these parameters. Pure.

`arena params`, the preflight check of hardware, the start of PX4 SITL and the built-in autopilots all use these functions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from arena.errors import InputError
from arena.geomagnetism import magnetic_field
from arena.params.checks.check import check_written
from arena.params.checks.diff import changes_by_itself, exclusion_reason
from arena.params.checks.findings import Finding
from arena.params.facts.parameter_table import Version
from arena.params.generation.generate import generate
from arena.params.generation.lines import Line
from arena.params.generation.requirements import (
    ACTION_ONLY_EVENTS,
    Failsafe,
    FenceCylinder,
    Requirements,
    Rotor,
)
from arena.schema import Arena, Origin, Vehicle
from arena.schema.failsafe import Failsafe as FailsafeKeys
from arena.schema.loader import YamlPath

Fleet = Mapping[str, "Firmware"]
"""Vehicle name -> the PX4 parameters that the vehicle must have."""

SIMULATED_VERSION = "1.16"
"""PX4 version whose parameter names are used for the built-in autopilot, and for vehicles whose version is unknown."""
FORWARDING_MS = 1.0


@dataclass(frozen=True, kw_only=True)
class Firmware:
    """The PX4 parameters that one vehicle must have.

    In arena's code, `firmware` means these parameters, not PX4's program.

    version: PX4 version whose parameter names are used.
    lines: one entry per parameter, with its value and reason.
    not_possible: one sentence per requirement for which this version has no parameter.
    replaced: parameters whose value in the `params_file` is not used.
    """

    version: str
    lines: tuple[Line, ...]
    not_possible: tuple[str, ...]
    replaced: tuple[str, ...] = ()

    @property
    def values(self) -> dict[str, float]:
        """Return the required parameters as {name: value}."""
        return {line.name: float(line.value) for line in self.lines}


def all_firmware(arena: Arena) -> dict[str, Firmware]:
    """Return {vehicle name: PX4 parameters that the plan uses for the vehicle}.

    With `preflight.params: false`, hardware has only the parameters that the user wrote (see `_checked`).
    Raises InputError for a PX4 version that is not in the parameter table.
    """
    return {v.name: _checked(arena, v, firmware(arena, v)) for v in arena.vehicles}


def firmware(arena: Arena, vehicle: Vehicle, version: str = "") -> Firmware:
    """Return the PX4 parameters that a vehicle must have, each with its value and reason.

    version: PX4 version to use instead of the vehicle's own; "" for the vehicle's own.
    Raises InputError for a PX4 version that is not in the parameter table.
    """
    version = px4_version(vehicle, version)
    made = generate(_for_autopilot(requirements(arena, vehicle), vehicle.autopilot), version)
    return Firmware(version=version, lines=made.lines, not_possible=made.not_possible, replaced=made.replaced)


def origins(arena: Arena) -> dict[str, Origin]:
    """Return the PX4 version and the required parameters of all vehicles, and where each value comes from.

    The keys are `vehicles.NAME.px4_version` and `vehicles.NAME.params.PARAMETER`.
    """
    found: dict[str, Origin] = {}
    for name, each in all_firmware(arena).items():
        key = f"vehicles.{name}.px4_version"
        found[key] = Origin(value=each.version, source=arena.origins[key].source)
        for line in each.lines:
            found[f"vehicles.{name}.params.{line.name}"] = Origin(value=line.value, source=line.reason)
    return found


class WrittenParamFinding(NamedTuple):
    """A problem of a parameter that the user has written in the YAML or in a `params_file`.

    place: where the user wrote it, `arena.yaml:7` or the name of the `params_file`.
    """

    vehicle: str
    place: str
    finding: Finding


def written_param_findings(arena: Arena) -> list[WrittenParamFinding]:
    """Return the problems of all parameters that the user has written, in the order of the vehicles.

    The user writes parameters under `params` and in `params_file`.

    Finds unknown, renamed and removed parameters (with the most similar name), wrong types, and values outside PX4's limits.
    Raises InputError for a PX4 version that is not in the parameter table.
    """
    return [
        WrittenParamFinding(v.name, arena.origins[f"vehicles.{v.name}.params.{finding.name}"].source, finding)
        for v in arena.vehicles
        for finding in check_written(v.own_params, px4_version(v))
    ]


def px4_version(vehicle: Vehicle | None, asked: str = "") -> str:
    """Return the PX4 version whose parameter names apply to a vehicle.

    This is the version `asked` if given, else the vehicle's `px4_version` in the YAML, else 1.16.

    Raises InputError if `asked` or the version in the YAML is not in the parameter table. For a PX4 binary whose version is
    not in the table, the result is 1.16.
    """
    if asked:
        return str(Version.parse(asked))
    if vehicle is None or not vehicle.px4_version:
        return SIMULATED_VERSION
    try:
        return str(Version.parse(vehicle.px4_version))
    except InputError:
        if vehicle.autopilot != "px4":
            raise
        return SIMULATED_VERSION


def requirements(arena: Arena, v: Vehicle) -> Requirements:
    """Return what the YAML requires of one vehicle's PX4, such as failsafe actions, with the reasons.

    `generate` converts the requirements to parameters of a PX4 version.
    """
    rotors = tuple(
        Rotor(x_m=r.position_m[0], y_m=r.position_m[1], spin=1 if r.direction == "ccw" else -1)
        for r in v.profile.rotors
    )
    return Requirements(
        system_id=v.id,
        simulated=v.simulated,
        hover=v.profile.hover_command,
        gps=v.gps,
        declination_deg=_declination_deg(arena, v),
        sticks=v.has_rc,
        joystick=v.simulated,
        vision_delay_ms=arena.mocap.latency_ms + FORWARDING_MS if v.forward else None,
        failsafe=requirements_failsafe(arena.failsafe, has_sticks=v.has_rc),
        landing_speed_m_s=arena.landing_speed_m_s,
        ceiling_m=arena.world.size[2],
        fence=_fence(arena, v),
        rotors=rotors,
        moment_ratio_m=v.profile.moment_ratio_m,
        gains=dict(v.profile.params),
        own=_own_values(arena, v),
        measured=frozenset(v.measured),
        from_file=frozenset(_names_of_file(arena, v)),
        written=frozenset(_written(arena)),
        reasons=_reasons(arena, v),
    )


def left_out_names(arena: Arena, v: Vehicle) -> list[str]:
    """Return the parameters of the vehicle's `params_file` that are left out.

    Counters are left out always, because PX4 changes them by itself. Calibrations are left out if several vehicles use the file,
    because they were measured on one vehicle.
    """
    own = arena.source.given(("vehicles", v.name, "params_file")) and arena.source.range_of(v.name) is None
    left_out = changes_by_itself if own else exclusion_reason
    return [name for name in _names_of_file(arena, v) if left_out(name)]


def _names_of_file(arena: Arena, v: Vehicle) -> list[str]:
    """Return the names of the parameters that get their value from the vehicle's `params_file`."""
    file = arena.origins[f"vehicles.{v.name}.params_file"].value
    if file is None:
        return []
    return [name for name in v.own_params if arena.origins[f"vehicles.{v.name}.params.{name}"].source == file]


def _own_values(arena: Arena, v: Vehicle) -> dict[str, float]:
    left_out = left_out_names(arena, v)
    return {name: value for name, value in v.own_params.items() if name not in left_out}


def _declination_deg(arena: Arena, v: Vehicle) -> float | None:
    """Return the declination of the simulated magnetic field [deg], or None if PX4 uses no magnetometer.

    PX4 uses no magnetometer if a pose forwarder sends it poses, because it takes the heading from the poses.
    """
    if not v.simulated or not v.gps or v.forward:
        return None
    at = arena.world.origin
    return math.degrees(magnetic_field(at.lat_deg, at.lon_deg, at.alt_m).declination_rad)


def _for_autopilot(required: Requirements, autopilot: str) -> Requirements:
    """Return the requirements of an autopilot. The built-in autopilot needs no rotor geometry and no RC mapping.

    The built-in autopilot has no parameters for both, because it reads them from the vehicle's profile.
    """
    return replace(required, rotors=(), channels=0) if autopilot == "builtin" else required


def unmeasured(arena: Arena, vehicle: Vehicle, version: str = "") -> dict[str, float]:
    """Return the parameters of a real vehicle that the user has not yet measured or set, such as gains.

    arena does not write them, because its own values are those of the simulated body.

    Return parameter name -> value of the simulated body, for comparison; {} for a simulated vehicle.
    version: as in `firmware`.
    """
    if vehicle.simulated:
        return {}
    version, real = px4_version(vehicle, version), requirements(arena, vehicle)
    simulated = generate(replace(real, simulated=True, rotors=(), channels=0), version).values
    own = generate(real, version).values
    return {name: float(value) for name, value in simulated.items() if name not in own}


def _checked(arena: Arena, v: Vehicle, required: Firmware) -> Firmware:
    """Return the required parameters that the preflight check compares with those of the autopilot.

    For hardware with `preflight.params: false`, only the parameters that the user wrote are left. `arena params` still uses
    all required parameters. The resolved YAML contains the result as the user's parameters, so it gives the same plan.
    """
    if v.autopilot == "hardware" and not arena.preflight.params:
        return replace(required, lines=tuple(line for line in required.lines if line.name in v.own_params))
    return required


def replaced_text(names: Sequence[str]) -> str:
    """Return a text that names the values of a `params_file` that are not used."""
    return f"not used from the params_file, because the YAML or a failsafe needs other values: {', '.join(names)}"


def _written(arena: Arena) -> dict[str, YamlPath]:
    """Return the requirements that the user has written, such as `failsafe.low_battery`, with their places in the YAML."""
    failsafes = [("failsafe", key) for key in type(arena.failsafe).model_fields]
    paths: list[YamlPath] = [*failsafes, ("landing_speed_m_s",), ("geofence",)]
    found = {".".join(map(str, path)): path for path in paths if arena.source.given(path)}
    if any(key.startswith("failsafe.") for key in found):
        found["failsafe"] = ("failsafe",)
    if "geofence" in found or arena.source.given(("world", "size")):
        found["ceiling_m"] = ("geofence",) if "geofence" in found else ("world", "size")
    return found


def _reasons(arena: Arena, v: Vehicle) -> dict[str, str]:
    profile, source = f"profile {v.profile.name}", arena.source
    found = {
        "gains": profile,
        "rotors": profile,
        "system_id": "rule: id",
        "hover": f"thrust curve of {profile}",
        "ceiling_m": "below the ceiling: 0.6 of the room's height",
        "vision": "arena's default with motion capture",
        "vision_delay_ms": "mocap.latency_ms + 1 ms of forwarding",
        "declination_deg": "world.origin, by the World Magnetic Model",
    }
    for key, given in (("gps", v.gps), ("sticks", v.sticks)):
        found[key] = f"{key}: true" if given else "arena's default"
    if not v.simulated:
        found["sticks"] = f"radio: {v.radio} ({arena.origins[f'vehicles.{v.name}.radio'].source})"
    found |= {key: source.origin(path) for key, path in _written(arena).items() if key != "ceiling_m"}
    if arena.geofence is not None:
        found["ceiling_m"] = "below the ceiling: 0.6 of the height of room or fence, whichever is lower"
    own = {name: arena.origins[f"vehicles.{v.name}.params.{name}"].source for name in v.own_params}
    own |= {name: f"measured {one.date}, {one.how} ({own[name]})" for name, one in v.measured.items()}
    return found | {f"own.{name}": reason for name, reason in own.items()}


def _fence(arena: Arena, v: Vehicle) -> FenceCylinder | None:
    """Return the smallest cylinder around the vehicle's start position that contains the whole geofence.

    The start position of hardware is not known. The largest cylinder is used: that of a start in a corner.
    """
    fence = arena.geofence
    if fence is None:
        return None
    n, e, d = v.position if v.autopilot != "hardware" else (fence.north[0], fence.east[0], 0.0)
    height = fence.up + d - v.profile.ground_clearance_m
    return FenceCylinder(radius_m=fence.farthest(n, e), height_m=height)


def requirements_failsafe(given: FailsafeKeys, *, has_sticks: bool) -> Failsafe:
    """Return the required failsafe actions of a vehicle's PX4, from the section `failsafe` of the YAML.

    has_sticks: whether the vehicle has an RC transmitter.
    """
    return Failsafe(
        offboard_loss=given.offboard_loss.action,
        offboard_loss_after_s=given.offboard_loss.after_s,
        position_loss=given.position_loss.action,
        position_loss_after_s=given.position_loss.after_s,
        low_battery_warn=given.low_battery.warn,
        low_battery_land=given.low_battery.land,
        rc_loss=given.rc_loss.action or ("land" if has_sticks else "none"),
        data_link_loss=given.data_link_loss.action,
        data_link_loss_after_s=given.data_link_loss.after_s,
        actions={
            event: getattr(given, event).action
            for event in ACTION_ONLY_EVENTS
            if event in type(given).model_fields
        },
        attitude=given.attitude.action if "attitude" in given.model_fields_set else None,
        attitude_above_deg=given.attitude.above_deg,
    )
