"""Verdict on a run in one sentence: flights, their ends, and the causes of problems. Pure."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from arena.errors import EXIT_INTERRUPTED, EXIT_OK
from arena.report.fates import Fate, fate_of
from arena.report.happening import Happening, Level
from arena.report.happenings import KILLED, together
from arena.report.link_record import SEVERITIES
from arena.report.mode_changes import COMMANDED, new_mode
from arena.report.run_data import EVENTS_FILE, INCOMPLETE, RunData
from arena.report.summary import SLOW_FACTOR
from arena.wire.flight_record import FILE_NAME

_MOST_NAMES = 4
_MOST_CLAUSES = 7
_SAME_TIME_S = 0.5
_TOGETHER_S = 2.0  # entries with the same text within this time are one clause for all their vehicles
_EFFECT_S = (
    15.0  # a failsafe counts as the effect of a fault of the same vehicle that began at most so long before
)
_ACTION_S = (
    2.0  # a change of mode counts as the action of a failsafe that was reported at most so long before
)
_SEVERITY = re.compile(rf"^({'|'.join(SEVERITIES)}): ")
_WARNED_S = 1.0  # longest time from a warning of the autopilot to the failsafe that it explains
_BATTERY_ACTIONS = {0: "warning only", 2: "land", 3: "return to the start, then land"}
"""Values of PX4's COM_LOW_BAT_ACT. The action is taken below BAT_CRIT_THR; below BAT_LOW_THR PX4 only warns."""
_RECORDS = (EVENTS_FILE, FILE_NAME)
_WORDS: Mapping[Level, str] = {"good": "as planned", "warn": "look closer", "bad": "failed"}
_LAST_LINE = "last line of its log: "
_MOST_CHARACTERS = 140


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Verdict on a run: its level (good, warn or bad), and the clauses of its sentence.

    level: "good", "warn" (something needs attention) or "bad" (crash or failure).
    word: the level as shown on the page.  fates: who flew, and how it ended.  causes: what happened on the way, in order of time.
    """

    level: Level
    fates: tuple[str, ...]
    causes: tuple[str, ...]

    word: str

    @property
    def text(self) -> str:
        """Whole verdict as one sentence."""
        return "; ".join((*self.fates, *self.causes)) + "."


def verdict(run: RunData, found: Sequence[Happening]) -> Verdict:
    """Return the verdict on a run, from its data and its events.

    found: what happened (see `arena.report.happenings`).
    """
    fates = {name: fate_of(name, run, found) for name in run.names}
    causes = [*_causes(run, found), *_run_end(run), *_missing_record(run)]
    attention = bool(causes)
    causes += _commanded_landings(run, found)
    if len(causes) > _MOST_CLAUSES:
        causes = [
            *causes[: _MOST_CLAUSES - 1],
            f"{len(causes) - _MOST_CLAUSES + 1} more events are listed below",
        ]
    interrupted = run.outcome.get("exit_code") == EXIT_INTERRUPTED and not run.outcome.get("failed")
    ended_well = interrupted or run.outcome.get("exit_code") == EXIT_OK
    bad = any(f.level == "bad" for f in fates.values()) or not ended_well
    warn = attention or any(f.level == "warn" for f in fates.values())
    if passed := (run.scenario.get("verdict") and run.scenario.get("passed")):
        bad = False  # the scenario expects its faults and the failures of the programs
    texts = tuple(_fate_clauses(fates))
    if run.scenario:
        texts = (
            f"Scenario “{run.scenario.get('scenario')}” {'passed' if passed else 'FAILED'}: "
            + "; ".join(texts),
        )
    if run.replay_of:
        texts = (f"Replay of {_source(run.replay_of)}: " + "; ".join(texts),)
    level: Level = "bad" if bad else "good" if passed or not warn else "warn"
    word = "scenario passed" if passed else _WORDS[level]
    return Verdict(level=level, fates=texts, causes=tuple(causes), word=word)


def _source(path: str) -> str:
    """Return a name for the flight that a replay shows: its run folder (flight.mcap) or its log file."""
    source = Path(path)
    return f"the flight {source.parent.name}" if source.name == FILE_NAME else source.name


def _fate_clauses(fates: Mapping[str, Fate]) -> Iterator[str]:
    """Yield one clause per group of vehicles whose flights ended alike: `uav1 and uav2 flew 28 s and landed`."""
    groups: dict[str, list[str]] = {}
    for name, fate in fates.items():
        groups.setdefault(fate.end, []).append(name)
    for end, names in groups.items():
        flown = [fates[name].flown_s for name in names if fates[name].flown_s > 0.0]
        who = _who(names, len(fates))
        verb = end.replace("was ", "were ", 1) if len(names) > 1 else end
        if not flown:
            yield f"{who} {verb}"
        elif max(flown) - min(flown) < 1.0:
            yield f"{who} flew {max(flown):.0f} s and {verb}"
        else:
            yield f"{who} flew and {verb} (time in the air: {min(flown):.0f} s to {max(flown):.0f} s)"


def _who(names: Sequence[str], total: int) -> str:
    if len(names) <= _MOST_NAMES:
        return join_names(names)
    return f"all {total} vehicles" if len(names) == total else f"{len(names)} of {total} vehicles"


def join_names(names: Sequence[str]) -> str:
    """Join names to a text: `uav1`, `uav1 and uav2`, `uav1, uav2 and uav3`."""
    return (
        names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}" if names else "no vehicle"
    )


def _causes(run: RunData, found: Sequence[Happening]) -> Iterator[str]:
    """Yield one clause per cause of a problem: fault with its failsafes, pilot, copilot, failed process."""
    causes = [
        h for h in found if h.kind in ("fault", "failsafe", "pilot", "copilot") and h.level in ("warn", "bad")
    ]
    causes += [
        h
        for h in found
        if h.kind == "process" and h.level in ("bad", "warn") and "started again" not in h.text
    ]
    used: set[int] = set()
    for group in together(sorted(causes, key=lambda h: h.at_s), _TOGETHER_S):
        if id(group[0]) in used:
            continue
        yield _clause(group, run, found, used)


def _commanded_landings(run: RunData, found: Sequence[Happening]) -> Iterator[str]:
    """Yield one clause per group of commanded landings: `at 14.5 s program.uav1 commanded AUTO.LAND`."""
    landings = [h for h in found if new_mode(h) == "AUTO.LAND" and COMMANDED in h.text]
    for group in together(landings, _TOGETHER_S):
        senders = sorted({h.text.partition(COMMANDED)[2] for h in group})
        names = sorted({v for h in group for v in h.vehicles}, key=list(run.names).index)
        programs = len(names) > 1 and senders == sorted(f"program.{name}" for name in names)
        who = f"the programs of {_who(names, len(run.names))}" if programs else join_names(senders)
        yield f"{_when(group)} {who} commanded AUTO.LAND{_charge(group, run, found)}"


def _charge(group: Sequence[Happening], run: RunData, found: Sequence[Happening]) -> str:
    """Return a text about the battery charge at which a landing was commanded, if a fault drained the battery.

    Return "" unless a fault has drained a battery and no failsafe has acted.
    """
    names = {name for h in group for name in h.vehicles}
    drained = any(x.kind == "fault" and "battery" in x.text and set(x.vehicles) & names for x in found)
    if not drained or any(x.kind == "failsafe" and set(x.vehicles) & names for x in found):
        return ""
    charges = [c for h in group if math.isfinite(c := _charge_at(h, run))]
    limits = {run.params(name).get("BAT_LOW_THR") for name in names}
    if not charges or len(limits) != 1 or None in limits:
        return ""
    lowest = "lowest battery" if len(names) > 1 else "battery"
    warning = (
        f"{lowest} {min(charges):.0f} %, warning at {100.0 * float(limits.pop() or 0.0):g} % (BAT_LOW_THR)"
    )
    return f": {warning}; {_battery_action(run.params(min(names)))}"


def _battery_action(params: Mapping[str, Any]) -> str:
    """Return the configured action of an autopilot at low battery, as text.

    params: its parameters.
    """
    action, critical = params.get("COM_LOW_BAT_ACT"), params.get("BAT_CRIT_THR")
    if action is None:
        return "no failsafe acted"
    words = _BATTERY_ACTIONS.get(int(action), "unknown action")
    at = (
        ""
        if int(action) == 0 or critical is None
        else f" only at {100.0 * float(critical):g} % (BAT_CRIT_THR)"
    )
    return f"configured low battery action: {words}{at}, COM_LOW_BAT_ACT {int(action)}"


def _charge_at(h: Happening, run: RunData) -> float:
    """Return a vehicle's battery charge at the time of an event [%], or NaN if unknown."""
    flight = run.flights[h.vehicles[0]]
    charge = flight.numbers.get("info.battery")
    row = min(int(np.searchsorted(flight.t + flight.t0 - run.origin_s, h.at_s)), flight.t.size - 1)
    return math.nan if charge is None else float(charge[row])


