"""Functions to check whether the link process of a vehicle reads its sockets, and to kill the process.

The link process of the vehicle `uav1` is `link.uav1`. It owns the connection to a real vehicle.
The functions read /proc. A signal is sent only to a process with the recorded identity; a process is never selected by name.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
import struct
from pathlib import Path

from arena.emergency.run_record import ProcessIdentity
from arena.transport import Address

_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")
_EXIT_TIMEOUT_MS = 1000
_START_TOLERANCE_S = 0.005


def unread_bytes(address: Address) -> int | None:
    """Return the number of received bytes that the process of a UDP socket has not read yet.

    address: address to which the socket is bound. Returns None if no socket of this computer is bound to it.
    """
    host, port = struct.unpack("=I", socket.inet_aton(address[0]))[0], address[1]
    wanted = {f"{host:08X}:{port:04X}".encode(), f"{0:08X}:{port:04X}".encode()}
    try:
        lines = Path("/proc/net/udp").read_bytes().splitlines()[1:]
    except OSError:
        return 0  # unknown: then no process is killed
    found = [
        int(fields[4].partition(b":")[2], 16) for fields in map(bytes.split, lines) if fields[1] in wanted
    ]
    return max(found, default=None)


def kill(process: ProcessIdentity) -> bool:
    """Kill a link process and wait for its end. Return False if the process cannot be killed.

    process: identity of the process in state.json. Only a process of the user who owns this file is killed.
    """
    try:
        handle = os.pidfd_open(process.pid)
    except ProcessLookupError:
        return True
    except OSError:
        return False
    try:
        if not _is_same(process):  # checked while the open handle keeps the pid from being reused
            return True
        if not _belongs_to_owner(process):
            return False
        with contextlib.suppress(ProcessLookupError):
            signal.pidfd_send_signal(handle, signal.SIGKILL)
        return bool(select.select([handle], [], [], _EXIT_TIMEOUT_MS / 1e3)[0])
    except OSError:
        return False
    finally:
        os.close(handle)


def is_running(process: ProcessIdentity | None) -> bool:
    """Return whether a recorded process runs.

    A process that has ended or is paused by a signal does not run.
    """
    fields = [] if process is None else _stat(process.pid)
    return process is not None and _is_same(process, fields) and fields[0] not in b"ZXTt"


def has_ended(process: ProcessIdentity) -> bool:
    """Return whether a recorded process has ended. A process that is paused by a signal has not."""
    fields = _stat(process.pid)
    return not _is_same(process, fields) or fields[0] in b"ZX"


def _is_same(process: ProcessIdentity, fields: list[bytes] | None = None) -> bool:
    fields = _stat(process.pid) if fields is None else fields
    return len(fields) >= 20 and abs(int(fields[19]) * _TICK_S - process.start_s) < _START_TOLERANCE_S


def _belongs_to_owner(process: ProcessIdentity) -> bool:
    """Return whether a process runs as the user who wrote its pid into the run folder."""
    try:
        return process.owner in (None, Path(f"/proc/{process.pid}").stat().st_uid)
    except OSError:
        return False


def _stat(pid: int) -> list[bytes]:
    """Return the fields of /proc/PID/stat that follow the process name; none if the process does not exist."""
    try:
        return Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
    except OSError:
        return []
