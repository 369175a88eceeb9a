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
    """Assembler of STATUSTEXT messages that consist of several parts."""

    def __init__(self) -> None:
        self._id, self._severity, self._text = 0, 0, b""

    def add(self, m: Any) -> Iterator[tuple[int, str]]:
        """Add one decoded STATUSTEXT. Yield (severity, text) when a text is complete.

        severity: MAV_SEVERITY, 0 (emergency) to 7 (debug).

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
        found = self._severity, self._text.split(b"\0", 1)[0].decode("ascii", errors="replace").rstrip("\t")
        self._id, self._text = 0, b""
        return found


def log_of_text(vehicle: str, severity: int, text: str, time_s: float) -> Log:
    """Return the Foxglove log message of a STATUSTEXT.

    severity: MAV_SEVERITY.
    time_s: time of reception [s].
    """
    level = _LEVELS.get(severity, LogLevel.Debug)
    return Log(timestamp=timestamp(time_s), level=level, message=text, name=vehicle)


def log_of_event(fields: Mapping[str, Any], time_s: float) -> Log | None:
    """Return the Foxglove log message of a line of events.jsonl, or None if the line is of no interest to viewers.

    Only events and state changes of processes are shown.

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
    """Return (fault, process that simulates it) of an event line about an injected fault, else None."""
    text = str(fields.get("event", ""))
    if not text.startswith(FAULT_PREFIX):
        return None
    return text.removeprefix(FAULT_PREFIX), str(fields.get("process", ""))
