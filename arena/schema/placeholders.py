"""Placeholders in the arguments of programs and tools: `{mavlink_url}` becomes the vehicle's MAVLink URL.

`PLACEHOLDERS` is the table of names. The same values are environment variables: `{mavlink_url}` is `ARENA_MAVLINK_URL`. Pure.

Text rules: `{name}` with small letters, digits and `_` is a placeholder. `{{name}}` stands for the text `{name}`. All other
braces are text, such as those of JSON.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from arena.constants import OPEN_BRACE, RUN_FOLDER, RUNTIME_FOLDER
from arena.mocap.vendors import vendor_settings
from arena.schema.arena import Arena, Vehicle

VARIABLE_PREFIX = "ARENA_"
_PATTERN = re.compile(r"\{\{([a-z][a-z0-9_]*)\}\}|\{([a-z][a-z0-9_]*)\}")
_KEPT = frozenset(text[1:-1] for text in (RUN_FOLDER, RUNTIME_FOLDER, OPEN_BRACE))
# the supervisor sets ARENA_RUN itself, and `{rt}` is private to arena's own processes
_NO_VARIABLE = frozenset({"run", "rt"})


@dataclass(frozen=True, kw_only=True)
class Placeholder:
    """Placeholder such as `{mass_kg}`, with the rule that computes the value to insert for it.

    meaning: meaning of the value, with its unit, for the reference page.
    value: function that returns the value as text, for an arena and a vehicle.
    of_vehicle: whether the value belongs to one vehicle; false: to the whole arena.
    """

    meaning: str
    value: Callable[[Arena, Vehicle], str]
    of_vehicle: bool = True

    def text(self, arena: Arena, vehicle: Vehicle | None) -> str:
        """Return the value of the placeholder as text.

        vehicle: may be None for a value of the whole arena. Raises ValueError.
        """
        if vehicle is None:
            if self.of_vehicle:
                raise ValueError(
                    f"this placeholder has a value only for a vehicle, not for a tool of the whole arena: {self.meaning}"
                )
            return self.value(arena, arena.vehicles[0])
        return self.value(arena, vehicle)


def _number(value: float) -> str:
    return f"{value:.9g}"


def _flag(value: bool) -> str:
    return "true" if value else "false"


def _mocap(arena: Arena, v: Vehicle) -> dict[str, Any]:
    """Return the settings of a motion capture client for this vehicle's rigid body, or {} if no server tracks it."""
    m = arena.mocap
    if v.simulated:
        return vendor_settings(m.emulates).emulator_client_settings(m.keys, arena.address)
    return {} if m.source == "emulator" else vendor_settings(m.source).client_settings(m.keys)


def _mocap_vendor(arena: Arena, v: Vehicle) -> str:
    return str(_mocap(arena, v).get("kind", ""))


def _mocap_address(arena: Arena, v: Vehicle) -> str:
    return str(_mocap(arena, v).get("server", ""))


def _row(meaning: str, value: Callable[[Arena, Vehicle], str]) -> Placeholder:
    return Placeholder(meaning=meaning, value=value)


def _arena_row(meaning: str, value: Callable[[Arena], str]) -> Placeholder:
    return Placeholder(meaning=meaning, value=lambda a, v: value(a), of_vehicle=False)


def _speed(arena: Arena) -> str:
    return arena.sim.speed if arena.sim.speed == "max" else _number(float(arena.sim.speed))


