"""Sockets, clock and loop of the process `recorder`. It must never send data to a vehicle."""

from __future__ import annotations

import math
import sys
import time
from collections import deque
from collections.abc import Mapping
from operator import itemgetter
from typing import Any

from arena.clock_reading import read_together
from arena.errors import ArenaError, RunError
from arena.mocap.client import CapturedFrame, ChangeReport, open_client
from arena.process_context import ProcessContext, ShutdownPolicy
from arena.recorder.channels import Datagram
from arena.recorder.flight_recorder import FlightRecorder
from arena.recorder.router_copies import RouterCopies
from arena.recorder.run_clock import RunClock
from arena.recorder.run_time import RunTime, SimulationTime, UnixTime, wake_period_s
from arena.recorder.truth_sampler import TruthSampler
from arena.wire.truth_rows import StateReader

_CHECK_PERIOD_S, _CLOSE_LIMIT_S = 1.0, 3.0
_AFTER_STOP_S = 0.15  # wall time; more than two periods of the true states at 30 Hz
_MAX_LAG_S = 0.3  # more than two wake-ups; the channels for viewers get no datagrams that have waited longer


class RecorderShell:
    """Process that receives all data of an arena and passes them to a `FlightRecorder`.

    All settings come from the process's slice.
    """

    def __init__(self, process: ProcessContext) -> None:
        settings = process.settings
        self._process = process
        self._captures = [_Capture(process, raw) for raw in settings["captures"]]
        period_s = wake_period_s(len(settings["vehicles"]), live=settings.get("foxglove") is not None)
        self._time: RunTime = (
            SimulationTime(settings["clock"], process.name, period_s)
            if settings["clock"]
            else UnixTime(period_s)
        )
        now_s, monotonic_s = read_together(self._time.now)
        self._run_clock = RunClock(now_s, monotonic_s)
        self._copies = RouterCopies(tuple(settings["listen"]), settings["vehicles"])
        self._truth = _truth_sampler(settings)
        self._recorder = FlightRecorder(process, now_s)
        # Without a supervisor, simulated vehicles are recorded for 60 s at most; real ones until they are disarmed.
        real = any(v["index"] is None for v in settings["vehicles"])
        self._shutdown = ShutdownPolicy(limit_s=None if real else 60.0)
        self._next_check = 0.0

    def run(self) -> None:
        """Record until shortly after SIGTERM, or until the simulated world ends.

        If the supervisor has died, end when the vehicles are disarmed.

        The arena stops the recorder as soon as the last vehicle is disarmed. A row of the logs must still follow this message.
        """
        end_s = math.inf
        while time.monotonic() < end_s:
            if self._process.stopping:
                end_s = min(end_s, time.monotonic() + _AFTER_STOP_S)
            try:
                self._time.wait()
            except RunError:
                self._process.event(
                    f"{self._process.name}: the simulated world has ended; the recorder ends, too"
                )
                return
            if self.step(*read_together(self._time.now)):
                return

    def step(self, now_s: float, monotonic_s: float) -> bool:
        """Record all datagrams, captured frames and true states that have arrived since the last call.

        now_s, monotonic_s: run's clock and monotonic time [s].
        Return whether the recorder must end, because the supervisor is dead and the vehicles are disarmed.
        """
        recorder = self._recorder
        self._run_clock.update(now_s, monotonic_s)
        # All at once, because the buffer of the kernel is limited: what does not fit into it is lost.
        waiting = list(self._copies.receive())
        recorder.behind = bool(waiting) and monotonic_s - waiting[0][3] > _MAX_LAG_S
        frames = self._received_frames(now_s, monotonic_s)
        datagrams: list[Datagram] = []
        for vehicle, up, data, at in waiting:
            if datagrams and frames and frames[0][0] <= at:
                recorder.on_datagrams(datagrams)
                datagrams = []
            while frames and frames[0][0] <= at:
                self._record_frame(*frames.popleft())
            datagrams.append((vehicle, up, data, self._run_clock.at(at)))
        if datagrams:
            recorder.on_datagrams(datagrams)
        for received in frames:
            self._record_frame(*received)
        if self._truth is not None:
            for time_s, truth in self._truth.due(now_s):
                recorder.on_truth(truth, time_s)
        recorder.tick(now_s, monotonic_s)
        return self._once_a_second(monotonic_s)

    def _received_frames(self, now_s: float, monotonic_s: float) -> deque[tuple[float, CapturedFrame, bool]]:
        """Return the motion capture frames that have arrived since the last call.

        Each item is (monotonic time of arrival [s], frame, True if the emulator sent it).
        """
        found = [
            (monotonic_s if frame.arrived_s is None else frame.arrived_s, frame, capture.simulated)
            for capture in self._captures
            for frame in capture.poll(now_s)
        ]
        if len(self._captures) > 1:
            found.sort(key=itemgetter(0))
        return deque(found)

    def _record_frame(self, at: float, frame: CapturedFrame, simulated: bool) -> None:
        self._recorder.on_frame(frame, simulated, self._run_clock.at(at))

    def close(self) -> None:
        """Record the data that have already arrived, complete the file, and close the sockets."""
        self._next_check = time.monotonic() + _CLOSE_LIMIT_S
        self.step(self._time.now(), time.monotonic())
        while not self._copies.is_empty() and time.monotonic() < self._next_check:
            self.step(self._time.now(), time.monotonic())
        self._update_counts()
        self._recorder.close(self._time.now())
        self._copies.close()
        for capture in self._captures:
            capture.close()

    def _once_a_second(self, monotonic_s: float) -> bool:
        if monotonic_s < self._next_check:
            return False
        self._next_check = monotonic_s + _CHECK_PERIOD_S
        self._update_counts()
        for capture in self._captures:
            capture.report()
        return self._shutdown.over(
            orphaned=self._process.orphaned, any_armed=bool(self._recorder.armed), now=monotonic_s
        )

    def _update_counts(self) -> None:
        self._recorder.lost = self._copies.lost()
        self._recorder.unknown = self._copies.senders.unknown


class _Capture:
    """Client with which the recorder receives the frames of one motion capture server.

    raw: its settings, with `simulated`: it is the emulator.
    """

    def __init__(self, process: ProcessContext, raw: Mapping[str, Any]) -> None:
        settings = {key: value for key, value in raw.items() if key != "simulated"} | {"stamps": True}
        self.simulated = bool(raw["simulated"])
        self._process, self._client = process, open_client(settings)
        self._report, self._fault = ChangeReport(), ""

    def poll(self, now_s: float) -> list[CapturedFrame]:
        """Return the motion capture frames that have arrived.

        now_s: run's clock [s].
        """
        try:
            return self._client.poll(now_s)
        except (ArenaError, OSError) as error:
            if str(error) != self._fault:
                self._fault = str(error)
                self._process.event(f"{self._process.name}: motion capture: {error}")
            return []

    def report(self) -> None:
        """Report why no poses arrive, each time the reason changes."""
        news = self._report.changed(self._client.diagnosis())
        if news is not None:
            self._process.event(news)
            print(f"{self._process.name}: {news}", file=sys.stderr, flush=True)

    def close(self) -> None:
        self._client.close()


def _truth_sampler(settings: Mapping[str, Any]) -> TruthSampler | None:
    if not settings["truth"]:
        return None
    return TruthSampler(
        StateReader(settings["truth"]), float(settings["rate_hz"]), simulation_clock=bool(settings["clock"])
    )
