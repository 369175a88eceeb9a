"""Lines for Foxglove's log panel: STATUSTEXT messages of the vehicles, and lines of events.jsonl. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from foxglove.messages import Log, LogLevel
from pymavlink.dialects.v20 import common as mavlink

from arena.recorder.viewer_poses import timestamp

FAULT_PREFIX = "fault: "
"""Beginning of the events that report injected faults."""
_CHUNK_BYTES = 50
_FAILED = frozenset({"backoff", "fatal"})
_LEVELS = {
    **dict.fromkeys(range(mavlink.MAV_SEVERITY_CRITICAL + 1), LogLevel.Fatal),
    mavlink.MAV_SEVERITY_ERROR: LogLevel.Error,
    mavlink.MAV_SEVERITY_WARNING: LogLevel.Warning,
    mavlink.MAV_SEVERITY_NOTICE: LogLevel.Info,
    mavlink.MAV_SEVERITY_INFO: LogLevel.Info,
}


class TextAssembler:
    """Joins the parts of long STATUSTEXT messages."""

    def __init__(self) -> None:
        self._id, self._severity, self._text = 0, 0, b""

    def add(self, m: Any) -> Iterator[tuple[int, str]]:
        """Yield the severity (0 emergency .. 7 debug) and text of each text that is complete.

        m: decoded STATUSTEXT.
        """
        if self._id and m.id != self._id:  # the last part was lost
            yield self._take()
        if m.id and m.id == self._id:
            self._text += m.text
        else:
            self._id, self._severity, self._text = m.id, m.severity, m.text
        if not m.id or len(m.text) < _CHUNK_BYTES:
            yield self._take()

    def _take(self) -> tuple[int, str]:
        found = self._severity, self._text.split(b"\0", 1)[0].decode("ascii", errors="replace")
        self._id, self._text = 0, b""
        return found


def log_of_text(vehicle: str, severity: int, text: str, time_s: float) -> Log:
    """Return the log line of a STATUSTEXT.

    severity: MAV_SEVERITY.
    time_s: time of reception [s].
    """
    level = _LEVELS.get(severity, LogLevel.Debug)
    return Log(timestamp=timestamp(time_s), level=level, message=text, name=vehicle)


def log_of_event(fields: Mapping[str, Any], time_s: float) -> Log | None:
    """Return the log line of a line of events.jsonl; None for lines that are not events or changes of processes.

    fields: content of the line.  time_s: log time [s].
    """
    process = str(fields.get("process", ""))
    if "event" in fields:
        text = str(fields["event"])
        level = LogLevel.Warning if text.startswith(FAULT_PREFIX) else LogLevel.Info
    elif "to" in fields:
        text = f"{fields.get('from', '')} -> {fields['to']}: {fields.get('reason', '')}".removesuffix(": ")
        level = LogLevel.Error if str(fields["to"]).lower() in _FAILED else LogLevel.Debug
    else:
        return None
    return Log(timestamp=timestamp(time_s), level=level, message=text, name=process)


def fault_of_event(fields: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return the injected fault in a line of events.jsonl, and the process that simulates it; None if there is none."""
    text = str(fields.get("event", ""))
    if not text.startswith(FAULT_PREFIX):
        return None
    return text.removeprefix(FAULT_PREFIX), str(fields.get("process", ""))
