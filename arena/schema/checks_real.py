"""Cross-checks for real devices: hardware vehicles, flight controllers in the loop, motion capture. Pure."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from arena.errors import Problem
from arena.mocap.vendors import VENDORS
from arena.schema.arena import Vehicle
from arena.schema.checking import Check
from arena.schema.library import profile_names
from arena.schema.loader import YamlPath
from arena.transport import EXPECTED_URL, parse_url

# Load of a serial connection: about 245 bytes per ODOMETRY with covariances; for hitl also 250 HIL_SENSOR of 76 bytes per second.
_POSE_BYTES, _HIL_BYTES_S, _BITS = 245, 250 * 76, 10
_USUAL_BAUD = (57_600, 115_200, 230_400, 460_800, 921_600, 1_500_000, 3_000_000)


def _wires(c: Check) -> Iterator[Problem]:
    """Check that hardware vehicles have `url` and hitl vehicles have `serial`.

    Connection keys that a vehicle cannot use are refused.
    """
    for v in c.arena.vehicles:
        keys = {"hardware": "url", "hitl": "serial"}
        wanted = keys.get(v.autopilot)
        for key in ("url", "serial", "baud", "uid"):
            given = c.source.given(("vehicles", v.name, key))
            if given and key != wanted and not (key in ("baud", "uid") and wanted):
                other = {
                    "url": "hardware",
                    "serial": "hitl",
                    "baud": "hardware or hitl",
                    "uid": "hardware or hitl",
                }[key]
                yield c.problem(
                    v.name,
                    (key,),
                    f"is for autopilot: {other}, but {v.name} has autopilot: {v.asked}. Remove `{key}` or change `autopilot`.",
                )
        if wanted is None or not c.sound(v, wanted, "autopilot"):
            continue
        if v.wire is None:
            yield from _no_wire(c, v, wanted)
        elif v.wire.kind == "serial":
            yield from _baud(c, v, v.wire.baud)


def _no_wire(c: Check, v: Vehicle, key: str) -> Iterator[Problem]:
    path: YamlPath = ("vehicles", v.name, key)
    expected = EXPECTED_URL if key == "url" else "the flight controller's serial device, such as /dev/ttyACM0"
    if not c.source.given(path):
        yield c.problem(v.name, ("autopilot",), f"got {v.asked}, which needs `{key}`: {expected}.")
        return
    got = c.source.value(path)
    try:
        parse_url(str(got))
    except ValueError as error:
        expected = str(error)
    yield c.source.problem(path, f"got {got!r}, expected {expected}.")


def _baud(c: Check, v: Vehicle, baud: int) -> Iterator[Problem]:
    """Check that the serial baud rate is high enough for the poses and, with hitl, for the sensor values.

    At a lower rate, these messages would arrive too late.
    """
    needed = _POSE_BYTES * v.pose_rate_hz if v.forward else 0.0
    needed = _BITS * (needed + (_HIL_BYTES_S if v.autopilot == "hitl" else 0.0))
    if baud < needed:
        what = f"{v.pose_rate_hz:g} poses a second" + (
            " and simulated sensors" if v.autopilot == "hitl" else ""
        )
        best = next((b for b in _USUAL_BAUD if b >= needed), _USUAL_BAUD[-1])
        less = " or a lower pose_rate_hz" if v.autopilot == "hardware" else ""
        yield c.problem(
            v.name, ("baud",), f"got {baud}, but {what} need at least {needed:.0f}. Try {best}{less}."
        )


def _shared_wires(c: Check) -> Iterator[Problem]:
    for a, b in itertools.combinations([v for v in c.arena.vehicles if v.wire is not None], 2):
        assert a.wire is not None and b.wire is not None
        same_device = a.wire.kind == "serial" and a.wire.device == b.wire.device
        same_port = (
            a.wire.kind == b.wire.kind == "udpin"
            and a.wire.port == b.wire.port
            and (a.wire.host == b.wire.host or "0.0.0.0" in (a.wire.host, b.wire.host))
        )
        same_vehicle = a.wire.kind == b.wire.kind == "udpout" and (a.wire.host, a.wire.port) == (
            b.wire.host,
            b.wire.port,
        )
        if same_device or same_port or same_vehicle:
            key = "serial" if b.autopilot == "hitl" else "url"
            said = f"got {b.wire}, which is also the connection of {a.name}. Give each vehicle its own connection."
            yield c.problem(b.name, (key,), said)


def _profiles(c: Check) -> Iterator[Problem]:
    """Check that hardware vehicles have the key `profile`.

    The default profile has the mass and thrust of another vehicle type.
    """
    for v in c.arena.hardware:
        if not c.source.given(c.where(v.name, "profile")) and c.sound(v, "autopilot", "profile"):
            said = (
                f"got hardware, which needs `profile`: the mass, size and thrust of this vehicle. Write {', '.join(profile_names())}, "
                "or the path of a profile of your own (docs/howto/add-a-vehicle.md says how to make one)."
            )
            yield c.problem(v.name, ("autopilot",), said)


def _hardware_only(c: Check) -> Iterator[Problem]:
    """Check the keys `radio`, `measured` and `signing`, which are for hardware vehicles only.

    A parameter must not have different values in `measured` and in `params`.
    """
    for v in c.arena.vehicles:
        for key in ("radio", "measured", "signing"):
            if c.source.given(("vehicles", v.name, key)) and v.simulated and c.sound(v, "autopilot"):
                said = f"is for autopilot: hardware, but {v.name} has autopilot: {v.asked}. Remove the key."
                yield c.problem(v.name, (key,), said)
        for name, one in v.measured.items():
            if v.own_params[name] != one.value:
                said = f"got {one.value:g} from {one.date}, but `params` has {v.own_params[name]:g}. Remove one of them."
                yield c.problem(v.name, ("measured", name), said)


def _restarted_programs(c: Check) -> Iterator[Problem]:
    """Refuse `restart: always` for programs of hardware vehicles.

    Such a program would fly again without a person.
    """
    for v in c.arena.hardware:
        if v.program is not None and v.program.restart == "always" and c.sound(v, "program"):
            said = "got always, but a program of a real vehicle must not take off again by itself. Use never or on_failure."
            yield c.problem(v.name, ("program", "restart"), said)


def _shared_uids(c: Check) -> Iterator[Problem]:
    """Check that no two vehicles have the same hardware uid."""
    known = [v for v in c.arena.vehicles if v.uid not in ("", "none")]
    for a, b in itertools.combinations(known, 2):
        if a.uid == b.uid:
            yield c.problem(
                b.name,
                ("uid",),
                f"got {b.uid}, which is also the uid of {a.name}. Each autopilot has its own.",
            )


def _speed(c: Check) -> Iterator[Problem]:
    """Refuse a `sim.speed` other than 1 if a vehicle has a real flight controller.

    Flight controllers run in real time only.
    """
    real = [v for v in c.arena.vehicles if v.wire is not None or v.autopilot in ("hardware", "hitl")]
    if real and c.arena.sim.speed != 1.0 and ("sim", "speed") not in c.pruned:
        said = f"got {c.arena.sim.speed}, but {real[0].name} has autopilot: {real[0].autopilot}, which runs in real time only. Try 1."
        yield c.source.problem(("sim", "speed"), said)


def _capture(c: Check) -> Iterator[Problem]:
    """Check `mocap.source`: simulated vehicles need the emulator, real vehicles need a vendor's system."""
    mocap, hardware = c.arena.mocap, c.arena.hardware
    if ("mocap", "source") in c.pruned:
        return
    if mocap.source == "emulator":
        for key in ("server", "local"):
            if getattr(mocap, key) is not None:
                said = f"is for a vendor's server, but the source is the emulator. Set mocap.source: {mocap.emulates}, or remove the key."
                yield c.source.problem(("mocap", key), said)
        for v in (v for v in hardware if v.forward and v.wire is not None):
            said = f"got hardware, which the emulator cannot see. Set mocap.source: {mocap.emulates} and mocap.server."
            yield c.problem(
                v.name, ("autopilot",), f"{said} If the vehicle needs no pose, set forward: false instead."
            )
    elif mocap.source not in VENDORS:
        return
    elif mocap.server is None and ("mocap", "server") not in c.pruned:
        said = (
            f"got {mocap.source}, which needs `server`: the numeric address of the motion capture's computer."
        )
        yield c.source.problem(("mocap", "source"), said)
    elif not hardware:
        said = f"got {mocap.source}, which cannot see simulated vehicles, and every vehicle is simulated. Use emulator."
        yield c.source.problem(("mocap", "source"), said)


REAL = (_wires, _shared_wires, _shared_uids, _profiles, _hardware_only, _restarted_programs, _speed, _capture)
