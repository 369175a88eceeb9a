"""Live state of a running arena for viewers, such as `arena monitor`.

After the end of the arena, the feed waits for the next arena.

The feed only receives. It opens no port of the arena, is no client of the simulation clock, and sends nothing to a vehicle.
"""

from __future__ import annotations

import contextlib
import json
import time
from pathlib import Path
from typing import Any

from arena.clock import SimTime
from arena.errors import ArenaError, RunError
from arena.live_view.fleet import FleetTracker
from arena.live_view.planned_paths import PlannedPaths
from arena.live_view.run_status import RunStatus
from arena.live_view.settings import Settings
from arena.live_view.snapshot import (
    EventList,
    Playback,
    ProcessRow,
    ShownTime,
    Snapshot,
    playback_of,
    process_rows,
    real_time_factor,
)
from arena.live_view.tools_ports import ToolsPorts
from arena.mocap.client import MocapClient, open_client
from arena.supervisor import RunState, active_runs, open_run
from arena.wire.truth_page import TruthReader

SEARCH_PERIOD_S = 0.5
_TAIL_BYTES = 1 << 18  # of events.jsonl that are read when the feed begins


class LiveFeed:
    """Source of the newest state of the running arena. Call `poll` before each picture; it does not block.

    run: folder of the run to watch; None watches the only running arena, and the next one when it has ended.
    """

    def __init__(self, run: Path | None = None) -> None:
        self._wanted = None if run is None else run.resolve()
        self._open: _OpenRun | None = None
        self._next_search = float("-inf")
        self.waiting_for = ""

    def poll(self, now: float | None = None) -> Snapshot | None:
        """Return the present state of the arena, or None if no arena is running.

        In the second case, `waiting_for` contains the reason. now: monotonic [s].
        """
        now = time.monotonic() if now is None else now
        if now >= self._next_search:
            self._next_search = now + SEARCH_PERIOD_S
            self._search()
        return None if self._open is None else self._open.poll(now)

    def close(self) -> None:
        """Close all connections to the running arena."""
        if self._open is not None:
            self._open.close()
        self._open = None

    def _search(self) -> None:
        if self._open is not None and not self._open.has_ended:
            return
        self.close()
        try:
            if (state := self._find()) is not None:
                self._open = _OpenRun(state)
                self.waiting_for = ""
        except (ArenaError, OSError, ValueError) as error:
            self.waiting_for = str(error)

    def _find(self) -> RunState | None:
        if self._wanted is not None:
            state = open_run(self._wanted)
            found = [state] if state is not None else []
        else:
            found = active_runs()
        live = [state for state in found if _is_up(state)]
        if len(live) > 1:
            folders = ", ".join(state.run for state in live)
            self.waiting_for = f"{len(live)} arenas are running; choose one with --run: {folders}"
            return None
        self.waiting_for = "" if live else "no arena is running. Start one with `arena up`"
        return live[0] if live else None


class _OpenRun:
    """Connections of a viewer to one running arena: telemetry, status, true states, captured poses, events."""

    def __init__(self, state: RunState) -> None:
        self._state, self._run = state, Path(state.run)
        raw = json.loads((self._run / "slices" / "view.json").read_text())
        self.settings = Settings.from_slice(raw)
        self._tracker = FleetTracker(self.settings.vehicles)
        self._events = EventList(v.name for v in self.settings.vehicles)
        self._shown = ShownTime()
        self._ports = ToolsPorts([v.tools for v in self.settings.vehicles], self._on_datagram)
        self._status = RunStatus(Path(state.rt) / "control.sock")
        self._captures: list[MocapClient] = []
        for capture in self.settings.captures:
            with contextlib.suppress(ArenaError, OSError):  # poses then come from the estimates
                self._captures.append(open_client(dict(capture)))
        self._truth: TruthReader | None = None
        self._sim_time: SimTime | None = None
        self._tail = _Tail(self._run / "events.jsonl")
        self._paths = PlannedPaths(self.settings.paths, [v.name for v in self.settings.vehicles])
        self._number = -1
        self._processes: tuple[ProcessRow, ...] = ()
        self._playback: Playback | None = None
        self._slow_at = float("-inf")

    @property
    def has_ended(self) -> bool:
        """True if the run has ended.

        If the supervisor has died, the run ends with its last process.
        """
        return not self._state.live and not _is_up(open_run(self._run))

    def poll(self, now: float) -> Snapshot:
        self._shown.update(now, self._playback)
        self._ports.poll(now)
        for capture in self._captures:
            with contextlib.suppress(OSError, ArenaError):
                self._tracker.on_frames(capture.poll(now), self._shown.at(now))
        if now >= self._slow_at:
            self._slow_at = now + SEARCH_PERIOD_S
            self._open_pages()
            self._paths.poll()
            self._events.on_lines(self._tail.read())
        if self._truth is not None and (truth := self._truth.newest()) is not None:
            self._tracker.on_truth(truth, self._shown.at(now))
        number, status = self._status.newest
        if number != self._number:
            self._number = number
            self._tracker.on_status(status)
            self._events.on_status(status)
            self._processes, self._playback = process_rows(status), playback_of(status)
        return self._snapshot(now, status)

    def _on_datagram(self, row: int, data: bytes, now: float) -> None:
        self._shown.receive(now)
        self._tracker.on_datagram(row, data, self._shown.at(now))

    def close(self) -> None:
        self._ports.close()
        self._status.close()
        for capture in self._captures:
            capture.close()

    def _snapshot(self, now: float, status: dict[str, Any]) -> Snapshot:
        time_s = self._sim_time.now() if self._sim_time is not None else status.get("time_s") or 0.0
        return Snapshot(
            run=self._run,
            name=self._state.name,
            phase=str(status.get("phase") or "starting"),
            time_s=float(time_s),
            real_time_factor=real_time_factor(status),
            answers=self._status.answers(now),
            settings=self.settings,
            fleet=self._tracker.snapshot(self._shown.at(now)),
            processes=self._processes,
            events=self._events.newest,
            playback=self._playback,
            paths=self._paths.newest,
        )

    def _open_pages(self) -> None:
        """Open the shared memory with the true states and the simulation clock, if the world has created it."""
        with contextlib.suppress(RunError):
            if self._truth is None and self.settings.truth is not None:
                self._truth = TruthReader(self.settings.truth)
            if self._sim_time is None and self.settings.clock is not None:
                self._sim_time = SimTime(self.settings.clock)


def _is_up(state: RunState | None) -> bool:
    return state is not None and (state.live or bool(state.survivors()))


class _Tail:
    """Reader of the lines that another process adds to a file, such as events.jsonl.

    path: the file, which may not exist yet. The first call of `read` starts near the end of the file.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._at, self._part = path, 0, b""
        with contextlib.suppress(OSError):
            self._at = max(0, path.stat().st_size - _TAIL_BYTES)

    def read(self) -> list[bytes]:
        """Return the complete lines that were added to the file since the last call."""
        try:
            with self._path.open("rb") as file:
                file.seek(self._at)
                data = file.read(_TAIL_BYTES)
        except OSError:
            return []
        self._at += len(data)
        *lines, self._part = (self._part + data).split(b"\n")
        return lines
