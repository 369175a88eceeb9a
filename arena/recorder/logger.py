"""The logger process: receives data by sockets and shared memory, passes them to a `Recorder`, and writes the log file.

A logger must never send data to a vehicle.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any, Protocol, TextIO

from arena.clock import Clock, SimClock, WallClock
from arena.errors import ArenaError, RunError
from arena.mocap.client import ChangeReport, MocapClient, open_client
from arena.process_context import ProcessContext, ShutdownPolicy
from arena.recorder.recorder import Recorder, rates
from arena.transport import listen_udp
from arena.wire.truth_page import Truth, TruthReader

REPORT_PERIOD_S = 1.0
MAX_DATAGRAMS = 2000  # per row, so that a flood of datagrams does not stop the log
AIRBORNE_HEIGHT_M = 0.05


class DatagramSource(Protocol):
    """Socket from which the logger receives the vehicle's messages. `recv` raises OSError if nothing has arrived."""

    def recv(self, size: int, /) -> bytes: ...

    def close(self) -> None: ...


class Logger:
    """Logger of one vehicle, which writes `<folder>/<vehicle>.csv` with `rate_hz` rows per second.

    The log begins at the first message of the vehicle. All settings come from the JSON configuration (slice) of the process.
    clock, capture, source, truth: clock, motion-capture client, source of the vehicle's MAVLink datagrams, and reader of the
        ground truth in shared memory; None: opened as the configuration says.
    """

    def __init__(
        self,
        room: ProcessContext,
        clock: Clock | None = None,
        capture: MocapClient | None = None,
        source: DatagramSource | None = None,
        truth: TruthReader | None = None,
    ) -> None:
        settings = room.settings
        self._room = room
        self._vehicle, self._body = str(settings["vehicle"]), settings.get("body")
        self._recorder = Recorder(settings["id"], settings["index"] if settings.get("truth") else None)
        self._clock: Clock = _clock(room) if clock is None else clock
        self._wall_offset = 0.0 if settings.get("clock") else time.time() - time.monotonic()
        self._truth = TruthReader(settings["truth"]) if settings.get("truth") and truth is None else truth
        self._capture = _capture(settings) if capture is None else capture
        self._socket: DatagramSource = listen_udp(tuple(settings["listen"])) if source is None else source
        folder = Path(settings["folder"])
        folder.mkdir(parents=True, exist_ok=True)
        self._file = _open_csv(folder / f"{self._vehicle}.csv", self._recorder.header)
        self._rate_hz = float(settings["rate_hz"])
        self._shutdown = ShutdownPolicy(limit_s=60.0 if settings.get("simulated", True) else None)
        self._reported = 0.0
        self._fault = ""
        self._mocap_report = ChangeReport()
        self._floor: float | None = None
        self._airborne_unix_s: float | None = None

    def run(self) -> None:
        """Write the log until SIGTERM arrives or the simulated world ends. If the supervisor has died, end when the vehicle is
        disarmed.
        """
        rate = self._clock.rate(self._rate_hz)
        while not self._room.stopping:
            try:
                now = rate.sleep()
            except RunError:
                self._room.event(f"{self._room.name}: the world has ended, so the log ends")
                return
            if self.step(now):
                return

    def step(self, now: float) -> bool:
        """Receive all data, and write the rows of the log that are complete. now: time of the logger's clock [s].

        Return whether the logger must end, because the supervisor is dead and the vehicle is disarmed.
        """
        self._receive(now)
        if self._recorder.first_received is not None:
            self._sample(self._clock.now())  # not `now`: a state received meanwhile belongs to this row
        self._file.writelines(self._recorder.take_rows(now))
        return self._once_a_second()

    def close(self) -> None:
        """Write the remaining rows, send the last statistics to the supervisor, and close file and sockets."""
        self._file.writelines(self._recorder.take_rows())
        self._room.stats(self._stats())
        self._file.close()
        self._socket.close()
        if self._capture is not None:
            self._capture.close()

    def _receive(self, now: float) -> None:
        for _ in range(MAX_DATAGRAMS):
            try:
                datagram = self._socket.recv(65535)
            except OSError:
                break
            # Not `now`: on a busy computer the logger wakes late, and the estimate would seem to come from the future.
            self._recorder.receive(datagram, self._clock.now())
        if self._capture is not None:
            try:
                self._receive_poses(self._capture, now)
            except (ArenaError, OSError) as error:
                self._report_fault(f"motion capture: {error}")

    def _receive_poses(self, capture: MocapClient, now: float) -> None:
        for frame in capture.poll(now):
            for pose in frame.poses:
                if pose.body == self._body:
                    self._recorder.receive_pose(pose.p_n, pose.q_nb, frame.time_s, self._clock.now())

    def _sample(self, now: float) -> None:
        truth = None
        if self._truth is not None:
            truth = self._truth.at(now) or self._truth.newest()
        if self._airborne_unix_s is None and self._is_airborne(truth):
            self._airborne_unix_s = time.time()
            self._room.event(f"{self._vehicle}: airborne")
        self._recorder.sample(now, now + self._wall_offset, truth)

    def _is_airborne(self, truth: Truth | None) -> bool:
        """Return whether the vehicle is in the air, computed from the ground truth. Without ground truth,
        PX4's land detector is used.
        """
        if truth is None:
            ground = self._recorder.telemetry.ground
            return self._recorder.armed and ground is not None and not ground.landed
        down = float(truth.p_n[self._room.settings["index"], 2])
        self._floor = down if self._floor is None else self._floor
        return down < self._floor - AIRBORNE_HEIGHT_M

    def _stats(self) -> dict[str, Any]:
        found: dict[str, Any] = dict(rates(self._recorder, self._clock.now()))
        return (
            found
            if self._airborne_unix_s is None
            else {**found, "airborne_unix_s": round(self._airborne_unix_s, 3)}
        )

    def _once_a_second(self) -> bool:
        """Flush the log file and send statistics, such as rows per second, to the supervisor. Called once per
        second of wall time.

        Return whether the logger must end, because the supervisor is dead and the vehicle is disarmed.
        """
        wall = time.monotonic()
        if wall - self._reported < REPORT_PERIOD_S:
            return False
        self._reported = wall
        self._file.flush()
        self._room.stats(self._stats())
        self._report_capture()
        return self._shutdown.over(orphaned=self._room.orphaned, any_armed=self._recorder.armed, now=wall)

    def _report_capture(self) -> None:
        """Report why no motion-capture poses arrive, each time the reason changes."""
        if self._capture is None:
            return
        news = self._mocap_report.changed(self._capture.diagnosis())
        if news is not None:
            self._room.event(news)
            print(f"logger: {news}", file=sys.stderr, flush=True)

    def _report_fault(self, fault: str) -> None:
        """Report a problem of the logger as an event, unless it is the same as the last reported problem."""
        if fault != self._fault:
            self._fault = fault
            self._room.event(f"{self._room.name}: {fault}")


def _open_csv(path: Path, header: str) -> TextIO:
    """Open the log file and write the header. If the file already has this header, append after the last complete row.

    Such a file is from a logger that was killed and restarted in the same run.
    """
    written = path.read_bytes() if path.exists() else b""
    whole = written[: written.rfind(b"\n") + 1] if written.startswith(header.encode()) else b""
    file = path.open("r+" if whole else "w")
    file.truncate(len(whole))
    file.seek(0, 2)
    if not whole:
        file.write(header)
        file.flush()
    return file


def _clock(room: ProcessContext) -> Clock:
    path = room.settings.get("clock")
    return SimClock(path, room.name) if path else WallClock()


def _capture(settings: dict[str, Any]) -> MocapClient | None:
    return open_client(settings["capture"]) if settings.get("capture") else None
