"""Report for the user when no messages of a vehicle arrive, with the data that arrive instead. Pure."""

from __future__ import annotations

from collections import Counter

from arena.transport import ConnectionUrl
from arena.wire.mavlink_frame import AUTOPILOT, Buffer, ParsedFrames

_REPORT_S = 10.0


class SilenceReport:
    """Report of the data that arrive on a vehicle's connection while no messages of the vehicle arrive.

    connection: URL of the vehicle
    system: MAVLink id of the vehicle
    own_component: component id of this process, whose messages may be returned
    counts: number of unusable bytes, by reason
    """

    def __init__(
        self, connection: ConnectionUrl, system: int, own_component: int, counts: Counter[str], now: float
    ) -> None:
        self._connection, self._system = connection, system
        self._ours = {(system, AUTOPILOT), (system, own_component)}
        self._counts = counts
        self.restart(now)

    def restart(self, now: float) -> None:
        """Set the counters of received data to zero, because messages of the vehicle arrive again."""
        self._since, self._bytes, self._foreign = now, 0, 0

    def on_data(self, data: Buffer, found: ParsedFrames) -> None:
        """Count received data, from the vehicle or from other senders."""
        self._bytes += len(data)
        if found.garbage:
            self._counts["from the vehicle: garbage bytes"] += found.garbage
        if found.bad_crc:
            self._counts["from the vehicle: wrong CRC"] += found.bad_crc
        for frame in found.frames:
            if (frame.sysid, frame.compid) not in self._ours:
                self._foreign = frame.sysid << 8 | frame.compid

    def text(self, problem: str, now: float) -> str:
        """Return a report for the user if no messages of the vehicle arrive; "" if no report is due.

        problem: why an autopilot that does send is not accepted as the vehicle; "" if there is none.
        """
        if now - self._since < _REPORT_S:
            return ""
        text = f"{self._connection}: {self._cause(problem, now - self._since)}"
        self.restart(now)
        return text

    def _cause(self, problem: str, since_s: float) -> str:
        k = self._system
        if problem:
            return f"an autopilot with id {k} sends, but it is not connected: {problem}"
        if self._foreign:
            others = f"system {self._foreign >> 8} component {self._foreign & 0xFF}"
            return f"received {others}, but no autopilot with id {k}: set the vehicle's MAV_SYS_ID to {k}"
        if self._bytes:
            serial = self._connection.kind == "serial"
            why = "is the baud rate right?" if serial else "does another program send here?"
            return f"received data, but no MAVLink: {why}"
        return f"no data for {since_s:.0f} s: is the vehicle switched on, and does it send to this address?"
