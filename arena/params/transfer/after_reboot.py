"""Reader of a vehicle's parameters after its reboot over MAVLink. Pure.

Right after the command to reboot, the autopilot still answers for some time with its values from before the reboot. So
nothing is read before a message shows that the autopilot has booted after the command.
"""

from __future__ import annotations

from collections.abc import Iterable

from arena.params.transfer.reader import ParamReader
from arena.params.transfer.uid_check import UidCheck
from arena.wire.mavlink_params import Message, Value, request_boot_time

TRY_S = 5.0  # after which the connection is opened again: a USB device that reboots is another device
_NO_BOOT_TIME_S = 3.0  # an autopilot that sends no SYSTEM_TIME in this time does not report its boot time
_REQUEST_PERIOD_S = 0.4


class AfterRebootReader(ParamReader):
    """Transfer that waits until a vehicle has rebooted, and then reads parameters.

    It ends as "not rebooted" or "no connection" if the vehicle has not rebooted within `TRY_S`.

    names: names of the parameters to read.
    requested_at: monotonic time of the command to reboot [s]. The vehicle has rebooted if it has booted after this time.
    reports_boot_time: the autopilot has reported its boot time (SYSTEM_TIME) before the reboot, so only a SYSTEM_TIME shows that
        it has rebooted. Otherwise it counts as rebooted if it sends no SYSTEM_TIME.

    Begin the transfer only after the old firmware has stopped sending.
    """

    requests_boot_time = True

    def __init__(
        self,
        *,
        system: int,
        component: int,
        now: float,
        names: Iterable[str],
        requested_at: float,
        reports_boot_time: bool = False,
        uid: UidCheck | None = None,
    ) -> None:
        super().__init__(system=system, component=component, now=now, names=names, uid=uid)
        self._requested_at, self._reports_boot_time = requested_at, reports_boot_time
        self._connected_at: float | None = None
        self._next_request = now

    def _has_rebooted(self, now: float) -> bool:
        if self._heartbeat_at is None or self._connected_at is None:
            return False
        if self.booted_at is not None:
            return self.booted_at > self._requested_at
        if self._reports_boot_time:
            return False
        return now - self._connected_at > _NO_BOOT_TIME_S

    def _on_value(self, value: Value, now: float) -> None:
        if self._has_rebooted(now):  # an earlier value was requested by another program
            super()._on_value(value, now)

    def _update(self, now: float) -> None:
        super()._update(now)
        if self._received_at is not None and self._connected_at is None:
            self._connected_at = now
        if now - self._began > TRY_S and not self._has_rebooted(now):
            self.ending = self.ending or ("no connection" if self.booted_at is None else "not rebooted")

    def _requests(self, now: float) -> Iterable[Message]:
        if self._has_rebooted(now):
            return super()._requests(now)
        if now < self._next_request:
            return []
        self._next_request = now + _REQUEST_PERIOD_S
        return [request_boot_time(self.system)]
