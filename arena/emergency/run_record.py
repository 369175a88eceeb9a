"""Reader of a run folder for land-all and kill-all: crashes, last addresses, and link processes of vehicles.

The module also writes the commands of land-all and kill-all to the run folder.

<run>/events.jsonl    crashes of simulated vehicles, and states of processes
<run>/wire/<v>.json   written by link.<v>: {"kind": "udpin", "local": [host, port], "vehicle": [host, port]}
                      or {"kind": "serial", "device": "/dev/...", "baud": 57600}; "uid" is the hardware uid
<run>/state.json      process ids and start times, written by the supervisor
<run>/emergency.jsonl commands of land-all and kill-all, written by this module for the programs of the run
"""

from __future__ import annotations

import contextlib
import ipaddress
import json
import os
import re
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from arena.transport import Address, ConnectionUrl

_ENDED = ("EXITED", "FATAL")
_LAST_EVENTS_BYTES = 1 << 18
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


@dataclass(frozen=True, kw_only=True)
class ProcessIdentity:
    """Identity of a process, as recorded in state.json.

    The start time start_s [s since boot] distinguishes the process from a later process with the same pid.

    owner: id of the user who wrote state.json; None if unknown. A process of another user is not killed.
    """

    name: str
    pid: int
    start_s: float
    owner: int | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class DirectAddress:
    """Address of a real vehicle, to which land-all can connect without the router and the link process.

    connection: URL from the plan or the YAML
    local: UDP address to which the link process was bound; None for any
    vehicle: UDP address of the vehicle; None if unknown
    uid: hardware uid of the vehicle's autopilot, in hexadecimal digits; "" if unknown
    key_file: file with the key of MAVLink signing; "" if the vehicle does not sign
    link_process: the process that holds the connection; None if unknown
    run: run folder; None if unknown
    """

    connection: ConnectionUrl
    local: Address | None = None
    vehicle: Address | None = None
    uid: str = ""
    key_file: str = ""
    link_process: ProcessIdentity | None = None
    run: Path | None = field(default=None, compare=False)

    @classmethod
    def of(cls, connection: ConnectionUrl) -> DirectAddress:
        """Return the address of a vehicle as far as its connection URL contains it.

        `with_run_record` adds what the run folder has recorded.
        """
        if connection.kind == "udpin":
            return cls(connection=connection, local=connection.address)
        if connection.kind == "udpout":
            return cls(connection=connection, vehicle=connection.address)
        return cls(connection=connection)


def with_run_record(direct: DirectAddress, vehicle: str, run: Path) -> DirectAddress:
    """Return the address of a vehicle, completed with the data in the run folder.

    These are the vehicle's last address, its hardware uid, and the identity of its link process.
    """
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        seen = json.loads((run / "wire" / f"{vehicle}.json").read_text())
        if seen["kind"] == direct.connection.kind and seen["kind"] != "serial":
            local, last = (_address(seen[key]) if seen.get(key) else None for key in ("local", "vehicle"))
            direct = replace(direct, local=local or direct.local, vehicle=last or direct.vehicle)
    uid = _recorded_uid(vehicle, run) or direct.uid
    return replace(direct, uid=uid, link_process=recorded_process(f"link.{vehicle}", run), run=run)


def recorded_process(name: str, run: Path) -> ProcessIdentity | None:
    """Return the identity of a process of the run from state.json; None if it is not recorded.

    name: name of the process, or "supervisor"
    """
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        file = run / "state.json"
        state, owner = json.loads(file.read_text()), file.stat().st_uid
        if state["boot"] == _BOOT_ID.read_text().strip():
            member = state["supervisor"] if name == "supervisor" else state["processes"][name]
            pid, start_s = int(member["pid"]), float(member["start_s"])
            return ProcessIdentity(name=name, pid=pid, start_s=start_s, owner=owner)
    return None


