"""Sockets, injected faults and statistics of the motion capture emulator. The caller provides the time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from arena.fault_injection import FaultReceiver
from arena.mocap.emulator.core import EmulatedCameras
from arena.mocap.emulator.fault_injection import apply_fault
from arena.mocap.emulator.interface import MeasuredFrame, open_server
from arena.process_context import ProcessContext
from arena.wire.truth_rows import TruthRows

_LATE_S = 0.008  # two steps of the world, whose clock advances in steps
FrameListener = Callable[[MeasuredFrame, float], None]
"""Function that takes a frame and the simulation time at which it is sent [s]."""


class EmulatorShell:
    """Emulated cameras and the emulated server of a vendor. Call `advance` when simulation time reaches `due`.

    now: simulation time at which the first frame may be exposed [s].
    on_frame: function that also takes each frame that is sent; None without one.
    due: simulation time at which the next frame must be measured or sent, by `advance` [s].
    """

    def __init__(self, process: ProcessContext, now: float, on_frame: FrameListener | None = None) -> None:
        s = process.settings
        self._process, self._cameras = process, EmulatedCameras(s)
        self._truth, self._server = TruthRows(s["truth"]), open_server(s)
        self.faults = FaultReceiver(s.get("faults"))
        self._on_frame = on_frame
        self._number = math.ceil((now + self._cameras.latency_s) * self._cameras.rate_hz)
        self._ready, self._late, self._skipped, self._not_sent = False, 0, 0, 0
        self._began = self._reported = time.monotonic()
        self.due = self._cameras.due(self._number)

    def fileno(self) -> int:
        """Return a file descriptor that is readable when a request of a client has arrived."""
        return self._server.fileno()

    def advance(self, now: float, *, requests: bool = True) -> None:
        """Measure and send the frames that are due, and answer requests.

        now: simulation time [s].  requests: read the socket of the requests; False saves a system call if `fileno` is not readable.
        """
        cameras, due = self._cameras, self.due
        self._late += now - due > max(1.0 / cameras.rate_hz, _LATE_S)
        wall = time.monotonic()
        if cameras.exposure(self._number) + cameras.latency_s <= due:
            self._expose(now)
        for frame in cameras.leaving(now):
            failed = self._server.send(frame, now, wall)
            self._not_sent += failed
            if self._on_frame is not None:
                self._on_frame(frame, now)
            if not (self._ready or failed):
                self._ready = True
                self._process.ready()
        self.due = cameras.due(self._number)
        if requests:
            self._server.answer(wall)
        if wall - self._reported >= 1.0:
            self._report(wall)

    def search_receivers(self) -> None:
        """Search again for programs that receive frames without a request, because one may have been started."""
        self._server.search_receivers()

    def apply_faults(self) -> None:
        """Apply the injected faults that have arrived, and report each fault as an event."""
        for text in self.faults.apply(lambda fault: apply_fault(self._cameras, fault)):
            self._process.event(text)
        self.due = self._cameras.due(self._number)

    def close(self) -> None:
        """Close the sockets of the emulator."""
        self.faults.close()
        self._server.close()

    def _expose(self, now: float) -> None:
        """Measure the next frame and add it to the queue. Frames that are too late are skipped.

        now: simulation time [s].
        """
        cameras, number = self._cameras, self._number
        states = self._truth.at(cameras.exposure(number))
        if states is None:
            self._skipped += 1
        else:
            cameras.enqueue(number, states)
        # One or two late frames are made up for at once; more are skipped, as real cameras would.
        due = math.ceil((now - cameras.latency_s) * cameras.rate_hz) - 2
        self._skipped += max(0, due - number - 1)
        self._number = max(number + 1, due)

    def _report(self, wall: float) -> None:
        rate_hz = round(self._server.counts["frames"] / (wall - self._began), 2)
        self._reported = wall
        problems = {"late": self._late, "skipped": self._skipped, "not_sent": self._not_sent}
        self._process.stats({"rate_hz": rate_hz, **problems, **self._server.counts})
