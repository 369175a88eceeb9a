"""Rules that every flight must keep, whatever faults it has. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from benchmarks.chaos_flight.radio import Received

PILOT_GRACE_S = 0.5
"""Time from the first heartbeat in a manual mode until every automatic command must have ended [s]."""
_LANDED = re.compile(r"\b(uav\d): (?:landed and disarmed|already on the ground)")


@dataclass(kw_only=True)
class Observed:
    """Observations of one vehicle.

    armed_at_end: its autopilot was armed when everything of the arena had ended.
    flew: it was armed at any time.
    pilot_since: first heartbeat in a manual mode that the arena received [s]; None without one.
    pilot_until: when the pilot had landed and disarmed the vehicle [s].
    declared: an operator declared the vehicle dead with `arena forget`.
    armed_without_permit: it joined late and was armed before an operator permitted it.
    false_landings: texts of the arena that say landed while the vehicle was armed.
    """

    name: str
    armed_at_end: bool = False
    flew: bool = False
    pilot_since: float | None = None
    pilot_until: float = float("inf")
    declared: bool = False
    armed_without_permit: bool = False
    received: Sequence[Received] = ()
    to_stranger: Sequence[Received] = ()
    false_landings: list[str] = field(default_factory=list)


def landed_names(text: str) -> set[str]:
    """Return the vehicles that a text of arena reports as landed."""
    return set(_LANDED.findall(text))


def violations(vehicles: Iterable[Observed], *, ended: bool = True) -> list[str]:
    """Return one text per violated rule. ended: all processes of the run have ended in time."""
    found = [] if ended else ["the run did not end"]
    for v in vehicles:
        if v.armed_at_end and not v.declared:
            found.append(f"{v.name}: left armed")
        if v.armed_without_permit:
            found.append(f"{v.name}: armed without a permit")
        found += [f"{v.name}: reported as landed while armed: {text}" for text in v.false_landings]
        found += [f"{v.name}: {r.what} from {_sender(r)} to another uid" for r in v.to_stranger]
        since, until = v.pilot_since, v.pilot_until
        late = [
            r
            for r in v.received
            if since is not None and since + PILOT_GRACE_S < r.at < until and r.what != "setpoint"
        ]
        found += [
            f"{v.name}: {r.what} from {_sender(r)} {r.at - (since or 0):.1f} s after the pilot took over"
            for r in late[:3]
        ]
    return found


def _sender(received: Received) -> str:
    return f"{received.sender[0]}/{received.sender[1]}"