def _clause(group: Sequence[Happening], run: RunData, found: Sequence[Happening], used: set[int]) -> str:
    first, names = group[0], sorted({v for h in group for v in h.vehicles}, key=list(run.names).index)
    who = _who(names, len(run.names)) if names else ""
    if first.kind == "fault":
        text = f"at {first.at_s:.1f} s {_fault_words(first, names, who)}{_duration(first, found)}"
        effects = [h for h in found if h.kind == "failsafe" and set(h.vehicles) & set(names)]
        effects = [h for h in effects if 0.0 <= h.at_s - first.at_s <= _EFFECT_S and id(h) not in used]
        if effects:
            used |= {id(h) for h in effects}
            after = effects[0].at_s - first.at_s
            hit = sorted({v for h in effects for v in h.vehicles}, key=list(run.names).index)
            text += f", and {_failsafe_words(effects[0], _who(hit, len(run.names)), hit == names, found)} {after:.1f} s later"
        return text
    if first.kind == "failsafe":
        return f"{_when(group)} {_failsafe_words(first, who, False, found)}"
    if first.kind == "process":
        again = [
            h
            for h in found
            if h.kind == "process" and h.at_s >= first.at_s and h.text.endswith(" is started again")
        ]
        processes = [h.text.partition(" ")[0] for h in group]
        many = len(processes) > 1
        subject = (
            join_names(processes)
            if len(processes) <= _MOST_NAMES
            else f"{len(processes)} processes such as {processes[0]}"
        )
        back = any(h.text.startswith(f"{processes[0]} ") for h in again)
        how = first.text.partition(" ended: ")[2]
        restarted = (" and were started again" if many else " and was started again") if back else ""
        verb = ("were " if many else "was ") if how.startswith("killed") else "ended with "
        return f"{subject} {verb}{how} {_when(group)}{_last_words(processes[0], run)}{restarted}"
    if first.kind == "copilot":
        step, _, why = first.text.removeprefix("copilot: ").partition(": ")
        return f"at {first.at_s:.1f} s the copilot commanded {who} to {step} ({why})"
    text = first.text if not who or who in first.text else f"{who}: {first.text}"
    return f"at {first.at_s:.1f} s {text}"


