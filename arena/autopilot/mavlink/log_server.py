"""MAVLink log protocol of one vehicle: lists and sends its logs, as PX4 does. Logs are never erased.

Input and output are messages.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.stored_logs import Content, LogEntry

MESSAGE_IDS = (
    mavlink.MAVLINK_MSG_ID_LOG_REQUEST_LIST,
    mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA,
    mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END,
    mavlink.MAVLINK_MSG_ID_LOG_ERASE,
)
_PART_BYTES = 90
_MESSAGES_PER_STEP = 10  # a datagram stays below 2048 bytes, which SDKs can receive
_TO_THE_LAST = 0xFFFF


class Logs(Protocol):
    """Interface through which `LogServer` lists and reads the logs of one vehicle.

    No method waits for a disk.
    """

    def logs(self) -> list[LogEntry]:
        """Return the stored logs of the vehicle, the oldest first."""
        ...

    def read_log(self, name: str) -> Content | None:
        """Start to read a log of the vehicle. Return its `Content`; None if no log has this name."""
        ...


@dataclass(slots=True)
class _Transfer:
    """Download of a range of bytes of a log on one link.

    log: number of the log. at: next byte. until: byte at which the part ends
    """

    log: int
    at: int
    until: int


@dataclass(slots=True)
class LogServer:
    """Server of MAVLink's log protocol: lists and sends the logs of one vehicle.

    Call `next_messages` in each step while `busy`.

    boot_unix_s: Unix time of the boot [s]
    """

    files: Logs
    boot_unix_s: float
    _to_list: dict[str, list[Any]] = field(default_factory=dict)
    _transfers: dict[str, _Transfer] = field(default_factory=dict)
    _open: tuple[int, Content] | None = None

    @property
    def busy(self) -> bool:
        """True while the list of logs or parts of a log are being sent on any link."""
        return bool(self._transfers) or any(self._to_list.values())

    def receive(self, link: str, m: Any) -> None:
        """Process a LOG_* message to this vehicle. `next_messages` returns the replies."""
        _HANDLERS[m.get_msgId()](self, link, m)

    def next_messages(self, link: str) -> list[Any]:
        """Return the next LOG_ENTRY or LOG_DATA messages to send on this link."""
        entries = self._to_list.get(link, [])
        out, entries[:_MESSAGES_PER_STEP] = entries[:_MESSAGES_PER_STEP], []
        transfer = self._transfers.get(link)
        if transfer is not None and not out:
            out = self._parts(link, transfer)
        return out

    def _on_list(self, link: str, m: Any) -> None:
        """Queue one LOG_ENTRY for each log. If there is no log, queue one empty LOG_ENTRY."""
        entries = self.files.logs()
        end = len(entries) - 1 if m.end == _TO_THE_LAST else min(m.end, len(entries) - 1)
        chosen = [(k, entries[k]) for k in range(min(m.start, len(entries)), end + 1)]
        self._to_list[link] = [
            mavlink.MAVLink_log_entry_message(
                k, len(entries), len(entries) - 1, int(self.boot_unix_s + entry.begun_s), entry.size
            )
            for k, entry in chosen
        ] or [mavlink.MAVLink_log_entry_message(0, len(entries), max(0, len(entries) - 1), 0, 0)]

    def _on_data(self, link: str, m: Any) -> None:
        entries = self.files.logs()
        self._transfers.pop(link, None)
        if m.id >= len(entries):
            return
        if self._open is None or self._open[0] != m.id or m.ofs == 0:
            content = self.files.read_log(entries[m.id].name)
            if content is None:
                return
            self._open = m.id, content
        self._transfers[link] = _Transfer(m.id, m.ofs, m.ofs + m.count)

    def _on_end(self, link: str, m: Any) -> None:
        self._transfers.pop(link, None)

    def _on_erase(self, link: str, m: Any) -> None:
        """Ignore LOG_ERASE, because the logs belong to the run folder."""

    def _parts(self, link: str, t: _Transfer) -> list[Any]:
        """Return the next LOG_DATA messages of a download.

        A part after the end of the log has no bytes.
        """
        if self._open is None or self._open[0] != t.log:
            del self._transfers[link]
            return []
        if not self._open[1].ready:
            return []
        data = self._open[1].data or b""
        out: list[Any] = []
        while len(out) < _MESSAGES_PER_STEP and link in self._transfers:
            part = data[t.at : min(t.at + _PART_BYTES, t.until)]
            out.append(
                mavlink.MAVLink_log_data_message(t.log, t.at, len(part), part.ljust(_PART_BYTES, b"\0"))
            )
            t.at += len(part)
            if not part or t.at >= min(t.until, len(data)):
                del self._transfers[link]
        return out


_HANDLERS: dict[int, Callable[[LogServer, str, Any], None]] = {
    mavlink.MAVLINK_MSG_ID_LOG_REQUEST_LIST: LogServer._on_list,
    mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA: LogServer._on_data,
    mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END: LogServer._on_end,
    mavlink.MAVLINK_MSG_ID_LOG_ERASE: LogServer._on_erase,
}
