"""The checks of `arena doctor`: Python, packages, PX4, ports, runs, PX4 lock files, serial devices.

The checks change nothing.
"""

from __future__ import annotations

import fcntl
import importlib.metadata
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from arena.constants import PX4_HOME
from arena.errors import NotInstalledError
from arena.kernels import INTERPRETED
from arena.plan.machine import Machine, Probe
from arena.schema.models import ArenaFile, VehicleKeys
from arena.schema.ports import GROUND_STATION, LINK_BASE, PORTS, vehicle_ports
from arena.schema.px4 import need_px4
from arena.supervisor import active_runs

LEAST_PYTHON = (3, 11)
# package -> (purpose, true if arenas with the built-in autopilot fly without it)
PACKAGES: dict[str, tuple[str, bool]] = {
    "numpy": ("every part of arena", False),
    "pydantic": ("reading the YAML", False),
    "pymavlink": ("MAVLink", False),
    "fastcrc": ("MAVLink", False),
    "psutil": ("information about processes", False),
    "jinja2": ("PX4's startup scripts", False),
    "serial": ("flight controllers on a serial port: pip install pyserial", True),
    "pybullet": ("the simulated world: pip install 'flying-arena[sim]'", False),
    "matplotlib": ("plots of campaigns", True),
    "plotly": ("the report of a run", True),
    "mavsdk": ("programs that use MAVSDK: pip install 'flying-arena[sdk]'", True),
}
_VEHICLES = 10  # of the default arena
DEVICES = Path("/dev")
PX4_LOCKS = Path("/tmp")
"""Folder of PX4's lock files. PX4 always uses /tmp and ignores TMPDIR."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Result of one check of `arena doctor`, printed as one line.

    sign: `ok`, `missing` or `note`.  what: text of the line.  fatal: no arena can fly before this is fixed.
    """

    sign: str
    what: str
    fatal: bool = False

    def __str__(self) -> str:
        return f"{self.sign:8}{self.what}"


def examine(
    probe: Probe | None = None, locks: Path = PX4_LOCKS, devices: Path = DEVICES
) -> Iterator[Finding]:
    """Yield the result of each check of `arena doctor`.

    probe: access to packages and ports of this computer.  locks: folder of PX4's lock files.  devices: folder of devices.
    """
    probe = probe or Machine()
    yield from _python()
    yield from _packages(probe)
    yield _kernels()
    yield _px4()
    yield from _ports(probe)
    yield from _runs()
    yield from _locks(locks)
    yield from _serial(devices)


def _python() -> Iterator[Finding]:
    found, least = ".".join(map(str, sys.version_info[:3])), ".".join(map(str, LEAST_PYTHON))
    fits = sys.version_info >= LEAST_PYTHON
    why = "" if fits else f": arena needs {least} or newer"
    yield Finding(
        sign="ok" if fits else "missing", what=f"Python {found} ({sys.executable}){why}", fatal=not fits
    )


def _packages(probe: Probe) -> Iterator[Finding]:
    for name, (purpose, optional) in PACKAGES.items():
        if probe.has_module(name):
            yield Finding(sign="ok", what=f"{name} {_version(name)}".rstrip())
        else:
            sign, what = "note" if optional else "missing", f"{name} is not installed; used for {purpose}"
            yield Finding(sign=sign, what=what, fatal=not optional)


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _kernels() -> Finding:
    if INTERPRETED:
        return Finding(sign="note", what=INTERPRETED)
    return Finding(sign="ok", what="the formulas of the simulation are compiled")


def _px4() -> Finding:
    """Check which PX4 an arena would use by default on this computer, and return the result.

    The YAML of an arena can name a different PX4.
    """
    try:
        px4 = need_px4()
    except NotInstalledError as error:
        return Finding(sign="note", what=f"{error}")
    said = f"{px4.words}, by {px4.source}: {' '.join(px4.argv)}"
    if px4.stand_in:
        return Finding(sign="note", what=f"{said} (unset {PX4_HOME} to fly the real one)")
    return Finding(sign="ok", what=said)


def _ports(probe: Probe) -> Iterator[Finding]:
    """Check whether the default UDP ports of an arena with ten vehicles are free."""
    defaults = ArenaFile(vehicles={"uav1": VehicleKeys()})
    address = defaults.address
    wanted = {
        LINK_BASE: "the router",
        defaults.mocap.command_port: "the motion capture",
        GROUND_STATION: "a ground station",
    }
    for vehicle_id in range(1, _VEHICLES + 1):
        ports = vehicle_ports(vehicle_id)
        wanted |= {
            getattr(ports, port.key): f"{port.owner}, vehicle {vehicle_id}"
            for port in PORTS
            if hasattr(ports, port.key) and port.protocol == "udp"
        }
    taken = [(port, who) for port, who in wanted.items() if probe.refusal(address, port)]
    for port, who in taken:
        holder = probe.holder(address, port)
        yield Finding(
            sign="note",
            what=f"UDP port {port} of {address} ({who}) is in use{f' by {holder}' if holder else ''}",
        )
    if not taken:
        yield Finding(sign="ok", what=f"every UDP port of {_VEHICLES} vehicles on {address} is free")


def _serial(folder: Path) -> Iterator[Finding]:
    """Check that the user may open each serial device of this computer. Yield one result per device."""
    for device in sorted((*folder.glob("ttyACM*"), *folder.glob("ttyUSB*"))):
        if os.access(device, os.R_OK | os.W_OK):
            yield Finding(sign="ok", what=f"{device}: serial device, possibly a flight controller")
        else:
            yield Finding(
                sign="note",
                what=f"{device}: no permission to open it; add the user to its group ({device.group()})",
            )


def _runs() -> Iterator[Finding]:
    for run in active_runs():
        if run.live:
            yield Finding(
                sign="note",
                what=f"{run.name} is running on {run.address} (supervisor {run.supervisor.pid}, {run.run})",
            )
        else:
            left = ", ".join(run.survivors())
            what = f"still running: {left}" if left else "no process left"
            yield Finding(
                sign="note",
                what=f"stale run {run.run} on {run.address} ({what}): "
                f"clean it up with `arena down --run {run.run}`",
            )


def _locks(folder: Path) -> Iterator[Finding]:
    """Yield a note for each PX4 SITL instance whose lock file shows that it is running.

    A second PX4 with the same instance number cannot start.
    """
    for lock in sorted(folder.glob("px4_lock-*")):
        number = lock.name.partition("-")[2]
        try:
            with lock.open("rb") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except PermissionError:
            yield Finding(
                sign="note", what=f"{lock} belongs to another user: PX4 instance {number} will not start"
            )
        except OSError:
            yield Finding(sign="note", what=f"PX4 instance {number} is running ({lock} is held)")
