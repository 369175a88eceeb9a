"""Checks of this computer before an arena starts: free ports, pybullet, devices, the commands of tools."""

from __future__ import annotations

import errno
import importlib.util
import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from arena.errors import InputError, NotInstalledError
from arena.plan.model import Plan
from arena.schema import Arena
from arena.schema.known_tools import requirement
from arena.schema.tools import MODULES, Tool
from arena.transport import open_udp

IN_USE = "in use"
_EVERY_ADDRESS = "0.0.0.0"
_AMENT_INDEX = "share/ament_index/resource_index/packages"
_MOST_ADDRESSES = 50
_MOST_PORTS_SHOWN = 4


class Probe(Protocol):
    """Interface through which the checks inspect a computer. Tests replace it."""

    def has_module(self, name: str) -> bool: ...

    def has_command(self, name: str, folder: str) -> bool: ...

    def has_ros_package(self, name: str) -> bool: ...

    def has_device(self, path: str) -> bool: ...

    def refusal(self, address: str, port: int) -> str:
        """Return why a UDP port cannot be bound; "" if the port is free."""
        ...

    def holder(self, address: str, port: int) -> str:
        """Return the process that has bound a UDP port, such as `pid 123 (qgroundcontrol)`; "" if unknown."""
        ...


class Machine:
    """Implementation of `Probe` that inspects the computer on which this process runs."""

    def has_module(self, name: str) -> bool:
        return importlib.util.find_spec(name) is not None

    def has_command(self, name: str, folder: str) -> bool:
        return shutil.which(name if "/" not in name else str(Path(folder) / name)) is not None

    def has_ros_package(self, name: str) -> bool:
        """Return whether a ROS 2 package is installed.

        It is searched in the ament index of all folders in AMENT_PREFIX_PATH (REP 114, ament_index).
        """
        folders = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
        return any(Path(each, _AMENT_INDEX, name).exists() for each in folders if each)

    def has_device(self, path: str) -> bool:
        return Path(path).exists()

    def refusal(self, address: str, port: int) -> str:
        try:
            open_udp((address, port)).close()
        except OSError as error:
            return IN_USE if error.errno == errno.EADDRINUSE else f"cannot be bound ({error.strerror})"
        return ""

    def holder(self, address: str, port: int) -> str:
        import psutil

        try:
            pids = {
                (c.laddr[0], c.pid)
                for c in psutil.net_connections("udp4")
                if c.laddr and c.laddr[1] == port and c.pid
            }
            exact = sorted(pid for ip, pid in pids if _EVERY_ADDRESS in (ip, address) or ip == address)
            return f"pid {exact[0]} ({psutil.Process(exact[0]).name()})" if exact else ""
        except psutil.Error:
            return ""


@dataclass(frozen=True, kw_only=True)
class AddressChoice:
    """Address that was chosen for an arena whose YAML sets no `address`, and the reason.

    address: first loopback address whose ports are free.
    why: sentence that explains why it is not the default address; "" if it is the default address.
    """

    address: str
    why: str = ""


def choose_address(plan: Plan, runs: Mapping[str, str], probe: Probe) -> AddressChoice:
    """Return the first loopback address whose ports are free: 127.0.0.1, 127.0.0.2, ...

    The search begins at the plan's address.

    plan: the plan for the default address.
    runs: address -> description of the arena that runs there.
    Raises InputError when 50 addresses are in use. Binds each port for an instant; starts nothing.
    """
    first, why = plan.address, ""
    network, _, last = first.rpartition(".")
    for number in range(int(last), int(last) + _MOST_ADDRESSES):
        address = f"{network}.{number}"
        taken = _use_of(plan, address, runs, probe)
        if not taken:
            return AddressChoice(address=address, why=f"{why}: using {address}" if why else "")
        why = why or f"{address} is in use by {taken}"
    raise InputError(
        f"{why}. The addresses {network}.{last} to {address} are all in use. Set `address` in the YAML."
    )


def _use_of(plan: Plan, address: str, runs: Mapping[str, str], probe: Probe) -> str:
    """Return which arena or process uses an address, as text; "" if the address is free."""
    if address in runs:
        return runs[address]
    for _, bound_to, port in _wanted(plan):  # what is bound to every address is not moved by another one
        if bound_to == plan.address and probe.refusal(address, port):
            return probe.holder(address, port) or f"another process (UDP port {port})"
    return ""


def check_machine(arena: Arena, plan: Plan, probe: Probe | None = None) -> None:
    """Check that this computer has everything that the arena needs, such as free ports and pybullet.

    Raises NotInstalledError if only software is missing, else InputError. The message lists every problem.
    """
    probe = probe or Machine()
    missing, taken = list(_missing(arena, probe)), list(_taken(arena, plan, probe))
    text = "\n".join(missing + taken)
    if taken:
        raise InputError(text)
    if missing:
        raise NotInstalledError(text)


