"""State of a whole arena at one instant: the run, its processes, its events and its vehicles. Pure."""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from arena.live_view.fleet import FleetSnapshot
from arena.live_view.planned_paths import Array
from arena.live_view.settings import Settings
from arena.supervisor.messages import Level, VehicleChanges, event_level, transition_text
from arena.supervisor.process_state import State

MAX_EVENTS = 500
"""Number of events that a snapshot contains."""


@dataclass(frozen=True, kw_only=True)
class ProcessRow:
    """A process of the arena, as `arena ps` shows it.

    state: name of the state, such as READY.  cpu: [cores].  memory_mb: resident memory [MB].
    member_of: name of the process that runs this part of the arena; "" for a process of its own.
    vehicle: name of the vehicle that the process serves; "" if it serves all or none.
    rates: measured rates of the process, such as {"pose": 60.0} [1/s].
    """

    name: str
    kind: str
    state: str
    reason: str
    cpu: float
    memory_mb: float
    restarts: int
    member_of: str
    vehicle: str = ""
    rates: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Event:
    """An event of a run, as one line of text for the operator.

    number: count of events before this one.  time_s: time of the run [s], as in `Snapshot`; None before the world runs.
    source: process or vehicle.  text: what happened.
    detail: true for events of every normal flight, such as the start of a process.
    """

    number: int
    time_s: float | None
    source: str
    text: str
    detail: bool


@dataclass(frozen=True, kw_only=True)
class Playback:
    """Position of a replay in the recorded flight: present time, duration, and whether it is paused.

    time_s: [s] from the begin of the record.  duration_s: length of the record [s].
    """

    time_s: float
    duration_s: float
    paused: bool

    @property
    def is_still(self) -> bool:
        """True if the replay is paused or at its end."""
        return self.paused or self.time_s >= self.duration_s


class ShownTime:
    """Time [s] that does not advance while a replay is paused or at its end, so that the values that are shown do not become old.

    All times `now` are monotonic [s].
    """

    def __init__(self) -> None:
        self._stood_s, self._was_still = 0.0, False
        self._updated_at = self._received_at = math.nan

    def receive(self, now: float) -> None:
        """Store the time of a message from a vehicle. Call this for each message."""
        self._received_at = now

    def update(self, now: float, playback: Playback | None) -> None:
        """Stop or continue the shown time. Call this regularly.

        The supervisor reports a pause late, so the time stops at the newest message before the pause.

        playback: position of the replay; None if the arena is not a replay
        """
        is_still = playback is not None and playback.is_still
        if is_still:
            since = (
                self._updated_at if self._was_still or math.isnan(self._received_at) else self._received_at
            )
            self._stood_s += 0.0 if math.isnan(since) else now - since
        self._updated_at, self._was_still = now, is_still

    def at(self, now: float) -> float:
        """Return the shown time [s]. now: monotonic [s]"""
        return now - self._stood_s


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """State of a running arena at one instant.

    run: path of the run folder.  name: name of the arena.  phase: such as `running`, as `arena ps` shows it.
    time_s: simulation time [s]; without a simulated world the time since the start.
    real_time_factor: simulated seconds per second; None without a simulated world.
    answers: false if the supervisor does not reply, so that processes and phase are old.
    events: newest events, oldest first.
    playback: None unless the arena is a replay.
    paths: planned path of each vehicle [m] [NED] (k, 3), without points if unknown.  The same tuple until a path changes.
    """

    run: Path
    name: str
    phase: str
    time_s: float
    real_time_factor: float | None
    answers: bool
    settings: Settings
    fleet: FleetSnapshot
    processes: tuple[ProcessRow, ...]
    events: tuple[Event, ...]
    playback: Playback | None = None
    paths: tuple[Array, ...] = ()


