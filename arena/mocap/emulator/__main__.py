"""Process of the motion capture emulator: emulated cameras, their clock and a vendor's server.

Run as `python -m arena.mocap.emulator slice.json`.
"""

from __future__ import annotations

import math
import select
import sys
import time

from arena.clock import SimClock
from arena.errors import RunError
from arena.fault_injection import FaultReceiver
from arena.mocap.emulator.core import EmulatedCameras
from arena.mocap.emulator.fault_injection import apply_fault
from arena.mocap.emulator.interface import open_server
from arena.process_context import ProcessContext, run_process
from arena.wire.truth_page import TruthReader

_POLL_MS = 250  # wall time between checks for a stop signal
_EARLY_S = 1e-6
_LATE_S = 0.008  # two steps of the world, whose clock advances in steps


def main() -> int:
    return run_process("mocap", lambda room: _EmulatorProcess(room).serve)


class _EmulatorProcess:
    def __init__(self, room: ProcessContext) -> None:
        s = room.settings
        self.room, self.cameras = room, EmulatedCameras(s)
        self.clock, self.truth = SimClock(s["clock"], room.name), TruthReader(s["truth"])
        self.server = open_server(s)
        self.faults = FaultReceiver(s.get("faults"))
        self.wake_at: float | None = None  # requested from the clock [s]; None: awake
        self.poll = select.poll()
        for fd in (self.clock.fileno(), self.faults.fileno()):
            if fd >= 0:
                self.poll.register(fd, select.POLLIN)
        self.ready, self.late, self.skipped, self.not_sent = False, 0, 0, 0
        self.began = self.reported = time.monotonic()

    def serve(self) -> None:
        """Simulate the cameras and send their frames, until a stop signal arrives or the world ends."""
        try:
            self._serve()
        finally:
            self.faults.close()
            self.server.close()

    def _serve(self) -> None:
        cameras, clock = self.cameras, self.clock
        number = math.ceil((clock.now() + cameras.latency_s) * cameras.rate_hz)
        while not self.room.stopping:
            due = cameras.due(number)
            try:
                now = self._sleep_until(due)
            except RunError:
                return  # the world has ended, so there is nothing left to measure
            if now is None:
                continue
            self.late += now - due > max(1.0 / cameras.rate_hz, _LATE_S)
            wall = time.monotonic()
            if cameras.exposure(number) + cameras.latency_s <= due:
                number = self._expose(number, now)
            for frame in cameras.leaving(now):
                failed = self.server.send(frame, now, wall)
                self.not_sent += failed
                if not (self.ready or failed):
                    self.ready = True
                    self.room.ready()
            self.server.answer(wall)
            if wall - self.reported >= 1.0:
                self._report(wall)

    def _sleep_until(self, due: float) -> float | None:
        """Sleep until simulation time `due` [s], but at most 250 ms of wall time. Return the simulation time;
        None if `due` is not reached yet. Injected faults that arrive are applied at once.

        Faults are also applied during the sleep, because simulation time may stand still while many of them
        are sent.
        """
        if self.wake_at != due:
            self.clock.request_wake(due)
            self.wake_at = due
        ready = [fd for fd, _ in self.poll.poll(_POLL_MS)]
        if self.faults.fileno() in ready:
            for text in self.faults.apply(lambda fault: apply_fault(self.cameras, fault)):
                self.room.event(text)
            return None
        now = self.clock.wait_for_wake(0.0) if ready else None
        if now is not None:
            self.wake_at = None
        # an earlier time is the answer to an earlier request
        return now if now is not None and now >= due - _EARLY_S else None

    def _expose(self, number: int, now: float) -> int:
        """Measure frame `number` and queue this frame for sending. Return the number of the frame to measure next.
        Frames that are too late are skipped.
        """
        sample = self.truth.at(self.cameras.exposure(number))
        if sample is None:
            self.skipped += 1
        else:
            self.cameras.enqueue(number, sample)
        # One or two late frames are made up for at once; more are skipped, as real cameras would.
        due = math.ceil((now - self.cameras.latency_s) * self.cameras.rate_hz) - 2
        self.skipped += max(0, due - number - 1)
        return max(number + 1, due)

    def _report(self, wall: float) -> None:
        rate_hz = round(self.server.counts["frames"] / (wall - self.began), 2)
        self.reported = wall
        problems = {"late": self.late, "skipped": self.skipped, "not_sent": self.not_sent}
        self.room.stats({"rate_hz": rate_hz, **problems, **self.server.counts})


if __name__ == "__main__":
    sys.exit(main())