def _missing(arena: Arena, probe: Probe) -> Iterator[str]:
    if arena.simulated and not probe.has_module("pybullet"):
        names = ", ".join(v.name for v in arena.simulated)
        yield f"pybullet is not installed, but {names} must be simulated. Try: pip install 'flying-arena[sim]'"
    lacking: dict[str, list[str]] = {}  # what is missing -> keys of the tools that need it
    for words, tool in _tools(arena):
        if what := _lacks(arena, tool, probe):
            lacking.setdefault(what, []).append(words)
    for what, tools in lacking.items():
        more = f" and {len(tools) - 1} more" if len(tools) > 1 else ""
        yield f"{arena.file}: {tools[0]}{more}: {what}"


def _lacks(arena: Arena, tool: Tool, probe: Probe) -> str:
    """Return what a tool needs and this computer does not have, with advice; "" if nothing is missing."""
    if tool.ros2 is not None and not probe.has_module("cyclonedds"):
        return "the package cyclonedds is missing: pip install 'flying-arena[ros2]'"
    if tool.argv[0] in MODULES:  # run by the interpreter of the arena's processes
        return ""
    needed = requirement(tool)
    how = "Install or rename it." if needed is None else needed.how
    if not probe.has_command(tool.argv[0], str(Path(arena.folder) / (tool.cwd or ""))):
        return f"the command {tool.argv[0]!r} was not found on this computer. {how}"
    if needed is not None and needed.ros_package and not probe.has_ros_package(needed.ros_package):
        return f"the ROS 2 package {needed.ros_package} was not found on this computer. {how}"
    return ""


def _tools(arena: Arena) -> Iterator[tuple[str, Tool]]:
    for name, tool in arena.tools.items():
        yield f"tools.{name}", tool
    for vehicle in arena.vehicles:
        for name, tool in vehicle.tools.items():
            yield f"vehicles.{vehicle.name}.tools.{name}", tool


def _wanted(plan: Plan) -> list[tuple[str, str, int]]:
    """Return (process name, address, port) of every UDP port that the plan's processes bind when they start."""
    return [(p.name, x.address, x.port) for p in plan.processes for x in p.listens if x.protocol == "udp"]


def _taken(arena: Arena, plan: Plan, probe: Probe) -> Iterator[str]:
    """Yield a sentence for each port that is in use, and for each serial device that does not exist."""
    held: dict[tuple[str, str], list[tuple[int, str]]] = {}
    for process, address, port in _wanted(plan):
        if why := probe.refusal(address, port):
            by = probe.holder(address, port) if why == IN_USE else ""
            held.setdefault((address, f"{why} by {by}" if by else why), []).append((port, process))
    for (address, why), ports in held.items():
        yield f"{arena.file}: {_sentence(arena, address, why, ports)}"
    for v in arena.vehicles:
        if v.wire is not None and v.wire.kind == "serial" and not probe.has_device(v.wire.device):
            device = v.wire.device
            yield f"{arena.file}: {device}, the serial device of {v.name}, does not exist. Connect the device, or correct its name."


def _sentence(arena: Arena, address: str, why: str, ports: list[tuple[int, str]]) -> str:
    numbers = sorted({port for port, _ in ports})
    names = ", ".join(dict.fromkeys(process for _, process in sorted(ports)))
    shown = ", ".join(map(str, numbers[:_MOST_PORTS_SHOWN]))
    more = f" and {len(numbers) - _MOST_PORTS_SHOWN} more" if len(numbers) > _MOST_PORTS_SHOWN else ""
    what = f"UDP port{'s' if len(numbers) > 1 else ''} {shown}{more} of {address}, for {names}, {why}"
    of_url = address != arena.address and all(process.startswith("link.") for _, process in ports)
    if not why.startswith(IN_USE):
        return (
            f"{address} {why}. Set {'the `url`' if of_url else '`address`'} to an address of this computer."
        )
    if of_url:
        return f"{what}. Set another port in the `url`."
    if address == _EVERY_ADDRESS:
        return (
            f"{what}. PX4 binds these ports on every address, so another `address` does not help. "
            "The port numbers depend on the vehicle's `id`: set another `id`."
        )
    return f"{what}. Set another `address`, such as {_next_loopback(address)}."


def _next_loopback(address: str) -> str:
    network, _, last = address.rpartition(".")
    return f"{network}.{int(last) + 1}" if address.startswith("127.") and int(last) < 254 else "127.0.0.2"
