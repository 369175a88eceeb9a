"""Main loop of a replay: it advances the clock, handles supervisor requests, and sends the messages."""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Mapping
from typing import Any

from arena.clock_server import ClockServer
from arena.process_context import ProcessContext
from arena.replay.outputs import Outputs
from arena.replay.playback import Playback
from arena.replay.script import NS, Kind, Script
from arena.simulation_speed import speed_of

_MILLI_S = 1e-3
_MAX_WAIT_S = 0.02
_CHECK_S, _STATS_S = 0.05, 0.25


class ReplayLoop:
    """Main loop of a replay: sends the recorded messages until a stop is requested.

    It serves the simulation clock for all processes of the replay.

    At speed 1 the clock follows the wall clock, as the world does. At another speed it waits for the programs that sleep on it.
    """

    def __init__(
        self, process: ProcessContext, slices: Mapping[str, Mapping[str, Any]], script: Script
    ) -> None:
        settings, wall = process.settings, time.monotonic()
        self._process, self._script = process, script
        speed = speed_of(settings["speed"])
        self._stay = bool(settings["stay"])
        self._lockstep = speed != 1.0
        self.playback = Playback(
            script,
            wall=wall,
            start_ns=script.start_ns + round(NS * float(settings["from_s"])),
            speed=speed,
            loop=bool(settings["loop"]),
            paused=bool(settings["paused"]),
        )
        self._outputs = Outputs(process, slices, script, self.playback.clock_ns / NS)
        self._clock = ClockServer(settings["clock"], lockstep=self._lockstep)
        self._clock.tick(self.playback.clock_ns / NS)
        self._dropped = 0
        self._rate_from = (wall, self.playback.record_ns)
        self._next_check = self._next_stats = wall
        self._at_end = False

    def run(self) -> None:
        """Send the messages at their times until a stop signal arrives or the supervisor has died."""
        self._process.ready()
        gc.collect()
        gc.freeze()  # a full garbage collection then skips the objects of the libraries, and takes less than 1 ms
        self.playback.start(time.monotonic())
        while not self._process.stopping:
            wall = time.monotonic()
            if wall >= self._next_check and self._check(wall):
                return
            wait_s = self.playback.wait_s(wall)
            if wait_s > 0.0:
                self._outputs.serve(self.playback, wall)
                self._idle(min(wait_s, _MAX_WAIT_S))
                continue
            if self._lockstep and not self._clients_sleep():
                continue
            self._outputs.serve(self.playback, wall)
            step = self.playback.step(wall)
            self._outputs.send(step)
            self._clock.tick(step.clock_ns / NS)

    def close(self) -> None:
        """Complete the new record, and close all sockets and shared memory."""
        self._process.stats(self._stats(time.monotonic()))
        self._outputs.close()
        self._clock.close()

    def _idle(self, left_s: float) -> None:
        """Wait until the next step, and meanwhile reply to the programs that use the simulation clock.

        left_s: wall time [s].
        """
        if left_s > 2.0 * _MILLI_S:
            self._clock.poll((math.floor(left_s / _MILLI_S) - 1) * _MILLI_S)
        else:
            time.sleep(left_s)

    def _clients_sleep(self) -> bool:
        """Return whether all programs wait on the simulation clock, so that time may advance.

        Blocks for 1 ms at most.
        """
        now_s = self.playback.clock_ns / NS
        if self._clock.may_advance(now_s, time.monotonic()):
            return True
        if self._clock.wait_for_requests(_MILLI_S):
            return self._clock.may_advance(now_s, time.monotonic())
        self._outputs.serve(self.playback, time.monotonic())
        return False

    def _check(self, wall: float) -> bool:
        """Carry out the requests of the supervisor, and send statistics. Return whether the replay must end."""
        self._next_check = wall + _CHECK_S
        for request in self._process.requests():
            if request.get("do") == "replay":
                self._change(request, wall)
                self._next_stats = wall
            else:
                self._outputs.on_request(request)
            self._process.confirm(request)
        for name in self._clock.dropped[self._dropped :]:
            self._dropped += 1
            self._process.event(
                f"{name} has been busy for more than 1 s, without a request to the simulation clock: "
                f"the replay continues without waiting for {name}"
            )
        if self.playback.finished and not self._at_end:
            self._next_stats = wall
        self._at_end = self.playback.finished
        if wall >= self._next_stats:
            self._next_stats = wall + _STATS_S
            self._process.stats(self._stats(wall))
        return self._process.orphaned

    def _change(self, request: Mapping[str, Any], wall: float) -> None:
        """Carry out a request to pause, continue, jump or change the speed."""
        playback = self.playback
        if "speed" in request:
            playback.set_speed(speed_of(request["speed"]), wall)
        if "pause" in request:
            playback.pause(request["pause"] is True, wall)
        if "seek_s" in request:
            playback.seek(self._script.start_ns + round(NS * float(request["seek_s"])), wall)

    def _stats(self, wall: float) -> dict[str, Any]:
        playback, script = self.playback, self._script
        before, place = self._rate_from
        rate = (playback.record_ns - place) / NS / (wall - before) if wall > before else 0.0
        if wall - before >= 1.0:
            self._rate_from = wall, playback.record_ns
        sent = self._outputs.sent
        return {
            "time_s": round((playback.record_ns - script.start_ns) / NS, 3),
            "duration_s": round((script.end_ns - script.start_ns) / NS, 3),
            "speed": "max" if math.isinf(playback.speed) else playback.speed,
            "paused": playback.paused,
            "finished": playback.finished and not self._stay,
            "rtf": round(max(rate, 0.0), 3),
            "sent": {kind.name.lower(): sent[kind] for kind in Kind},
            "refused": dict(self._outputs.refusals.counts),
        }
