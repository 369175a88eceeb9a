"""How a real vehicle is reached when neither its router nor its `link.<v>` carries anything. Reads files only.

The plan and the YAML tell its wire, the run folder the last address of the vehicle and who holds the wire:

    <run>/wire/<v>.json   written by link.<v>: {"kind": "udpin", "local": [host, port], "vehicle": [host, port]}
                          or {"kind": "serial", "device": "/dev/...", "baud": 57600}
"""

from __future__ import annotations

import contextlib
import json
import socket
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

Address = tuple[str, int]
BAUD = 921_600  # of a `serial:` url without a `baud`, as the schema has it


@dataclass(frozen=True, kw_only=True)
class Owner:
    """The process that holds the wire, as state.json recorded it. start_s [s since boot] completes its identity."""

    name: str
    pid: int
    start_s: float


@dataclass(frozen=True, kw_only=True)
class Wire:
    """kind udpin, udpout: local is where the vehicle is listened for, vehicle the last address it spoke from, None when unknown.
    kind serial: device, baud.  owner: the link that holds it, where a run is known.
    """

    kind: str
    local: Address | None = None
    vehicle: Address | None = None
    device: str = ""
    baud: int = 0
    owner: Owner | None = None

    @property
    def words(self) -> str:
        if self.kind == "serial":
            return f"{self.device} at {self.baud}"
        shown = (self.local if self.kind == "udpin" else self.vehicle) or ("", 0)
        return f"{self.kind} {shown[0]}:{shown[1]}"


def from_slice(raw: Mapping[str, Any]) -> Wire:
    """`wire` of a link's slice. Raises KeyError, TypeError or ValueError when it is none."""
    kind = str(raw["kind"])
    if kind == "serial":
        return Wire(kind=kind, device=str(raw["device"]), baud=int(raw["baud"]))
    address = _address(raw["address"])
    return Wire(kind=kind, local=address) if kind == "udpin" else Wire(kind=kind, vehicle=address)


def from_url(url: Any, baud: Any = None) -> Wire | None:
    """`url:` of a vehicle in a YAML; None for what is none."""
    kind, _, rest = url.partition(":") if isinstance(url, str) else ("", "", "")
    if kind == "serial" and rest:
        return Wire(kind=kind, device=rest, baud=baud if isinstance(baud, int) and baud > 0 else BAUD)
    host, _, port = rest.rpartition(":")
    if kind not in ("udpin", "udpout") or not port.isdecimal():
        return None
    try:
        address = _address((host, port))
    except ValueError:
        return None
    return Wire(kind=kind, local=address) if kind == "udpin" else Wire(kind=kind, vehicle=address)


def as_last_seen(wire: Wire, vehicle: str, run: Path) -> Wire:
    """With what the run folder knows beyond the plan: the vehicle's last address, and the process that holds the wire."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        seen = json.loads((run / "wire" / f"{vehicle}.json").read_text())
        if seen["kind"] == wire.kind and wire.kind != "serial":
            local, last = (_address(seen[key]) if seen.get(key) else None for key in ("local", "vehicle"))
            wire = replace(wire, local=local or wire.local, vehicle=last or wire.vehicle)
    return replace(wire, owner=_owner(f"link.{vehicle}", run))


def _owner(name: str, run: Path) -> Owner | None:
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        state = json.loads((run / "state.json").read_text())
        if state["boot"] == Path("/proc/sys/kernel/random/boot_id").read_text().strip():
            member = state["processes"][name]
            return Owner(name=name, pid=int(member["pid"]), start_s=float(member["start_s"]))
    return None


def _address(raw: Any) -> Address:
    """Raises ValueError for what no socket takes: a port that is none, a name, which a dead network would be asked for."""
    host, port = raw
    found = str(host), int(port)
    try:
        socket.inet_aton(found[0])
    except OSError as error:
        raise ValueError(f"{host!r} is no address") from error
    if not 0 <= found[1] <= 65535:
        raise ValueError(f"{port} is no port")
    return found
