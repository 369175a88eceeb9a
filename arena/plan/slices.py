"""Makes the configuration file (slice, JSON) that each process reads when it starts. Pure.

docs/reference/slices.md lists the keys.
"""

from __future__ import annotations

import math

from arena.mocap.vendors import vendor_settings
from arena.params.facts.failsafe_table import rc_priority_modes
from arena.plan.job import Address, Job, Json, autopilot_ends, link_of, partner_end
from arena.plan.px4_startup import hitl_params, px4_params, px4_scripts, reset_by_startup, xrce_environment
from arena.schema import Arena, Vehicle
from arena.schema.address_text import address_text
from arena.schema.ports import COPILOT, GROUND_STATION, LINK_BASE, RECORDER, SENSORS
from arena.vehicle_models import VEHICLE_MODELS

CLOCK, TRUTH, PATHS = "{rt}/clock", "{rt}/truth", "{rt}/paths"
POSE_STALE_S = 0.1


def world(job: Job) -> Json:
    """Return the configuration (slice) of the world, the process that simulates the vehicles."""
    arena = job.arena
    w, s = arena.world, arena.sim
    return {
        "name": "world",
        "address": arena.address,
        "seed": w.seed,
        "size_m": list(w.size),
        "ceiling": w.ceiling,
        "obstacles": [o.slice() for o in arena.obstacles],
        "heading_deg": w.heading_deg,
        "origin": _origin(arena),
        "physics_hz": s.physics_hz,
        "sensor_hz": s.sensor_hz,
        "speed": s.speed,
        "gui": s.gui,
        "clock": CLOCK,
        "truth": TRUTH,
        "faults": _faults(arena, "world"),
        "wind_m_s": list(w.wind_m_s),
        "gusts_m_s": w.gusts_m_s,
        "downwash": w.downwash,
        "ulog": "{run}/ulog" if arena.log.ulog else None,
        "vehicles": [_body(job, v) for v in arena.simulated],
    }


def _body(job: Job, v: Vehicle) -> Json:
    arena = job.arena
    if v.autopilot != "builtin":
        flown: Json = {
            "autopilot": "px4",
            "simulator": [arena.address, v.ports.simulator],
            "gps": v.gps,
            "sticks": v.sticks,
            "lockstep": v.autopilot == "px4",
        }
    else:
        flown = {
            "autopilot": "builtin",
            "params": job.fleet[v.name].values,
            "links": autopilot_ends(arena, v),
            "sticks": v.sticks,
        }
    return {
        "name": v.name,
        "id": v.id,
        "profile": v.profile.slice(),
        "position": list(v.position),
        "rpy": [math.radians(a) for a in v.rpy_deg],
        "wind_m_s": None if v.wind_m_s is None else list(v.wind_m_s),
        **flown,
    }


def _origin(arena: Arena) -> Json:
    return arena.world.origin.as_dict()


def px4(job: Job) -> Json:
    """Return the configuration (slice) of the process that runs a vehicle's PX4 SITL."""
    arena, v = job.arena, job.v
    if arena.px4 is None:
        raise ValueError(
            f"{v.name} needs PX4 SITL, but no PX4 was found. Set PX4_HOME to PX4's build folder."
        )
    params = px4_params(v, job.firmware.values)
    given: Json = {
        "vehicle": v.name,
        "id": v.id,
        "simulator": [arena.address, v.ports.simulator],
        **autopilot_ends(arena, v),
        "again": reset_by_startup(params, arena.px4.version),
    }
    return {
        "name": f"px4.{v.name}",
        "vehicle": v.name,
        "argv": list(arena.px4.argv),
        "data": arena.px4.data,
        "instance": v.id - 1,
        "version": arena.px4.version,
        "stand_in": arena.px4.stand_in,
        "folder": f"{{run}}/px4/{v.name}",
        "model": VEHICLE_MODELS[v.profile.vehicle_class].px4_sim_model,
        "links": autopilot_ends(arena, v),
        "clock": CLOCK,
        "params": params,
        "scripts": px4_scripts(given),
        "env": xrce_environment(arena, v),
    }


def mocap(job: Job) -> Json:
    """Return the configuration (slice) of the motion capture emulator."""
    arena = job.arena
    m = arena.mocap
    bodies = [{"name": v.mocap_body, "number": v.id, "index": i} for i, v in enumerate(arena.simulated)]
    return {
        "name": "mocap",
        **vendor_settings(m.emulates).server_settings(m.keys, arena.address),
        "rate_hz": m.rate_hz,
        "noise": _noise(arena),
        "latency_ms": m.latency_ms,
        "seed": m.seed,
        "clock": CLOCK,
        "truth": TRUTH,
        "bodies": bodies,
        "faults": _faults(arena, "mocap"),
    }


