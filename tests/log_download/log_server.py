"""A fake autopilot with log files, which it lists and sends as PX4 v1.16 does."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from fake_autopilot import FakeAutopilot
from pymavlink.dialects.v20 import common as mavlink


@dataclass(kw_only=True)
class LogServer(FakeAutopilot):
    """A vehicle with logs.

    logs: contents of each log; the id is the index
    times: time of each log [Unix s]
    burst: LOG_DATA per step
    sends_list, sends_data: False: requests are not answered
    sent: number of LOG_DATA
    """

    logs: list[bytes] = field(default_factory=list)
    times: list[int] = field(default_factory=list)
    burst: int = 20
    sends_list: bool = True
    sends_data: bool = True
    sent: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._part: tuple[int, int, int] | None = None  # log, next byte, end

    def _answer(self, m: Any, now: float) -> list[bytes]:
        kind = m.get_type()
        if kind == "LOG_REQUEST_LIST" and self.sends_list:
            return [
                self.pack(
                    mavlink.MAVLink_log_entry_message(k, len(self.logs), m.end, self.times[k], len(log))
                )
                for k, log in enumerate(self.logs)
                if m.start <= k
            ]
        if kind == "LOG_REQUEST_DATA" and self.sends_data and m.id < len(self.logs):
            self._part = (m.id, m.ofs, min(m.ofs + m.count, len(self.logs[m.id])))
        elif kind == "LOG_REQUEST_END":
            self._part = None
        return super()._answer(m, now)

    def step(self, now: float) -> list[bytes]:
        out = super().step(now)
        for _ in range(self.burst):
            if self._part is None:
                break
            log, at, end = self._part
            data = self.logs[log][at : min(at + 90, end)]
            out.append(self.pack(mavlink.MAVLink_log_data_message(log, at, len(data), data.ljust(90, b"\0"))))
            self.sent += 1
            self._part = (log, at + len(data), end) if at + len(data) < end else None
        return out
