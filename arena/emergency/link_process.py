"""Who holds a real vehicle's wire: does it still take in what it is sent, and its end when it does not. Reads /proc, signals by
recorded identity and never by name.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
import struct
from pathlib import Path

from arena.emergency.direct_address import Address, Owner

_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")
_GONE_MS = 1000


def waiting_bytes(address: Address) -> int | None:
    """What a UDP socket bound there has not read yet [bytes]; None when nobody is bound there, on this computer."""
    host, port = struct.unpack("=I", socket.inet_aton(address[0]))[0], address[1]
    wanted = {f"{host:08X}:{port:04X}".encode(), f"{0:08X}:{port:04X}".encode()}
    try:
        lines = Path("/proc/net/udp").read_bytes().splitlines()[1:]
    except OSError:
        return 0  # cannot be told: nobody is ended for it
    found = [
        int(fields[4].partition(b":")[2], 16) for fields in map(bytes.split, lines) if fields[1] in wanted
    ]
    return max(found, default=None)


def end(owner: Owner) -> bool:
    """Kill the very process that was recorded, and wait until it has gone. False when it cannot be done."""
    try:
        handle = os.pidfd_open(owner.pid)
    except ProcessLookupError:
        return True
    except OSError:
        return False
    try:
        if not _is_same(owner):  # asked while the handle keeps the number from being given to another
            return True
        with contextlib.suppress(ProcessLookupError):
            signal.pidfd_send_signal(handle, signal.SIGKILL)
        return bool(select.select([handle], [], [], _GONE_MS / 1e3)[0])
    except OSError:
        return False
    finally:
        os.close(handle)


def _is_same(owner: Owner) -> bool:
    try:
        fields = Path(f"/proc/{owner.pid}/stat").read_bytes().rpartition(b")")[2].split()
    except OSError:
        return False
    return len(fields) >= 20 and abs(int(fields[19]) * _TICK_S - owner.start_s) < 0.005
