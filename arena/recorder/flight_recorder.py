"""The recorder without sockets: passes received data to the output channels and reports statistics.

The process `recorder` and the fused arena use it. No call blocks.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from arena.kernels.viewer_meters import count_datagrams, count_poses
from arena.mocap.client import CapturedFrame
from arena.process_context import ProcessContext
from arena.recorder.channel_sets import make_channels
from arena.recorder.channels import Datagram, RawChannels, RecordChannels, Recorded
from arena.recorder.event_tail import EventTail
from arena.recorder.mcap_file import Log, MakeChannel, McapFile
from arena.recorder.mcap_records import SchemaData
from arena.recorder.run_clock import RunClock
from arena.recorder.vehicle_watch import VehicleWatch
from arena.wire.flight_record import (
    FILE_NAME,
    METADATA,
    SIMULATION_CLOCK,
    UNIX_CLOCK,
    RecordedVehicle,
    pack_metadata,
)
from arena.wire.truth_rows import TrueStates

if TYPE_CHECKING:
    from arena.recorder.foxglove_server import FoxgloveServer

FLUSH_PERIOD_S = 0.5
"""Time between two writes to the disk [s]: a loss of power loses at most the data of this time and of one wake-up."""
REPORT_PERIOD_S = 1.0
SILENT_S = 60.0
"""Time without a datagram after which no vehicle counts as armed [s]."""
# Both clocks are read this often, and so many readings are kept: an event is read from the disk up to 1.5 s after its time.
_CLOCK_PERIOD_S = 0.02
_CLOCK_READINGS = 128
MakeChannels = Callable[[Mapping[str, Any], Sequence[Recorded], MakeChannel], Sequence[RecordChannels]]


class FlightRecorder:
    """Recorder of one arena. It writes `<folder>/flight.mcap`.

    All settings come from the process's JSON configuration (slice).

    now_s: present time of the run's clock [s].
    own_events: record the events of the run, from its events.jsonl. A replay records those of the recorded flight instead.
    make: makes the channels from the configuration, the vehicles, and a function that creates a channel in the record.
    lost: number of datagrams that the kernel has discarded because the recorder was late.  unknown: number of datagrams of unknown
        senders.  behind: the recorder gets too little CPU time: only the first channels, the raw ones, get datagrams. The owner of
        the socket sets all three.
    Raises OSError if the file cannot be created.
    """

    def __init__(
        self,
        process: ProcessContext,
        now_s: float,
        make: MakeChannels = make_channels,
        *,
        own_events: bool = True,
    ) -> None:
        settings = process.settings
        self._process = process
        self._vehicles = [_recorded(v) for v in settings["vehicles"]]
        self._watches = {v.name: VehicleWatch(v.id) for v in self._vehicles}
        self._counters = {name: watch.datagrams for name, watch in self._watches.items()}
        self._pose_counters = {
            v.body: self._watches[v.name].poses for v in self._vehicles if v.body is not None
        }
        folder = Path(settings["folder"])
        self._file = McapFile(folder / FILE_NAME, METADATA, _metadata(settings, now_s))
        self._server = self._open_viewers(folder)
        self._channels = list(make(settings, self._vehicles, self._channel))
        self._events = EventTail(folder / "events.jsonl") if own_events else None
        self._clock = RunClock(now_s, time.monotonic(), _CLOCK_READINGS)
        self._last_event_s = -math.inf
        self._has_received, self._received_s, self._ticked_s = False, math.inf, 0.0
        self._next_reading = self._next_flush = self._next_report = 0.0
        self._failure = ""
        self.lost = self.unknown = self._left_out = 0
        self.behind = False

    @property
    def path(self) -> Path:
        """Path of the file flight.mcap."""
        return self._file.path

    @property
    def armed(self) -> list[str]:
        """Return the names of the armed vehicles. Return an empty list after SILENT_S seconds without a datagram.

        Without the router, which may have died, the recorder does not receive the disarming, and would wait for it for ever.
        """
        if self._ticked_s - self._received_s > SILENT_S:
            return []
        return [name for name, watch in self._watches.items() if watch.armed]

    def on_datagrams(self, datagrams: list[Datagram]) -> None:
        """Record MAVLink datagrams that vehicles have sent or received, oldest first."""
        self._has_received = True
        for vehicle, data in count_datagrams(datagrams, self._counters):
            if self._watches[vehicle].on_status(data):
                self._report_airborne(vehicle)
        self._left_out += len(datagrams) * self.behind
        for channels in self._channels[:1] if self.behind else self._channels:
            try:
                channels.on_datagrams(datagrams)
            except Exception as error:
                self._remove(channels, error)

    def on_frame(self, frame: CapturedFrame, simulated: bool, time_s: float) -> None:
        """Record one motion capture frame: the poses of all bodies at one instant.

        simulated: the motion-capture emulator sent it.
        time_s: time of reception by the run's clock [s].
        """
        count_poses(frame.poses, self._pose_counters, time_s)
        for channels in self._channels:
            try:
                channels.on_frame(frame, simulated, time_s)
            except Exception as error:
                self._remove(channels, error)

    def on_truth(self, truth: TrueStates, time_s: float) -> None:
        """Record the true state of all simulated vehicles.

        time_s: its time by the run's clock [s].
        """
        for v in self._vehicles:
            if v.index is None:
                continue
            watch = self._watches[v.name]
            if watch.airborne_unix_s is None and watch.is_above_floor(-truth.p_n[v.index][2]):
                self._report_airborne(v.name)
        for channels in self._channels:
            try:
                channels.on_truth(truth, time_s)
            except Exception as error:
                self._remove(channels, error)

    def tick(self, now_s: float, monotonic_s: float) -> None:
        """Record new events, write data to the disk, and send statistics to the supervisor. Call it 10 times per second.

        now_s, monotonic_s: present time by the run's clock and monotonic [s].
        """
        self._ticked_s = monotonic_s
        if self._has_received:
            self._received_s, self._has_received = monotonic_s, False
        if self._server is not None:
            self._server.pass_time(now_s)
        if monotonic_s >= self._next_reading:
            self._next_reading = monotonic_s + _CLOCK_PERIOD_S
            self._clock.update(now_s, monotonic_s)
        if monotonic_s < self._next_flush:
            return
        self._next_flush = monotonic_s + FLUSH_PERIOD_S
        if self._events is not None:
            self._record_events(self._events.take())
            self._events.poll()
        self._file.flush()
        if monotonic_s >= self._next_report:
            self._next_report = monotonic_s + REPORT_PERIOD_S
            self._report_failure()
            self._process.stats(self.stats(now_s))

    def stats(self, now_s: float) -> dict[str, Any]:
        """Return the statistics of the recorder: rates per vehicle, and numbers of lost data.

        now_s: run's clock [s].
        """
        return {
            "vehicles": {name: watch.stats(now_s) for name, watch in self._watches.items()},
            "lost_datagrams": self.lost,
            "unknown_datagrams": self.unknown,
            "not_for_viewers": self._left_out,
            "record": self._failure or "complete",
        }

    def close(self, now_s: float) -> None:
        """Record the last events, complete the file, and send the last statistics.

        now_s: run's clock [s].
        """
        self._clock.update(now_s, time.monotonic())
        if self._events is not None:
            self._record_events(self._events.close())
        self._file.close()
        if self._server is not None:
            self._server.close()
        self._report_failure()
        self._process.stats(self.stats(now_s))

    def _open_viewers(self, folder: Path) -> FoxgloveServer | None:
        """Write the layout files for viewers, and start the Foxglove server if it is configured.

        An error in a viewer never ends the record or the flight.
        """
        from arena.recorder.viewer_setup import open_server, write_layouts

        with suppress(OSError):
            write_layouts(self._process.settings, folder)
        server = open_server(self._process.settings)
        if server is not None:
            self._process.event(server.failure or f"live view for Foxglove at {server.url}")
        return server

    def _channel(self, topic: str, encoding: str, schema: SchemaData) -> Log:
        """Create a channel in the record. If there is a server for viewers, they receive the channel during the flight."""
        log = self._file.channel(topic, encoding, schema)
        return log if self._server is None else self._server.channel(topic, encoding, schema, log)

    def _record_events(self, lines: Sequence[bytes]) -> None:
        for line in lines:
            fields: Any = None
            with suppress(ValueError):
                fields = json.loads(line)
            if isinstance(fields, dict):
                self._record_event(line, fields)

    def _record_event(self, line: bytes, fields: Mapping[str, Any]) -> None:
        """Record an event line at the time of the event, but never earlier than the previous line.

        The monotonic times of the lines are not in order, and the order of the lines must be that of their times in the record.
        """
        at = fields.get("mono")
        time_s = self._clock.at(float(at) if isinstance(at, int | float) else time.monotonic())
        self._last_event_s = max(self._last_event_s, time_s)
        self.on_event(line, fields, self._last_event_s)

    def on_event(self, line: bytes, fields: Mapping[str, Any], time_s: float) -> None:
        """Record one line of events.jsonl.

        line: the JSON object as bytes.
        fields: its content.
        time_s: log time by the run's clock [s].
        """
        for channels in self._channels:
            try:
                channels.on_event(line, fields, time_s)
            except Exception as error:
                self._remove(channels, error)

    def _remove(self, channels: RecordChannels, error: Exception) -> None:
        """Remove a failed output from the recorder. The other outputs continue."""
        self._channels = [other for other in self._channels if other is not channels]
        if isinstance(channels, RawChannels):
            self._failure = self._failure or f"error: {error!r}"
        self._process.event(
            f"{self._process.name}: the output {type(channels).__name__} has failed and writes no more data: {error!r}"
        )

    def _report_airborne(self, vehicle: str) -> None:
        self._watches[vehicle].airborne_unix_s = time.time()
        self._process.event(f"{vehicle}: airborne")

    def _report_failure(self) -> None:
        """Report once why the recorder has stopped writing the record."""
        if self._file.failure and not self._failure:
            self._failure = self._file.failure
            self._process.event(
                f"{self._process.name}: the record of the flight has ended, because {self._file.path} cannot be written: "
                f"{self._failure}. The flight goes on"
            )


def _recorded(raw: Mapping[str, Any]) -> Recorded:
    index = raw["index"]
    return Recorded(
        name=str(raw["name"]),
        id=int(raw["id"]),
        body=raw["body"],
        index=None if index is None else int(index),
    )


def _metadata(settings: Mapping[str, Any], now_s: float) -> dict[str, str]:
    return pack_metadata(
        name=str(settings["arena"]),
        clock=SIMULATION_CLOCK if settings["clock"] else UNIX_CLOCK,
        start_s=now_s,
        start_unix_s=time.time(),
        size_m=settings["size_m"],
        fence=settings.get("fence"),
        obstacles=settings.get("obstacles") or (),
        vehicles=[
            RecordedVehicle(
                name=str(v["name"]),
                id=int(v["id"]),
                body=str(v["body"]),
                simulated=v["index"] is not None,
                autopilot=str(v["autopilot"]),
                profile=str(v["profile"]),
            )
            for v in settings["vehicles"]
        ],
    )
