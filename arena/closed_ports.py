"""Search for UDP ports of this computer at which no program listens, so that nothing need be sent to them.

The kernel answers each datagram to a closed port with an ICMP message, which costs more than a datagram that is received.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from arena.transport import Address, is_loopback

REFRESH_S = 0.1
"""Default of the shortest wall time between two searches [s]."""


class ClosedPorts:
    """Set of the receivers at whose ports no program listens.

    Only addresses on the loopback network can be among them, because the ports of other computers are unknown.

    addresses: receivers to search for.  group: multicast group to search for, to which is sent on the loopback network only
    period_s: shortest wall time between two calls of `refresh` that search [s]
    folder: folder of the kernel's tables `udp` and `udp6`
    now: the receivers at which no program listened at the last search. It is another object only after a change
    """

    def __init__(
        self,
        addresses: Iterable[Address],
        *,
        group: Address | None = None,
        period_s: float = REFRESH_S,
        folder: Path = Path("/proc/net"),
    ) -> None:
        self._addresses = frozenset(filter(is_loopback, addresses)) | ({group} if group else set())
        self._folder, self._period_s, self._next = folder, period_s, float("-inf")
        self.now: frozenset[Address] = frozenset()

    def refresh(self, wall: float) -> None:
        """Search again, if the last search was not just before.

        wall: monotonic [s].
        """
        if self._addresses and wall >= self._next:
            self._next = wall + self._period_s
            self.search()

    def search(self) -> None:
        """Search now. If the kernel's tables cannot be read, no port counts as closed."""
        try:
            opened = self._open_ports()
        except (OSError, ValueError, IndexError):
            found: frozenset[Address] = frozenset()
        else:
            found = frozenset(at for at in self._addresses if at[1] not in opened)
        if found != self.now:
            self.now = found

    def _open_ports(self) -> set[int]:
        """Return all UDP ports of this computer that are open, at any address."""
        lines: list[bytes] = []
        for name in ("udp", "udp6"):
            table = self._folder / name
            if name == "udp" or table.exists():  # a computer can be without IPv6
                lines += table.read_bytes().splitlines()[1:]
        return {int(line.split()[1].rpartition(b":")[2], 16) for line in lines}
