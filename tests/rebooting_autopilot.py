"""A vehicle that reboots, and may lose parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from fake_autopilot import REBOOT, FakeAutopilot


@dataclass(kw_only=True)
class RebootingAutopilot(FakeAutopilot):
    """An autopilot that reboots some time after it has acknowledged the command, and is silent until it has booted.

    age_s: time since its boot at its first telemetry [s]; 0 after a reboot
    ack_only_s: time from the acknowledgement to the reboot [s]; infinite: it never reboots
    off_s: duration of the reboot [s]; infinite: it does not come back
    reset: name -> (value, type) of the parameters that have another value after the reboot
    dropped: names of the parameters that do not exist after the reboot
    boots: number of reboots
    goes_at: time at which it reboots [s]; infinite: no reboot is requested
    """

    age_s: float = 60.0
    ack_only_s: float = 0.3
    off_s: float = 0.5
    reset: dict[str, tuple[float, int]] = field(default_factory=dict)
    dropped: set[str] = field(default_factory=set)
    boots: int = 0
    goes_at: float = math.inf

    def __post_init__(self) -> None:
        super().__post_init__()
        self._back_at = math.inf

    def receive(self, data: bytes, now: float) -> list[bytes]:
        asked = self.rebooted
        answers = super().receive(data, now)
        if self.rebooted > asked and REBOOT not in self.refuse:
            self.goes_at = now + self.ack_only_s
        return answers

    def step(self, now: float) -> list[bytes]:
        if now >= self.goes_at:
            self.alive, self.goes_at, self._back_at = False, math.inf, now + self.off_s
        if now >= self._back_at:
            self._boot()
        return super().step(now)

    def boot_s(self, now: float) -> float:
        return self.age_s + super().boot_s(now)

    def _boot(self) -> None:
        self.alive, self._back_at = True, math.inf
        self._began, self.age_s, self.next_telemetry_s = None, 0.0, 0.0
        self.params |= self.reset
        self.params = {name: value for name, value in self.params.items() if name not in self.dropped}
        self.boots += 1


def rebooting(**changes: Any) -> RebootingAutopilot:
    """Return a vehicle that sends its heartbeat and the time since its boot."""
    return RebootingAutopilot(**({"telemetry": ("HEARTBEAT", "SYSTEM_TIME")} | changes))
