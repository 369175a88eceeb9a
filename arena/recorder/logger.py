"""The shell of a logger: sockets, pages and a file around a Recorder. It only listens: no client of its own reaches a vehicle."""

from __future__ import annotations

import socket
import sys
import time
from pathlib import Path
from typing import Any, TextIO

from arena.clock import Clock, SimClock, WallClock
from arena.errors import ArenaError, RunError
from arena.mocap.client import Complaint, NatNetCapture, open_capture
from arena.process_context import ProcessContext, ShutdownPolicy
from arena.recorder.recorder import Recorder, rates
from arena.wire.truth_page import Truth, TruthReader

_LOOK_S = 1.0
_MOST = 2000
_OFF_THE_FLOOR_M = 0.05


class Logger:
    """Writes `<folder>/<vehicle>.csv`, one row every 1/rate_hz [s] from the moment the vehicle is heard."""

    def __init__(self, room: ProcessContext) -> None:
        settings = room.settings
        self._room = room
        self._vehicle, self._body = str(settings["vehicle"]), settings.get("body")
        self._recorder = Recorder(settings["id"], settings["index"] if settings.get("truth") else None)
        self._clock: Clock = SimClock(settings["clock"], room.name) if settings.get("clock") else WallClock()
        self._wall_offset = 0.0 if settings.get("clock") else time.time() - time.monotonic()
        self._truth = TruthReader(settings["truth"]) if settings.get("truth") else None
        self._capture = _capture(settings)
        self._socket = _listen(tuple(settings["listen"]))
        folder = Path(settings["folder"])
        folder.mkdir(parents=True, exist_ok=True)
        self._file = _go_on(folder / f"{self._vehicle}.csv", self._recorder.header)
        self._rate_hz = float(settings["rate_hz"])
        self._afterlife = ShutdownPolicy(limit_s=60.0 if settings.get("simulated", True) else None)
        self._looked = 0.0
        self._fault = ""
        self._complaint = Complaint()
        self._floor: float | None = None
        self._airborne_unix_s: float | None = None

    def run(self) -> None:
        """Until told to stop, the world ends, or the supervisor is dead and the vehicle disarmed."""
        rate = self._clock.rate(self._rate_hz)
        while not self._room.stopping:
            try:
                now = rate.sleep()
            except RunError:
                self._room.event(f"{self._room.name}: the world has ended, and the log with it")
                return
            self._listen(now)
            if self._recorder.first_heard is not None:
                self._write(now)
            if self._look():
                return

    def close(self) -> None:
        self._room.stats(self._stats())
        self._file.close()
        self._socket.close()
        if self._capture is not None:
            self._capture.close()

    def _listen(self, now: float) -> None:
        for _ in range(_MOST):
            try:
                datagram = self._socket.recv(65535)
            except OSError:
                break
            # The time of waking may be long past on a busy computer, and an estimate must not seem to come from the future.
            self._recorder.hear(datagram, self._clock.now())
        if self._capture is not None:
            try:
                self._hear_capture(self._capture, now)
            except (ArenaError, OSError) as error:
                self._blame(f"motion capture: {error}")

    def _hear_capture(self, capture: NatNetCapture, now: float) -> None:
        for frame in capture.poll(now):
            for pose in frame.poses:
                if pose.body == self._body:
                    self._recorder.hear_pose(pose.p_n, pose.q_nb, now)

    def _write(self, now: float) -> None:
        truth, then = self._look_at_truth()
        if self._airborne_unix_s is None and self._is_airborne(truth):
            self._airborne_unix_s = time.time()
            self._room.event(f"{self._vehicle}: airborne")
        self._file.write(self._recorder.row(now, now + self._wall_offset, truth, then))

    def _look_at_truth(self) -> tuple[Truth | None, Truth | None]:
        if self._truth is None:
            return None, None
        at = self._recorder.estimated_at()
        return self._truth.newest(), None if at is None else self._truth.at(at)

    def _is_airborne(self, truth: Truth | None) -> bool:
        """By the truth where there is one, else by the autopilot's land detector."""
        if truth is None or self._truth is None:
            ground = self._recorder.telemetry.ground
            return self._recorder.armed and ground is not None and not ground.landed
        down = float(truth.p_n[self._room.settings["index"], 2])
        self._floor = down if self._floor is None else self._floor
        return down < self._floor - _OFF_THE_FLOOR_M

    def _stats(self) -> dict[str, Any]:
        found: dict[str, Any] = dict(rates(self._recorder, self._clock.now()))
        return (
            found
            if self._airborne_unix_s is None
            else {**found, "airborne_unix_s": round(self._airborne_unix_s, 3)}
        )

    def _look(self) -> bool:
        """Once a second of wall time: flush, tell, and ask whether there is anything left to do."""
        wall = time.monotonic()
        if wall - self._looked < _LOOK_S:
            return False
        self._looked = wall
        self._file.flush()
        self._room.stats(self._stats())
        self._complain()
        return self._afterlife.over(orphaned=self._room.orphaned, any_armed=self._recorder.armed, now=wall)

    def _complain(self) -> None:
        """Why no captured pose comes, once."""
        if self._capture is None:
            return
        news = self._complaint.news(self._capture.trouble())
        if news is not None:
            self._room.event(news)
            print(f"logger: {news}", file=sys.stderr, flush=True)

    def _blame(self, fault: str) -> None:
        """Told when it changes, not thirty times a second."""
        if fault != self._fault:
            self._fault = fault
            self._room.event(f"{self._room.name}: {fault}")


def _go_on(path: Path, header: str) -> TextIO:
    """What a killed logger of this run has begun goes on after its last whole row: there is a gap, and no flight is lost."""
    written = path.read_bytes() if path.exists() else b""
    whole = written[: written.rfind(b"\n") + 1] if written.startswith(header.encode()) else b""
    file = path.open("r+" if whole else "w")
    file.truncate(len(whole))
    file.seek(0, 2)
    if not whole:
        file.write(header)
        file.flush()
    return file


def _listen(address: tuple[str, int]) -> socket.socket:
    found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    found.setblocking(False)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    try:
        found.bind(address)
    except OSError as error:
        found.close()
        raise RunError(f"cannot listen on UDP {address[0]}:{address[1]}: {error.strerror}") from error
    return found


def _capture(settings: dict[str, Any]) -> NatNetCapture | None:
    return open_capture(settings["capture"]) if settings.get("capture") else None