def has_given_up(name: str, run: Path) -> bool:
    """Return whether the supervisor has recorded that it will not restart a process.

    Reads the end of events.jsonl only.
    """
    last = ""
    for event in _events(run / "events.jsonl", last_bytes=_LAST_EVENTS_BYTES):
        if event.get("process") == name and "to" in event:
            last = str(event["to"])
    return last in _ENDED


def recorded_down(run: Path, vehicles: Iterable[str]) -> dict[str, str]:
    """Return vehicle name -> reason, for the vehicles that have crashed or whose PX4 has ended."""
    found: dict[str, str] = {}
    names = set(vehicles)
    for event in _events(run / "events.jsonl"):
        process, words = str(event.get("process")), str(event.get("event", ""))
        name, crashed, reason = words.partition(" crashed: ")
        if process == "world" and crashed and name in names:
            found[name] = f"crashed: {reason}"
        vehicle = process.removeprefix("px4.")
        if vehicle != process and vehicle in names and "to" in event:
            _apply_state(found, vehicle, str(event["to"]), str(event.get("reason", "")))
    return found


def record_command(run: Path, command: str, vehicles: Iterable[str], at: float | None = None) -> str:
    """Record in the run folder that land-all or kill-all has commanded vehicles. Return why this failed, or "".

    Programs can then report why they lost their vehicle. The supervisor latches the landing in processes that have missed it.

    Never raises OSError.

    at: time before the first command, monotonic [s]; None for now.
    """
    mono = time.monotonic() if at is None else at
    line = json.dumps({"mono": mono, "command": command, "vehicles": list(vehicles)})
    data = f"\n{line}\n".encode()  # the last line of the file may be incomplete
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:  # no link and no pipe: the run may belong to another user
        file = os.open(run / "emergency.jsonl", flags, 0o644)
        try:
            return "" if os.write(file, data) == len(data) else "only a part could be written"
        finally:
            os.close(file)
    except OSError as error:
        return error.strerror or str(error)


def _apply_state(found: dict[str, str], vehicle: str, state: str, reason: str) -> None:
    """Add a vehicle to the table of vehicles on the floor if its PX4 has ended; remove it if its PX4 is ready again.

    found: the table: vehicle -> reason why the vehicle is on the floor
    state: new state of the process, such as READY or EXITED
    """
    if state in _ENDED:
        found.setdefault(vehicle, f"its PX4 has ended: {reason}")
    elif state == "READY":
        found.pop(vehicle, None)


def _events(file: Path, last_bytes: int | None = None) -> Iterator[dict[str, Any]]:
    """Yield the events in a file events.jsonl of a run folder, as dicts.

    last_bytes: read only this many bytes at the end of the file; None for the whole file
    """
    try:
        with file.open("rb") as opened:
            if last_bytes is not None:
                opened.seek(max(0, os.fstat(opened.fileno()).st_size - last_bytes))
            lines = opened.read().decode(errors="replace").splitlines()
    except OSError:
        return
    for line in lines:
        try:
            event = json.loads(line)
        except ValueError:  # the first and the last line may be incomplete
            continue
        if isinstance(event, dict):
            yield event


def _recorded_uid(vehicle: str, run: Path) -> str:
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        seen = json.loads((run / "wire" / f"{vehicle}.json").read_text())
        return valid_uid(seen["uid"])
    return ""


def valid_uid(raw: Any) -> str:
    """Return a hardware uid of 8 or 18 bytes as hexadecimal digits; "" for any other value."""
    return (
        raw.lower()
        if isinstance(raw, str) and re.fullmatch(r"([0-9a-fA-F]{16}|[0-9a-fA-F]{36})", raw)
        else ""
    )


def _address(raw: Any) -> Address:
    """Convert [host, port], as read from a JSON file, to a UDP address.

    Raises ValueError for a port out of range or a host name. Host names are refused, because name resolution needs a working
    network.
    """
    host, port = raw
    if not 0 <= int(port) <= 65535:
        raise ValueError(f"port: got {port}, expected 0 to 65535")
    return str(ipaddress.IPv4Address(host)), int(port)
