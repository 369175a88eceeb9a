"""List of the events of a run in order of time: takeoffs, landings, failsafes, crashes, faults, restarts. Pure."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from arena.flight_log.flight import Flight
from arena.report.happening import Happening, Kind, Level
from arena.report.landings import Disarming, disarming, flown_times, touchdown_row
from arena.report.link_record import SEVERITIES, StatusText
from arena.report.mode_changes import mode_text, with_causes
from arena.report.run_data import Event, RunData
from arena.report.scenario_steps import scenario_steps

_SILENT_PX4 = re.compile(r": PX4 (has not replied|does not read).*motors stop")
_COMMANDERS = ("pilot", "land-all", "kill-all", "ground station", "operator")
_COPILOT_STEPS = ("hold", "land", "terminate")
_STOPPING = ": landing, then stopping"
_FAULT_OVER = (" again", " no longer ")
_DEAD = ("EXITED", "FATAL", "BACKOFF")
_REPORTED = re.compile(r"failsafe|^\w[\w-]*: (geofence|[a-z]+ battery): ")
_KILLED_S = (
    1.0  # a process that is killed at most so long before or after a step `kill ...` was killed by this step
)
_ENDING, _BACKOFF = "the run ends", "; again in "
_NORMAL_END = re.compile(r"^killed by (SIGTERM|SIGINT) \(the run ends: .*\)$")
KILLED = " was killed by the scenario"
"""Last words of the entry of a process that a step of the scenario has killed."""


def happenings(run: RunData) -> list[Happening]:
    """Return all events of a run in order of time. Events with unknown time are first."""
    starts: Counter[str] = Counter()
    found = [h for event in run.events for h in _of_event(event, run, starts)]
    for name, flight in run.flights.items():
        found += _of_flight(name, flight, flight.t + flight.t0 - run.origin_s, disarming_of(name, run))
    for name, link in run.links.items():
        found += _of_texts(name, link.texts, found)
    found += _of_scenario(run)
    return with_causes(sorted(found, key=lambda h: h.at_s if math.isfinite(h.at_s) else -math.inf), run)


def disarming_of(name: str, run: RunData) -> Disarming | None:
    """Return the last disarming of a vehicle, or None if the vehicle was never armed or is still armed at the end.

    Times are on the report's time axis.
    """
    flight, link = run.flights.get(name), run.links.get(name)
    if flight is None:
        return None
    reported = [e.at_s for e in run.events if e.process == "router" and e.text == f"{name}: disarmed"]
    return disarming(flight, flight.t + flight.t0 - run.origin_s, link.texts if link else (), reported)


def in_air(flight: Flight) -> NDArray[np.bool_]:
    """Return a mask of the log rows in which a vehicle is in the air (n,): from takeoff to touchdown."""
    found = np.zeros(flight.t.size, bool)
    for first, last in flown_times(flight):
        found[first : touchdown_row(flight, first, last) + 1] = True
    return found


def tracked(flight: Flight) -> NDArray[np.bool_]:
    """Return a mask of the log rows in which the tracking error counts (n,): in the air in OFFBOARD.

    All rows in OFFBOARD count if the log has no take-off, such as a log of a part of a flight.
    """
    air = in_air(flight)
    rows: NDArray[np.bool_] = flight.offboard & air if air.any() else flight.offboard
    return rows


def estimated(flight: Flight) -> NDArray[np.bool_]:
    """Return a mask of the log rows in which the estimate error counts (n,): in the air, in any flight mode.

    All rows in which the vehicle is armed count if the log has no take-off.
    """
    air = in_air(flight)
    return air if air.any() else np.asarray(flight.armed, bool)


def together(found: Iterable[Happening], within_s: float) -> list[list[Happening]]:
    """Group events of the same kind whose texts differ only in the vehicle names.

    within_s: an entry belongs to a group if it is at most so long after the previous entry of the group [s].
    Groups are in the order of their first entries.
    """
    groups: list[list[Happening]] = []
    newest: dict[tuple[Kind, str], list[Happening]] = {}
    for h in found:
        key = h.kind, without_names(h)
        group = newest.get(key)
        if group is not None and h.at_s - group[-1].at_s <= within_s:
            group.append(h)
        else:
            newest[key] = [h]
            groups.append(newest[key])
    return groups


def without_names(h: Happening) -> str:
    """Return an event's text with `*` in place of each vehicle name.

    Events with equal results can share a row of the list.
    """
    text = h.text
    for name in sorted(h.vehicles, key=len, reverse=True):
        text = re.sub(rf"(?<![\w-]){re.escape(name)}(?![\w-])", "*", text)
    return text


def _of_flight(name: str, flight: Flight, t: np.ndarray, off: Disarming | None) -> Iterator[Happening]:
    """Yield the events in a vehicle's log: takeoffs, touchdowns, landings, changes of mode and armed flag.

    t: time on the report's axis [s] (n,).  off: last disarming.
    """
    for first, last in flown_times(flight):
        rows = [(first, "took off")]
        if flight.landed[last]:
            rows.append((touchdown_row(flight, first, last), "touched the floor"))
            rows.append((last, "landed (reported by the land detector)"))
        for row, text in rows:
            yield Happening(at_s=float(t[row]), kind="flight", level="good", vehicles=(name,), text=text)
    before: tuple[str, bool] | None = None
    for k, state in enumerate(zip(flight.mode, flight.armed.tolist(), strict=True)):
        if state == before or not state[0]:
            continue
        if before is not None and state[1] != before[1]:
            note = Happening(at_s=float(t[k]), kind="mode", level="note", vehicles=(name,), text="armed")
            yield note if state[1] else replace(note, kind="flight", level="good", text="disarmed")
        if before is not None and state[0] != before[0]:
            text = mode_text(before[0], state[0])
            yield Happening(at_s=float(t[k]), kind="mode", level="note", vehicles=(name,), text=text)
        before = state
    if off is not None and not off.in_log:
        yield Happening(at_s=off.at_s, kind="flight", level="good", vehicles=(name,), text="disarmed")


def _of_event(event: Event, run: RunData, starts: Counter[str]) -> Iterator[Happening]:
    """Yield the entries of the report's event list for one line of events.jsonl.

    starts: process -> number of its starts so far.
    """
    if event.after:
        yield from _of_change(event, run, starts)
    elif event.text and event.process == "copilot":
        h = _happening(event, run, "copilot", "note", event.text)
        ordered = h.text.partition(":")[0] in _COPILOT_STEPS
        yield replace(h, level="warn" if ordered else "note", text=f"copilot: {h.text}")
    elif event.text:
        yield from _of_words(event, run)
    elif event.audit.get("refused"):
        a = event.audit
        text = f"{a.get('request')} requested by {a.get('role')} refused: {a.get('refused')}"
        vehicles = (str(a.get("vehicle")),)
        yield Happening(at_s=event.at_s, kind="refused", level="warn", vehicles=vehicles, text=text)


def _of_change(event: Event, run: RunData, starts: Counter[str]) -> Iterator[Happening]:
    """Yield the entries of the report's event list for a process that has ended or was started again."""
    if event.after == "STARTING":
        starts[event.process] += 1
        if starts[event.process] > 1:
            yield _happening(event, run, "process", "warn", f"{event.process} is started again")
    elif event.after == "READY" and starts[event.process] > 1:
        yield _happening(event, run, "process", "good", f"{event.process} is ready again")
    elif event.after in _DEAD and killed_by_scenario(event, run):
        said = f"injected fault: {event.process}{KILLED}"
        yield _happening(event, run, "fault", "warn", said)
    elif event.after in _DEAD and not event.reason.startswith("exit 0") and _ENDING not in event.reason:
        yield _happening(
            event, run, "process", "bad", f"{event.process} ended: {event.reason.partition(_BACKOFF)[0]}"
        )
    elif event.after in _DEAD:
        said = _NORMAL_END.sub(r"\1 from arena, normal", event.reason)
        yield _happening(event, run, "process", "note", f"{event.process} ended: {said}")