def _when(group: Sequence[Happening]) -> str:
    """Return when a group of events happened, such as `at 3.0 s` or `from 3.0 to 4.5 s`."""
    first_s, last_s = group[0].at_s, group[-1].at_s
    return (
        f"at {first_s:.1f} s" if last_s - first_s < _SAME_TIME_S else f"from {first_s:.1f} to {last_s:.1f} s"
    )


def _last_words(process: str, run: RunData) -> str:
    """Return the exception that ended a program, in parentheses, or "" if its log shows no exception."""
    lines = [e.text for e in run.events if e.process == process and e.text.startswith(_LAST_LINE)]
    error = re.search(r"(?:\w+\.)*(\w+(?:Error|Exception|Interrupt)\b[^(\n]*)", lines[-1]) if lines else None
    return f" ({_first_sentence(error[1])})" if error else ""


def _first_sentence(text: str) -> str:
    """Return the first sentence of a text without its full stop, cut to `_MOST_CHARACTERS` characters."""
    sentence = text.partition(". ")[0].strip().rstrip(":.")
    return (
        sentence
        if len(sentence) <= _MOST_CHARACTERS
        else f"{sentence[: _MOST_CHARACTERS - 1].rpartition(' ')[0]} …"
    )


def _fault_words(first: Happening, names: Sequence[str], who: str) -> str:
    """Return the clause about an injected fault that concerns one or several vehicles.

    first: its first entry.
    names, who: its vehicles, and their names as text.
    """
    plain = first.text.removeprefix("injected fault: ")
    if plain.endswith("is not tracked by motion capture"):
        return f"{who} lost {'its' if ',' not in who and ' and ' not in who else 'their'} motion capture (injected fault)"
    if len(names) > 1 and plain.endswith(KILLED):
        return f"the programs of {who} were{KILLED.removeprefix(' was')} (injected fault)"
    if len(names) > 1 and len(first.vehicles) == 1:
        plain = re.sub(rf"(?<![\w.-]){re.escape(first.vehicles[0])}(?![\w-])", who, plain)
    return f"{_past(plain)} (injected fault)"


