"""Download of one log from one vehicle, without sockets: requests to send, and bytes that are missing. Pure.

The vehicle sends a requested part of a log as a sequence of LOG_DATA. Messages that were lost are requested again, as soon as the
last message of the part has arrived or nothing arrives any more. A vehicle that is armed is not asked for a log, because the
link is needed for the flight.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from arena.log_download.missing_ranges import MissingRanges, Range
from arena.params.transfer.transfer import Progress, Transfer
from arena.params.transfer.uid_check import UidCheck
from arena.wire import mavlink_logs
from arena.wire.mavlink_frame import AUTOPILOT, Buffer, Frame
from arena.wire.mavlink_logs import LogEntry, Message

_PART_BYTES = 2048 * mavlink_logs.DATA_BYTES  # of one request
_QUIET_S = 0.5  # without a message of the log, before the missing bytes are requested again
_LIST_PAUSE_S = 1.0
_MOST_REQUESTS = 10  # in a row without an answer


@dataclass(frozen=True, kw_only=True)
class Interrupted:
    """State of an interrupted log download: the log, and the bytes that are still missing.

    entry: the log on the vehicle. missing: ranges of bytes that were not received.
    """

    entry: LogEntry
    missing: tuple[Range, ...]


class LogDownload(Transfer):
    """Transfer that lists the logs of one vehicle, and downloads one of these logs.

    number: id of the log; None: the newest one
    only_list: end when all logs are listed
    resume: state of an interrupted download; it is continued if it is the same log
    entries: id -> log of the vehicle
    entry: the log that is downloaded; None before it is chosen
    missing: missing bytes of the log; None before it is chosen
    problem: why the download cannot succeed; "" if it can
    resumed: True if `resume` is continued
    """

    def __init__(
        self,
        *,
        system: int,
        component: int,
        now: float,
        uid: UidCheck | None = None,
        number: int | None = None,
        only_list: bool = False,
        resume: Interrupted | None = None,
    ) -> None:
        super().__init__(system=system, component=component, now=now, uid=uid)
        self._number, self._only_list, self._resume = number, only_list, resume
        self.entries: dict[int, LogEntry] = {}
        self.entry: LogEntry | None = None
        self.missing: MissingRanges | None = None
        self.problem, self.resumed = "", False
        self._pieces: list[tuple[int, bytes]] = []
        self._logs: int | None = None
        self._active_at = -1e9  # time of the last request or answer
        self._part: Range = (0, 0)
        self._part_ended = True
        self._requests_in_a_row = 0

    @property
    def progress(self) -> Progress:
        if self.missing is None:
            return Progress("listing", len(self.entries), self._logs or 0)
        return Progress("kB", (self.missing.size - self.missing.left) // 1000, self.missing.size // 1000)

    @property
    def complete(self) -> bool:
        """True if every byte of the log was received."""
        return self.missing is not None and not self.missing.ranges

    def take_pieces(self) -> list[tuple[int, bytes]]:
        """Return the received parts of the log as (offset, bytes), and remove them from this object."""
        found, self._pieces = self._pieces, []
        return found

    def stop_request(self) -> bytes:
        """Return the LOG_REQUEST_END frame, which makes the vehicle stop sending a log."""
        return self._codec.frame(*mavlink_logs.request_end(self.system))

    # -- requests ----------------------------------------------------------------------------------------------

    def _update(self, now: float) -> None:
        super()._update(now)
        if self.armed:
            self.ending = self.ending or "armed"

    def _requests(self, now: float) -> Iterable[Message]:
        if not self._disarmed(now):
            return []
        return self._request_list(now) if self.entry is None else self._request_part(self.entry, now)

    def _request_list(self, now: float) -> Iterable[Message]:
        paused = now - self._active_at > _LIST_PAUSE_S
        if self._logs == 0 or (self._logs is not None and len(self.entries) >= self._logs):
            self._choose()
        elif paused and self._requests_in_a_row >= _MOST_REQUESTS // 2:
            self._choose()  # from the logs that were listed
        elif paused:
            self._requests_in_a_row += 1
            self._active_at = now
            return [mavlink_logs.request_list(self.system)]
        return []

    def _choose(self) -> None:
        """Choose the log to download from the vehicle's list of logs. If the list is empty, end the transfer."""
        self._requests_in_a_row = 0
        found = sorted(self.entries.values(), key=lambda each: (each.time_s, each.number))
        if not found:
            self._end("the vehicle has no log" if self._logs == 0 else "the vehicle lists no log")
        elif self._only_list:
            self.ending = "done"
        elif self._number is not None and self._number not in self.entries:
            listed = ", ".join(map(str, sorted(self.entries)))
            self._end(f"the vehicle has no log {self._number}, expected one of {listed}")
        else:
            self._begin(found[-1] if self._number is None else self.entries[self._number])

    def _begin(self, entry: LogEntry) -> None:
        self.entry, self._active_at = entry, -1e9
        known = self._resume
        if known is not None and (known.entry.size, known.entry.time_s) == (entry.size, entry.time_s):
            self.resumed = True
            self.missing = MissingRanges(entry.size, known.missing)
        else:
            self.missing = MissingRanges(entry.size)

    def _request_part(self, entry: LogEntry, now: float) -> Iterable[Message]:
        missing = self.missing
        assert missing is not None
        if not missing.ranges:
            self.ending = "done"
            return []
        received = not missing.is_missing(*self._part)
        if not (received or self._part_ended or now - self._active_at > _QUIET_S):
            return []
        if self._requests_in_a_row >= _MOST_REQUESTS:
            self._end(f"the vehicle does not send log {entry.number}, of which it listed {entry.size} bytes")
            return []
        part = missing.first(_PART_BYTES)
        assert part is not None
        self._part, self._part_ended, self._active_at = part, False, now
        self._requests_in_a_row += 1
        return [mavlink_logs.request_data(self.system, entry.number, part[0], part[1] - part[0])]

    def _end(self, problem: str) -> None:
        self.problem, self.ending = problem, "done"

    # -- answers -----------------------------------------------------------------------------------------------

    def receive(self, data: Buffer, frame: Frame, now: float) -> None:
        """Process a received MAVLink frame. Only frames of the vehicle's autopilot have an effect.

        data: bytes that contain the frame
        now: monotonic time [s]
        """
        super().receive(data, frame, now)
        own = frame.sysid == self.system and frame.compid == AUTOPILOT
        if not own or self.done or (self.uid is not None and not self.uid.passed):
            return
        if frame.msgid == mavlink_logs.ENTRY:
            self._on_entry(mavlink_logs.parse_entry(data, frame), now)
        elif frame.msgid == mavlink_logs.DATA:
            self._on_data(mavlink_logs.parse_data(data, frame), now)

    def _on_entry(self, entry: LogEntry, now: float) -> None:
        self._active_at = now
        self._logs = entry.logs
        if entry.logs:
            self.entries[entry.number] = entry

    def _on_data(self, found: mavlink_logs.LogData, now: float) -> None:
        missing, end = self.missing, found.offset + len(found.data)
        if self.entry is None or missing is None or found.number != self.entry.number or end > missing.size:
            return
        self._active_at = now
        if len(found.data) and missing.receive(found.offset, end):
            self._requests_in_a_row = 0
            self._pieces.append((found.offset, found.data))
        if end >= self._part[1] > found.offset:
            self._part_ended = True