def killed_by_scenario(event: Event, run: RunData) -> bool:
    """Return whether the scenario itself killed a process, for example by `kill program uav1`."""
    if not event.reason.startswith("killed by SIGKILL"):
        return False
    return any(abs(event.at_s - at) <= _KILLED_S for at in _kills(event.process, run))


def _kills(process: str, run: RunData) -> list[float]:
    """Return the times [s] at which steps of the scenario kill a given process.

    process: its name, such as `program.uav1`.
    """
    kind, _, vehicle = process.partition(".")
    found = []
    for step in scenario_steps(run):
        words = step.text.partition("kill ")[2].split()
        named = not vehicle or words[1:2] in (["each"], [vehicle])
        if step.good and words and words[0].startswith(kind) and named:
            found.append(step.at_s)
    return found


def _of_words(event: Event, run: RunData) -> Iterator[Happening]:
    text, lower = event.text, event.text.lower()
    if event.process == "world" and " crashed: " in text:
        vehicle, _, how = text.partition(" crashed: ")
        yield Happening(
            at_s=event.at_s, kind="crash", level="bad", vehicles=(vehicle,), text=f"crashed: {how}"
        )
    elif text.startswith("fault: "):
        over = any(words in text for words in _FAULT_OVER)
        said = f"injected fault: {text.removeprefix('fault: ')}"
        if event.process == "mocap":
            said = re.sub(r"\b(not tracked|tracked again)$", r"\1 by motion capture", said)
        yield _happening(event, run, "fault", "good" if over else "warn", said)
    elif event.process == "router" and (said_by_autopilot := _REPORTED.search(lower)):
        failsafe = said_by_autopilot[0] == "failsafe"
        yield _happening(event, run, "failsafe" if failsafe else "text", "bad" if failsafe else "warn", text)
    elif re.search(rf"\b(pilot has left|({'|'.join(_COMMANDERS)}) has control)", lower):
        yield _happening(event, run, "pilot", "warn", text)
    elif "without a command" in lower:
        yield _happening(event, run, "mode", "warn", text)
    elif " refused: " in lower:
        yield _happening(event, run, "refused", "warn", text)
    elif event.process == "arena":
        yield _of_arena(event, run)
    elif text.endswith((": airborne", ": disarmed")):
        return  # the log of the vehicle contains the time of the row
    else:
        falls = event.process == "world" and _SILENT_PX4.search(text)
        yield _happening(event, run, "process", "bad" if falls else "note", text)


