"""Checks whether a vehicle must still be rebooted after `arena params push` (file missing_reboots.json)."""

from __future__ import annotations

from pathlib import Path

from arena.errors import InputError
from arena.fcu_link.axes_record import BootTime
from arena.fcu_link.settings import RebootRecord
from arena.missing_reboots import ClockTime, MissingReboots


class MissingRebootCheck:
    """Check of one vehicle: the parameters that `arena params push` has written must be in effect.

    The vehicle already reports the new value of such a parameter, so the comparison of values does not find it.

    events: messages for the user; the caller takes them and empties the list
    """

    def __init__(self, record: RebootRecord) -> None:
        self._record = record
        self._last_event = ""
        self.events: list[str] = []

    def reasons(self, uid: str, boot: BootTime | None) -> list[str]:
        """Read missing_reboots.json, and return why the vehicle must not be armed; empty if it may be armed.

        If the file exists but cannot be read, the vehicle must not be armed.

        uid: hardware uid of the autopilot; "" if unknown.
        boot: time of its boot; None if unknown.
        """
        try:
            missing = MissingReboots.read(Path(self._record.folder)).of(uid, self._record.address)
        except InputError as error:
            self._report(f"must not arm: {error}")
            return ["cannot read missing_reboots.json"]
        now = ClockTime.now()
        uptime_s = None if boot is None else now.since_boot_s - boot.at_s
        if missing is None or missing.has_booted(uptime_s, now):
            self._last_event = ""
            return []
        if boot is not None:
            self._report(f"needs a reboot: a push has written {', '.join(missing.parameters)}")
        first, more = next(iter(missing.parameters), "a push"), len(missing.parameters) - 1
        return [f"reboot needed for {first}" + (f" +{more}" if more > 0 else "")]

    def _report(self, text: str) -> None:
        if text != self._last_event:
            self._last_event = text
            self.events.append(text)
