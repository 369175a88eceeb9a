"""Resolved YAML text of an arena, with all defaults, for the run folder. Pure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from arena.mocap.vendors import vendor_settings
from arena.plan.firmware import Firmware, Fleet, all_firmware
from arena.schema import Arena, Vehicle
from arena.schema.arena import Program
from arena.schema.loader import dump_yaml


def arena_yaml(arena: Arena, fleet: Fleet | None = None) -> str:
    """Return the arena as YAML text in which every default is written.

    Loading this text gives the same plan.
    """
    fleet = all_firmware(arena) if fleet is None else fleet
    return f"# resolved from {Path(arena.folder) / Path(arena.file).name}\n" + dump_yaml(
        {
            "name": arena.name,
            "address": arena.address,
            "world": arena.world.as_dict(),
            "sim": arena.sim.as_dict(),
            "mocap": _mocap(arena),
            "log": arena.log.as_dict(),
            "preflight": arena.preflight.as_dict(),
            **({"px4": {"home": arena.px4.home}} if arena.px4 else {}),
            **({"copilot": arena.copilot.as_dict()} if arena.copilot else {}),
            **({"geofence": arena.geofence.slice()} if arena.geofence else {}),
            **({"beacons": dict(arena.beacons)} if arena.beacons else {}),
            "tools": {name: tool.as_dict(without_none=True) for name, tool in arena.tools.items()},
            "vehicles": {v.name: _vehicle(v, fleet[v.name]) for v in arena.vehicles},
        }
    )


def _vehicle(v: Vehicle, firmware: Firmware) -> dict[str, Any]:
    program = _program(v.program) if v.program else None
    made = {
        "id": v.id,
        "profile": v.profile_key,
        "autopilot": v.autopilot,
        **v.overrides,
        "wind_m_s": v.wind_m_s,
        **_wire(v),
        "start": {"position": v.position, "rpy_deg": v.rpy_deg},
        "port": v.ports.program,
        "gcs": v.gcs,
        "mocap_body": v.mocap_body,
        "gps": v.gps,
        "sticks": v.sticks,
        "radio": None if v.simulated else v.radio,
        "signing": {"key_file": v.key_file} if v.key_file else None,
        "measured": {name: one.as_dict() for name, one in v.measured.items()} or None,
        "forward": v.forward,
        "pose_rate_hz": v.pose_rate_hz,
        "program": program,
        "neighbours": {**v.neighbour_sensor.as_dict(), "vehicles": v.neighbours},
        "beacon_sensor": None if v.beacon_sensor is None else v.beacon_sensor.as_dict(without_none=True),
        "tools": {name: tool.as_dict(without_none=True) for name, tool in v.tools.items()},
        "px4_version": v.px4_version or None,
        "params": firmware.values,
    }
    return {key: value for key, value in made.items() if value is not None}


def _program(program: Program) -> dict[str, Any]:
    group = {"group": program.group, "run": "once" if program.once else "each"} if program.group else {}
    return {
        "path": program.path,
        "args": list(program.args),
        "restart": program.restart,
        "clock": program.clock,
        "needs": list(program.needs),
        **group,
    }


def _mocap(arena: Arena) -> dict[str, Any]:
    found = arena.mocap.as_dict(without_none=True)
    for vendor in arena.mocap.vendors:
        found |= vendor_settings(vendor).derived_keys(arena.mocap.keys, arena.address)
    return found


def _wire(v: Vehicle) -> dict[str, Any]:
    if v.wire is None:
        return {}
    baud = {"baud": v.wire.baud} if v.wire.kind == "serial" else {}
    uid = {"uid": v.uid} if v.uid else {}
    return {**uid, **({"serial": v.wire.device} if v.autopilot == "hitl" else {"url": v.wire.url}), **baud}