def _of_arena(event: Event, run: RunData) -> Happening:
    """Convert an event that the supervisor reports about the run to an entry of the report's list of events."""
    last_s = max((step.at_s for step in scenario_steps(run)), default=0.0)
    if run.scenario and event.text.endswith(_STOPPING) and event.at_s >= last_s:
        said = "the scenario has ended: the run is stopped"
        return _happening(event, run, "arena", "note", said)
    failed, allowed = event.text.lower().startswith("failed: "), bool(run.scenario.get("passed"))
    parts = [part.rpartition(": ") for part in event.text.removeprefix("failed: ").split("; ")]
    injected = failed and all(how == "killed by SIGKILL" and _kills(who, run) for who, _, how in parts)
    level: Level = "note" if not failed or injected else "warn" if allowed else "bad"
    why = " (allowed by the scenario)" if failed and allowed else " (by the scenario)" if injected else ""
    said = f"arena: {event.text}{why}"
    return _happening(event, run, "arena", level, said)


def _happening(event: Event, run: RunData, kind: Kind, level: Level, text: str) -> Happening:
    """Return the list entry of an event. `text` describes the event; if it begins with `NAME: `, only vehicle NAME is concerned."""
    first, _, about = text.partition(": ")
    if first in run.names:
        return Happening(at_s=event.at_s, kind=kind, level=level, vehicles=(first,), text=about)
    vehicles = _named(f"{event.process} {text}", run.names)
    return Happening(at_s=event.at_s, kind=kind, level=level, vehicles=vehicles, text=text)


def _named(text: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return the vehicle names that occur in a text as whole words."""
    words = set(re.findall(r"[\w-]+", text))
    return tuple(name for name in names if name in words)


def _of_texts(name: str, texts: Sequence[StatusText], found: Sequence[Happening]) -> Iterator[Happening]:
    """Yield the STATUSTEXT messages of a vehicle that the router has not already reported as events."""
    known = {h.text for h in found if name in h.vehicles}
    for given in texts:
        if given.text in known:
            continue
        level: Level = "bad" if given.severity <= 2 else "warn" if given.severity <= 4 else "note"
        kind: Kind = "failsafe" if "failsafe" in given.text.lower() and given.severity <= 4 else "text"
        said = f"{SEVERITIES[given.severity] if given.severity < 8 else given.severity}: {given.text}"
        yield Happening(at_s=given.at_s, kind=kind, level=level, vehicles=(name,), text=said)


def _of_scenario(run: RunData) -> Iterator[Happening]:
    for step in scenario_steps(run):
        word = "" if step.good else "FAILED: "
        yield Happening(
            at_s=step.at_s,
            kind="step",
            level="good" if step.good else "bad",
            vehicles=(),
            text=f"scenario step {step.number}: {word}{step.words}",
        )
