"""The process `forward.<vehicle>`: sends the motion-capture poses of one vehicle to its autopilot.

Run as `python -m arena.pose_forwarder slice.json`.
"""

from __future__ import annotations

import selectors
import sys
import time

from arena.pose_forwarder.shell import TICK_S, ForwarderShell
from arena.process_context import ProcessContext, run_process


def main() -> int:
    return run_process("forward", lambda process: _ForwarderProcess(process).serve)


_FIRST_TICK_S = 0.02
"""Time between two ticks until the forwarder is ready [s]. It is short, because user programs wait for the forwarder."""


class _PoseGapSleep:
    """Timer that lets the pose forwarder sleep between two forwarded poses, to save CPU time.

    Most camera frames are not forwarded, so the process need not wake up for each frame.

    The interval is measured, so that it is right at any speed of the simulation. period_s: longest interval
    [s].
    """

    _SHARE = 0.7
    _MIN_S = 0.003

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._sent = -1e9
        self._gap_s = 0.0

    def on_sent(self, wall: float) -> None:
        """Record that a pose was sent now. wall: monotonic time of sending [s]."""
        gap = min(wall - self._sent, self._period_s)
        self._gap_s += 0.2 * (gap - self._gap_s)
        self._sent = wall

    def sleep(self) -> None:
        """Sleep until shortly before the next pose is due.

        The sleep ends at 70 % of the usual interval, counted from the last pose. Skip a sleep below 3 ms.
        """
        pause = self._sent + self._SHARE * self._gap_s - time.monotonic()
        if pause > self._MIN_S:
            time.sleep(pause)


class _ForwarderProcess(ForwarderShell):
    def __init__(self, process: ProcessContext) -> None:
        super().__init__(process)
        self._gap_sleep = _PoseGapSleep(1.0 / float(process.settings["rate_hz"]))

    def serve(self) -> None:
        """Forward poses until the process must end.

        A stop signal ends the process, but not while a real vehicle is armed. If the supervisor has died,
        also continue until the vehicle is disarmed; for a simulated vehicle 60 s at most.
        """
        selector = selectors.DefaultSelector()
        selector.register(self.capture, selectors.EVENT_READ)
        selector.register(self.link, selectors.EVENT_READ)
        next_tick = time.monotonic()
        while not (self.process.stopping and self.process.may_end(self._armed_real())):
            self._gap_sleep.sleep()
            selector.select(max(0.0, next_tick - time.monotonic()))
            now, wall = self.clock.now(), time.monotonic()
            if self.turn(now):
                self._gap_sleep.on_sent(wall)
            if wall >= next_tick:
                next_tick = wall + (TICK_S if self.ready else _FIRST_TICK_S)
                if self.tick(now, wall):
                    return

    def _armed_real(self) -> list[str]:
        """Return a list with the name of this process's vehicle if it is real and armed, else an empty list.

        The list is for `ProcessContext.may_end`. The vehicle counts as armed if its last heartbeat reported
        so.
        """
        return [self.process.settings["vehicle"]] if self.core.autopilot.armed and not self.simulated else []


if __name__ == "__main__":
    sys.exit(main())