def process_rows(status: Mapping[str, Any]) -> tuple[ProcessRow, ...]:
    """Return one row per process of the arena, from the supervisor's reply to the request `view`."""
    return tuple(
        ProcessRow(
            name=name,
            kind=str(row["kind"]),
            state=str(row["state"]),
            reason=str(row["reason"] or ""),
            cpu=float(row["cpu_now"] or 0.0),
            memory_mb=float(row["rss_mb"] or 0.0),
            restarts=int(row["restarts"] or 0),
            member_of=str(row.get("member_of") or ""),
            vehicle=str(row.get("vehicle") or ""),
            rates=_rates(row.get("stats") or {}),
        )
        for name, row in (status.get("processes") or {}).items()
    )


def _rates(stats: Mapping[str, Any]) -> dict[str, float]:
    found = [(name, value) for name, value in stats.items() if name.endswith("_hz")]
    return {name.removesuffix("_hz"): float(value) for name, value in found if isinstance(value, int | float)}


def real_time_factor(status: Mapping[str, Any]) -> float | None:
    """Return the real-time factor of a simulation or replay, or None if the status contains none.

    status: reply of the supervisor to the request `view`.
    """
    for row in (status.get("processes") or {}).values():
        if row["kind"] in ("world", "replay") and (found := (row["stats"] or {}).get("rtf")) is not None:
            return float(found)
    return None


def playback_of(status: Mapping[str, Any]) -> Playback | None:
    """Return the position of a replay in the recorded flight, or None if the arena is not a replay.

    status: reply of the supervisor to the request `view`.
    """
    for row in (status.get("processes") or {}).values():
        stats = row["stats"] or {}
        if row["kind"] == "replay" and "duration_s" in stats:
            return Playback(
                time_s=float(stats["time_s"]),
                duration_s=float(stats["duration_s"]),
                paused=stats.get("paused") is True,
            )
    return None


class EventList:
    """The newest events of a run: lines of events.jsonl, and changes of a vehicle's state such as `armed`.

    vehicles: names of the vehicles.
    """

    def __init__(self, vehicles: Iterable[str]) -> None:
        self._vehicles = frozenset(vehicles)
        self._changes = VehicleChanges()
        self._events: deque[Event] = deque(maxlen=MAX_EVENTS)
        self._count = 0
        self._has_facts = False

    @property
    def newest(self) -> tuple[Event, ...]:
        """Return the newest events, oldest first."""
        return tuple(self._events)

    def on_lines(self, lines: Iterable[bytes]) -> None:
        """Add new lines of the file events.jsonl to the list.

        Requests to vehicles (entries `audit`, for `arena audit`) and lines that cannot be read are left out.
        """
        for line in lines:
            try:
                self._on_entry(json.loads(line))
            except (ValueError, KeyError, TypeError, AttributeError):
                continue

    def on_status(self, status: Mapping[str, Any]) -> None:
        """Add an event for each state of a vehicle (such as `armed`) that has changed since the last call.

        status: reply of the supervisor to the request `view`.
        """
        messages = self._changes.on_facts(status.get("facts") or {})
        for message in messages if self._has_facts else ():  # the first facts are no changes
            self._add(_seconds(status.get("time_s")), message.source, message.text, detail=False)
        self._has_facts = True

    def _on_entry(self, raw: Mapping[str, Any]) -> None:
        time_s, process = _seconds(raw.get("time_s")), str(raw["process"])
        if "event" in raw:
            vehicle, _, about = str(raw["event"]).partition(": ")
            source, text = (vehicle, about) if vehicle in self._vehicles else (process, str(raw["event"]))
            self._add(time_s, source, text, detail=event_level(str(raw["event"])) is Level.DETAIL)
        elif "to" in raw:
            after = State(raw["to"])
            text = transition_text(after, str(raw["reason"] or ""))
            self._add(time_s, process, text, detail=after in (State.STARTING, State.READY))

    def _add(self, time_s: float | None, source: str, text: str, *, detail: bool) -> None:
        self._events.append(Event(number=self._count, time_s=time_s, source=source, text=text, detail=detail))
        self._count += 1


def _seconds(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) else None
