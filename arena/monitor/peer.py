"""Search in /proc/net/tcp for the user whose program has opened a TCP connection to the live page."""

from __future__ import annotations

import ipaddress
import os
import sys
from pathlib import Path

Address = tuple[str, int]


def peer_uid(client: Address, server: Address, folder: Path = Path("/proc/net")) -> int | None:
    """Return the user id of the program that has opened a TCP connection to a server on this computer.

    Returns None if the program is not on this computer, or was not found. client, server: numeric address and
    port of both ends. folder: with the kernel's tables.
    """
    name = "tcp6" if ":" in client[0] else "tcp"
    try:
        text = (folder / name).read_text()
    except OSError:  # not Linux
        return None
    return uid_in(text, client, server)


def uid_in(table: str, local: Address, remote: Address) -> int | None:
    """Return the user id that /proc/net/tcp lists for a TCP connection; None if the connection is not listed.

    table: text of /proc/net/tcp or /proc/net/tcp6.  local, remote: address and port of the owner's end, and of the other end.
    """
    wanted = [_written(local), _written(remote)]
    for line in table.splitlines()[1:]:
        words = line.split()
        if words[1:3] == wanted:
            return int(words[7])
    return None


def allowed_uids() -> frozenset[int]:
    """Return the user ids that may open the page of `arena monitor` without a token.

    They are the user of this process, and root. If this process was started with sudo, the user who called sudo is a third one.
    """
    uid, sudo = os.getuid(), os.environ.get("SUDO_UID", "")
    return frozenset({uid, 0} | ({int(sudo)} if uid == 0 and sudo.isdigit() else set()))


def _written(address: Address) -> str:
    """Return an address in the hexadecimal form of /proc/net/tcp.

    Each group of 4 bytes is a number in the byte order of this machine.
    """
    packed = ipaddress.ip_address(address[0]).packed
    words = (int.from_bytes(packed[i : i + 4], sys.byteorder) for i in range(0, len(packed), 4))
    return "".join(f"{word:08X}" for word in words) + f":{address[1]:04X}"
