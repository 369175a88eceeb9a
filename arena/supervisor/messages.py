"""Text and importance of the lines that a run shows to the user. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from arena.plan.model import Plan
from arena.supervisor.process_state import State


class Level(IntEnum):
    """Importance of a line of output. The options -q and -v of `arena up` select which lines are shown."""

    DETAIL = 0
    """Shown with -v only."""
    CHANGE = 1
    """Shown by default."""
    RESULT = 2
    """Shown with -q too."""


@dataclass(frozen=True, kw_only=True)
class Message:
    """A line of text that `arena up` shows to a person, with its source, importance and time.

    source: the process or vehicle that the line is about; "" for none.
    time_s: simulated time [s], None before the world runs. Without a simulated world: time since the start [s].
    """

    text: str
    source: str = ""
    level: Level = Level.CHANGE
    time_s: float | None = None

    def __str__(self) -> str:
        line = f"{self.source}: {self.text}" if self.source else self.text
        return line if self.time_s is None else f"{self.time_s:6.1f} s  {line}"


_STATE_WORDS = {
    State.STARTING: "starting",
    State.READY: "ready",
    State.BACKOFF: "ended and will be restarted",
    State.STOPPING: "stopping",
    State.EXITED: "ended",
    State.FATAL: "failed",
    State.STOPPED: "not started",
}
# Reasons that are not shown, because the state already implies them.
_PLAIN_REASONS = frozenset({"its needs are ready", "reported ready", "started"})
# Ends of events that repeat facts of the router.
_REPEATED = (": airborne", ": disarmed")
# Change of authority in every flight of a program; the line about OFFBOARD shows it.
_USUAL = ": program has control: "


def transition_text(after: State, reason: str) -> str:
    """Return the text that reports a new state of a process, such as `ready` or `ended (exit 1)`."""
    if reason in _PLAIN_REASONS:
        return _STATE_WORDS[after]
    return f"{_STATE_WORDS[after]}: {reason}" if "(" in reason else f"{_STATE_WORDS[after]} ({reason})"


def transition_level(after: State, *, kind: str, starts: int, ending: bool) -> Level:
    """Return the importance of the line that reports a new state of a process.

    kind: kind of the process.  starts: how often the process was started.  ending: the run ends, so all processes stop.
    """
    if after is State.FATAL:
        return Level.RESULT
    if after in (State.STARTING, State.READY):
        return Level.DETAIL if starts <= 1 else Level.CHANGE
    if ending or (after is State.EXITED and kind == "task"):
        return Level.DETAIL
    return Level.CHANGE


def event_level(text: str) -> Level:
    """Return the importance of the line that reports an event of a process."""
    return Level.DETAIL if text.endswith(_REPEATED) or _USUAL in text else Level.CHANGE


class VehicleChanges:
    """Converter from facts such as `uav1.armed: true` to lines such as `uav1: armed, OFFBOARD`."""

    def __init__(self) -> None:
        self._known: dict[str, dict[str, Any]] = {}

    def on_facts(self, facts: Mapping[str, Any]) -> list[Message]:
        """Return a line for each change of a vehicle: armed, mode, on the ground or in the air, connected.

        facts: state of vehicles that a process has sent in one packet: `<vehicle>.<name>` -> value, such as `uav1.armed` -> True.
        """
        new: dict[str, dict[str, Any]] = {}
        for key, value in facts.items():
            vehicle, _, name = key.rpartition(".")
            if vehicle:
                new.setdefault(vehicle, {})[name] = value
        return [Message(source=v, text=t) for v, values in new.items() for t in self._texts(v, values)]

    def _texts(self, vehicle: str, values: Mapping[str, Any]) -> list[str]:
        before = self._known.get(vehicle, {})
        after = self._known[vehicle] = {**before, **values}
        changed = {name for name in values if before.get(name) != values[name]}
        texts = []
        if "armed" in changed and (after["armed"] or before.get("armed")):
            texts.append(f"armed, {after.get('mode', 'mode unknown')}" if after["armed"] else "disarmed")
        elif "mode" in changed and after.get("armed"):
            texts.append(f"mode {after['mode']}")
        if "landed" in changed and "landed" in before:
            where = "on the ground" if after["landed"] else "in the air"
            texts.append(f"{where} (land detector)")
        if "connected" in changed and "connected" in before:
            texts.append("heartbeat received again" if after["connected"] else "no heartbeat for 3 s")
        return texts


def no_such_process(name: str, plan: Plan) -> str:
    """Return the reply to a request with an unknown process name.

    name: an unknown name, or a part of the arena, such as the router, that shares one process with other parts.
    """
    for spec in plan.processes:
        if any(member.name == name for member in spec.members):
            return f"{name} is a part of the process {spec.name} in this arena. `arena up --processes` gives it a process of its own"
    return f"no process {name!r} in this arena; there are {', '.join(spec.name for spec in plan.processes)}"