def _faults(arena: Arena, room: str) -> str | None:
    """Return the path of the socket for fault injection, or None in an arena with real vehicles.

    room: name of the process that opens the socket.
    """
    return None if arena.hardware else f"{{rt}}/{room}.faults"


def _noise(arena: Arena) -> Json:
    n = arena.mocap.noise
    return {"position_m": n.position_mm / 1000.0, "rotation_deg": n.rotation_deg}


def link(job: Job) -> Json:
    """Return the configuration (slice) of `link.<vehicle>`, the process with the connection to a flight controller."""
    arena, v = job.arena, job.v
    if v.wire is None:
        raise ValueError(
            f"cannot make the configuration of a link process: {v.name} has no connection to a real flight controller"
        )
    if v.wire.kind == "serial":
        wire: Json = {"kind": "serial", "device": v.wire.device, "baud": v.wire.baud}
    else:
        wire = {"kind": v.wire.kind, "address": [v.wire.host, v.wire.port]}
    p = arena.preflight
    return {
        "name": f"link.{v.name}",
        "vehicle": v.name,
        "id": v.id,
        "uid": v.uid,
        "wire": wire,
        "links": autopilot_ends(arena, v),
        "simulator": [arena.address, v.ports.simulator] if v.simulated else None,
        "preflight": {
            "position_m": p.position_m,
            "yaw_deg": p.yaw_deg,
            "tilt_deg": p.tilt_deg,
            "imu": not v.simulated,
            "pose_age_s": p.pose_age_s,
            "pose_rate_hz": v.pose_rate_hz,
            "battery": p.battery,
            "size_m": list(arena.world.size),
            "poses": v.forward,
            "axes_check": not v.simulated and v.forward and p.axes_check == "required",
            "radio": list(rc_priority_modes(job.firmware.version)) if v.radio == "required" else None,
            # for hardware, the lab chooses the rigid body's origin; it is not below the vehicle's lowest point
            "height_m": v.profile.height_m / 2.0 if v.simulated else 0.0,
        },
        "params": hitl_params(v, job.firmware.values) if v.simulated else job.firmware.values,
        "params_file": f"{{run}}/params/{v.name}.params",
        "wire_file": f"{{run}}/wire/{v.name}.json",
        "key_file": v.key_file,
        "body": v.mocap_body,
        "capture": None if v.simulated or not v.forward else capture(arena, None, simulated=False),
        "missing_reboots": {"folder": str(arena.folder), "address": address_text(arena, v)},
        "axes_file": "" if v.simulated else f"{arena.folder}/preflight/{v.name}.json",
        "simulated": v.simulated,
    }


def capture(arena: Arena, bodies: list[str] | None, *, simulated: bool) -> Json | None:
    """Return the settings of a motion-capture receiver; None for real vehicles if the only source is the emulator.

    bodies: names of the rigid bodies to receive; None for all.
    simulated: true for simulated vehicles (emulator), false for hardware (the vendor's server).
    """
    m = arena.mocap
    if simulated:
        found = vendor_settings(m.emulates).emulator_client_settings(m.keys, arena.address)
    elif m.source == "emulator":
        return None
    else:
        found = vendor_settings(m.source).client_settings(m.keys)
    return {**found, "bodies": bodies}


def clock(v: Vehicle) -> str | None:
    """Return the path of the simulation clock of a simulated vehicle; None for a real vehicle, which uses the wall clock."""
    return CLOCK if v.simulated else None


def forward(job: Job) -> Json:
    """Return the configuration (slice) of a vehicle's pose forwarder."""
    arena, v = job.arena, job.v
    return {
        "name": f"forward.{v.name}",
        "vehicle": v.name,
        "id": v.id,
        "body": v.mocap_body,
        "capture": capture(arena, [v.mocap_body], simulated=v.simulated),
        "frame_rate_hz": arena.mocap.rate_hz,
        "rate_hz": v.pose_rate_hz,
        "stale_s": POSE_STALE_S,
        "noise": _noise(arena),
        "origin": _origin(arena),
        "origin_alt_m": arena.world.origin.alt_m if v.autopilot == "builtin" else 0.0,
        "link": partner_end(link_of(arena, v, "vision")),
        "clock": clock(v),
        "simulated": v.simulated,
    }