PLACEHOLDERS: dict[str, Placeholder] = {
    "name": _row("name of the vehicle", lambda a, v: v.name),
    "ns": _row("namespace of the vehicle, for example for ROS 2: its name", lambda a, v: v.name),
    "id": _row("MAVLink system id of the vehicle (MAV_SYS_ID)", lambda a, v: str(v.id)),
    "autopilot": _row("`builtin`, `px4`, `hardware` or `hitl`", lambda a, v: v.autopilot),
    "simulated": _row(
        "`true` if the vehicle's body is simulated, else `false`", lambda a, v: _flag(v.simulated)
    ),
    "mavlink_url": _row(
        "URL of the program's MAVLink connection for pymavlink and `arena.UAV`; the program binds this address",
        lambda a, v: f"udpin:{a.address}:{v.ports.program}",
    ),
    "sdk_url": _row(
        "URL of the SDK's MAVLink connection for MAVSDK 2 and newer",
        lambda a, v: f"udpin://{a.address}:{v.ports.sdk}",
    ),
    "mavros_url": _row(
        "URL of the program's MAVLink connection for MAVROS (`fcu_url`)",
        lambda a, v: f"udp://{a.address}:{v.ports.program}@{a.address}:{v.ports.serve}",
    ),
    "tools_url": _row(
        "URL of further MAVLink connections to the vehicle, for any number of clients; the client sends first",
        lambda a, v: f"udpout:{a.address}:{v.ports.tools}",
    ),
    "port": _row("UDP port that the program binds for MAVLink", lambda a, v: str(v.ports.program)),
    "sdk_port": _row("UDP port that an SDK binds for MAVLink", lambda a, v: str(v.ports.sdk)),
    "router_port": _row(
        "UDP port of the router that exchanges messages with `port` and `sdk_port`",
        lambda a, v: str(v.ports.serve),
    ),
    "tools_port": _row("UDP port of the router for further clients", lambda a, v: str(v.ports.tools)),
    "profile": _row("name of the vehicle's profile", lambda a, v: v.profile.name),
    "mass_kg": _row("mass of the vehicle [kg]", lambda a, v: _number(v.profile.mass_kg)),
    "radius_m": _row("radius of the vehicle [m]", lambda a, v: _number(v.profile.radius_m)),
    "height_m": _row("height of the vehicle [m]", lambda a, v: _number(v.profile.height_m)),
    "num_rotors": _row("number of rotors", lambda a, v: str(len(v.profile.rotors))),
    "neighbours": _row("names of the neighbours, separated by commas", lambda a, v: ",".join(v.neighbours)),
    "body": _row("name of the vehicle's rigid body in the motion capture", lambda a, v: v.mocap_body),
    "mocap_vendor": _row("protocol of the motion capture; empty without one", _mocap_vendor),
    "mocap_address": _row("address of the motion capture server; empty without one", _mocap_address),
    "uav_file": _row(
        "JSON file with all settings of the program, which `arena.UAV` reads (option `--uav`)",
        lambda a, v: f"{RUN_FOLDER}/slices/program.{v.name}.json",
    ),
    "clock": _row(
        "path of the simulation clock without suffix; empty for a real vehicle",
        lambda a, v: f"{RUNTIME_FOLDER}/clock" if v.simulated else "",
    ),
    "arena": _arena_row("name of the arena", lambda a: a.name),
    "address": _arena_row("numeric address that the arena's processes bind", lambda a: a.address),
    "folder": _arena_row("folder of arena.yaml", lambda a: a.folder),
    "run": _arena_row("the run folder", lambda a: RUN_FOLDER),
    "rt": _arena_row("the runtime folder of the run, with its local sockets", lambda a: RUNTIME_FOLDER),
    "speed": _arena_row("simulated seconds per second, or `max`", _speed),
}


def variable(name: str) -> str:
    """Return the name of the environment variable with a placeholder's value, such as `ARENA_MASS_KG`."""
    return VARIABLE_PREFIX + name.upper()


def names_in(text: str) -> Iterator[str]:
    """Yield the names of the placeholders in a text."""
    yield from (found[2] for found in _PATTERN.finditer(text) if found[2])


def known(*, of_vehicle: bool) -> list[str]:
    """Return the names of all existing placeholders.

    of_vehicle: also those that belong to one vehicle.
    """
    return [name for name, row in PLACEHOLDERS.items() if of_vehicle or not row.of_vehicle]


def filled(text: str, arena: Arena, vehicle: Vehicle | None) -> str:
    """Replace the placeholders in a text, except `{run}` and `{rt}`, which the supervisor replaces later.

    vehicle: the vehicle of the program or tool; None for a tool of the whole arena. Raises KeyError for an unknown name.
    """

    def value(found: re.Match[str]) -> str:
        if name := found[2]:
            return PLACEHOLDERS[name].text(arena, vehicle)
        literal = found[1]
        return (OPEN_BRACE if literal in _KEPT else "{") + literal + "}"

    return _PATTERN.sub(value, text)


def variables(arena: Arena, vehicle: Vehicle | None) -> tuple[tuple[str, str], ...]:
    """Return the environment variables of a program or tool as pairs (name, value): one variable for each placeholder."""
    return tuple(
        (variable(name), PLACEHOLDERS[name].text(arena, vehicle))
        for name in known(of_vehicle=vehicle is not None)
        if name not in _NO_VARIABLE
    )
