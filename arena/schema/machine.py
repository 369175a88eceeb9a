"""What this machine must have before an arena starts: free ports, pybullet, the tools' commands. The probe is injected."""

from __future__ import annotations

import errno
import importlib.util
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from arena.errors import InputError, NotInstalledError
from arena.mocap.vendors import vendor_settings
from arena.schema.arena import Arena
from arena.schema.models import Tool
from arena.schema.ports import COPILOT, LINK_BASE, WHAT
from arena.transport import open_udp

# ports of the rule table that no process of a running arena binds: another program may hold them rightly
_FOREIGN = ("sdk", "panic_land_all", "simulator")


class Probe(Protocol):
    """The machine, as far as the check looks at it."""

    def has_module(self, name: str) -> bool: ...

    def has_command(self, name: str, folder: str) -> bool: ...

    def has_device(self, path: str) -> bool: ...

    def refusal(self, address: str, port: int) -> str:
        """Why this UDP port cannot be bound: "" when it can be."""
        ...

    def holder(self, address: str, port: int) -> str:
        """Who holds it: `pid 123 (qgroundcontrol)`, or "" when that cannot be told."""
        ...


class Machine:
    """This computer."""

    def has_module(self, name: str) -> bool:
        return importlib.util.find_spec(name) is not None

    def has_command(self, name: str, folder: str) -> bool:
        return shutil.which(name if "/" not in name else str(Path(folder) / name)) is not None

    def has_device(self, path: str) -> bool:
        return Path(path).exists()

    def refusal(self, address: str, port: int) -> str:
        try:
            open_udp((address, port)).close()
        except OSError as error:
            return "is in use" if error.errno == errno.EADDRINUSE else f"cannot be bound ({error.strerror})"
        return ""

    def holder(self, address: str, port: int) -> str:
        import psutil

        try:
            pids = {
                (c.laddr[0], c.pid)
                for c in psutil.net_connections("udp4")
                if c.laddr and c.laddr[1] == port and c.pid
            }
            exact = sorted(pid for ip, pid in pids if ip in (address, "0.0.0.0"))
            return f"pid {exact[0]} ({psutil.Process(exact[0]).name()})" if exact else ""
        except psutil.Error:
            return ""


def check_machine(arena: Arena, probe: Probe | None = None) -> None:
    """Raises NotInstalledError when only software is missing, else InputError; either names everything that was found."""
    probe = probe or Machine()
    missing, taken = list(_missing(arena, probe)), list(_taken(arena, probe))
    text = "\n".join(missing + taken)
    if taken:
        raise InputError(text)
    if missing:
        raise NotInstalledError(text)


def _missing(arena: Arena, probe: Probe) -> Iterator[str]:
    if arena.simulated and not probe.has_module("pybullet"):
        names = ", ".join(v.name for v in arena.simulated)
        yield f"pybullet is not installed, and {names} would be simulated. Try: pip install 'flying-arena[sim]'"
    for words, tool in _tools(arena):
        folder = str(Path(arena.folder) / (tool.cwd or ""))
        if not probe.has_command(tool.argv[0], folder):
            yield f"{arena.file}: {words}.argv: the command {tool.argv[0]!r} is not on this machine. Install it."


def _tools(arena: Arena) -> Iterator[tuple[str, Tool]]:
    for name, tool in arena.tools.items():
        yield f"tools.{name}", tool
    for vehicle in arena.vehicles:
        for name, tool in vehicle.tools.items():
            yield f"vehicles.{vehicle.name}.tools.{name}", tool


def _taken(arena: Arena, probe: Probe) -> Iterator[str]:
    for address, port, words in _wanted(arena):
        if why := probe.refusal(address, port):
            by = probe.holder(address, port) if why == "is in use" else ""
            held = f"{why} by {by}" if by else why
            wanted = f"UDP port {port} of {address}, for {words}"
            what_to_do = (
                "or give the arena another `address`" if address == arena.address else "or change the `url`"
            )
            yield f"{arena.file}: {wanted}, {held}. End that, {what_to_do}."
    for v in arena.vehicles:
        if v.wire is not None and v.wire.kind == "serial" and not probe.has_device(v.wire.device):
            yield f"{arena.file}: {v.wire.device}, the serial device of {v.name}, is not there. Plug it in, or change its name."


def _wanted(arena: Arena) -> Iterator[tuple[str, int, str]]:
    yield arena.address, LINK_BASE, "the router's ground stations"
    if arena.copilot is not None:
        yield arena.address, COPILOT, "the copilot"
    if arena.simulated:
        settings = vendor_settings(arena.mocap.emulates)
        server = settings.server_settings(arena.mocap.keys, arena.address)
        for used in settings.server_sockets(server):
            if used.port:
                yield used.address, used.port, f"the motion capture ({used.what})"
    for vehicle in arena.vehicles:
        for key, (who, what) in WHAT.items():
            if key not in _FOREIGN:
                yield arena.address, getattr(vehicle.ports, key), f"{who} of {vehicle.name} ({what})"
        if vehicle.wire is not None and vehicle.wire.kind == "udpin":
            yield vehicle.wire.host, vehicle.wire.port, f"the wire of {vehicle.name}"