def router(job: Job) -> Json:
    """Return the configuration (slice) of the MAVLink router."""
    arena = job.arena
    stations = list(dict.fromkeys(a for v in arena.vehicles for a in v.gcs))
    gcs = [{"name": "gcs", "address": [arena.address, GROUND_STATION]}]
    gcs += [{"name": f"gcs@{a}", "address": [a, GROUND_STATION]} for a in stations]
    return {
        "name": "router",
        "vehicles": [_routed(arena, v) for v in arena.vehicles],
        "gcs_local": [arena.address, LINK_BASE],
        "gcs": gcs,
        "recorder": recorder_address(arena),
        "sensors": [arena.address, SENSORS],
        "heartbeat": True,
        "simulated": not arena.hardware,
        "faults": _faults(arena, "router"),
        "clock": None if arena.hardware else CLOCK,
        "seed": arena.world.seed,
    }


def _routed(arena: Arena, v: Vehicle) -> Json:
    here, ports = arena.address, v.ports
    clients = [
        {"name": "program", "address": [here, ports.program]},
        {"name": "sdk", "address": [here, ports.sdk]},
    ]
    for station in v.gcs:
        clients.append({"name": f"program@{station}", "address": [station, ports.program]})
        clients.append({"name": f"sdk@{station}", "address": [station, ports.sdk]})
    return {
        "name": v.name,
        "id": v.id,
        "simulated": v.simulated,
        "needs_operator": _needs_operator(arena, v),
        "radio": v.radio == "required",
        "link": partner_end(link_of(arena, v, "router")),
        "ground": partner_end(link_of(arena, v, "ground")) if v.has_ground_link else None,
        "serve": [here, ports.serve],
        "clients": clients,
        "tools": [here, ports.tools],
        "sensors": [here, ports.sensors_router] if v.has_sensors else None,
    }


def _needs_operator(arena: Arena, v: Vehicle) -> bool:
    """Return whether the router sends heartbeats to this vehicle only while an operator is present.

    True for real vehicles that may have a data-link failsafe, because a heartbeat without an operator would prevent this
    failsafe.

    If the parameters of the vehicle are not checked (`--allow-diff`), it may have this failsafe.
    """
    configured = arena.failsafe.data_link_loss.action != "none"
    return not v.simulated and (configured or not arena.preflight.params)


def recorder(job: Job) -> Json:
    """Return the configuration (slice) of the recorder."""
    arena = job.arena
    found = (
        (simulated, capture(arena, None, simulated=simulated))
        for simulated in (True, False)
        if any(v.simulated is simulated for v in arena.vehicles)
    )
    return {
        "name": "recorder",
        "arena": arena.name,
        "size_m": list(arena.world.size),
        "fence": None if arena.geofence is None else arena.geofence.slice(),
        "obstacles": [o.slice() for o in arena.obstacles],
        "vehicles": [_recorded(arena, v) for v in arena.vehicles],
        "listen": recorder_address(arena),
        "captures": [{**settings, "simulated": simulated} for simulated, settings in found if settings],
        "truth": TRUTH if arena.simulated else None,
        "rate_hz": arena.log.rate_hz,
        # simulation time, or Unix time as soon as one vehicle is real
        "clock": None if arena.hardware else CLOCK,
        "folder": "{run}",
        "paths": PATHS,
        "foxglove": None if arena.foxglove is None else list(arena.foxglove),
    }


def _recorded(arena: Arena, v: Vehicle) -> Json:
    return {
        "name": v.name,
        "id": v.id,
        "body": v.mocap_body,
        "index": arena.simulated.index(v) if v.simulated else None,
        "autopilot": v.autopilot,
        "profile": v.profile.name,
        "shape": {
            "rotors_m": [list(rotor.position_m) for rotor in v.profile.rotors],
            "radius_m": v.profile.radius_m,
            "height_m": v.profile.height_m,
            "rotor_radius_m": v.profile.rotor_radius_m,
        },
        "serve": [arena.address, v.ports.serve],
        "tools": [arena.address, v.ports.tools],
    }


def recorder_address(arena: Arena) -> Address:
    """Return the UDP address of the recorder.

    The router sends it copies of all messages, and programs send it their references.
    """
    return [arena.address, RECORDER]


def heartbeat_address(arena: Arena) -> Address | None:
    """Return the copilot's UDP address for the heartbeats of programs, or None without a copilot."""
    return [arena.address, COPILOT] if arena.copilot is not None else None