def _past(text: str) -> str:
    """Change the text of a fault to the past tense, to match the other sentences of the verdict."""
    for present, past in (("is", "was"), ("are", "were"), ("gives", "gave"), ("lose", "lost")):
        text = re.sub(rf"\b{present}\b", past, text)
    return text


def _duration(first: Happening, found: Sequence[Happening]) -> str:
    """Return the duration of a motion capture fault as text, or "" if the fault did not end."""
    over = first.text.replace("is not tracked", "is tracked again").replace(
        " is frozen", " is no longer frozen"
    )
    ends = [
        h.at_s for h in found if h.kind == "fault" and h.text == over != first.text and h.at_s > first.at_s
    ]
    return f" for {ends[0] - first.at_s:.1f} s" if ends else ""


def _failsafe_words(first: Happening, who: str, same: bool, found: Sequence[Happening]) -> str:
    """Return the text of a failsafe: `the failsafe of uav2 switched to AUTO.LAND (external vision lost)`."""
    changed = [h for h in found if new_mode(h) and set(h.vehicles) & set(first.vehicles)]
    changed = [h for h in changed if -_SAME_TIME_S <= h.at_s - first.at_s <= _ACTION_S]
    why = re.sub(r"^\w+: ", "", first.text).removeprefix("Failsafe activated: ")
    why = _warning(first, why.partition(" ")[0].rstrip(":").lower(), found) or why
    if changed:
        why = why.removesuffix(f": {new_mode(changed[0])}")
    several = " and " in who or "vehicles" in who
    whose = ("their failsafes" if several else "its failsafe") if same else f"the failsafe of {who}"
    acted = f"switched to {new_mode(changed[0])}" if changed else "acted"
    return f"{whose} {acted} ({why})"


def _warning(first: Happening, cause: str, found: Sequence[Happening]) -> str:
    """Return the autopilot's warning that explains a failsafe, such as a geofence breach. Return "" if there is none.

    cause: first word of the failsafe's cause, which the warning contains.
    """
    texts = [
        _SEVERITY.sub("", h.text)
        for h in found
        if h.kind == "text" and h.level != "note" and set(h.vehicles) & set(first.vehicles)
        if -_WARNED_S <= h.at_s - first.at_s <= 0.0
    ]
    return next((text for text in reversed(texts) if cause and cause in text.lower()), "")


def _run_end(run: RunData) -> Iterator[str]:
    """Yield clauses about the end of the run, unless it ended normally."""
    if run.outcome.get("exit_code") is None:
        yield "the run has no outcome: the supervisor was killed, or could not write it"
        return
    if run.outcome.get("cause") != "done" and not run.scenario:
        yield f"the run ended: {run.outcome.get('reason') or run.outcome.get('cause')}"
    yield from slow_words(run.outcome)


def _missing_record(run: RunData) -> Iterator[str]:
    """Yield a clause if flight.mcap or events.jsonl cannot be read or lacks data.

    Failsafes may then be missing in the list of events.
    """
    for why in run.missing:
        if why.startswith(_RECORDS):
            yield why if why.startswith(INCOMPLETE) else f"not read: {why}"


def slow_words(outcome: Mapping[str, Any]) -> Iterator[str]:
    """Yield a clause if the simulation was slower than requested."""
    factor, asked = ((outcome.get("real_time") or {}).get(key) for key in ("factor", "asked"))
    if factor is not None and asked is not None and factor < SLOW_FACTOR * asked:
        yield f"the simulation was slower than requested ({factor:.2f} instead of {asked:g} simulated seconds per second)"
