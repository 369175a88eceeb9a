"""Cases of the MAVLink event protocol: the numbers of the events, requests of old events, and the events of a flight."""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterable
from typing import NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.events import TYPES
from arena.wire.mavlink_frame import pack_frame
from arena.wire.px4_messages import CURRENT_EVENT_SEQUENCE, EVENT, REQUEST_EVENT, RESPONSE_EVENT_ERROR
from px4_contract.flying import come_down, hover
from px4_contract.registry import case
from px4_contract.rig import Received, Rig
from px4_contract.transcript import Transcript

_REQUEST_SEED = bytes([33])
_NUMBERS = 1 << 16
_NAMES = {kind.id: name for name, kind in TYPES.items()}


class _Event(NamedTuple):
    """Received event, and the bytes of its message."""

    id: int
    sequence: int
    levels: int
    arguments: bytes
    raw: bytes


def received_events(messages: Iterable[Received]) -> list[_Event]:
    """Return the events among received messages, in order."""
    found = []
    for h in messages:
        if h.msgid == EVENT:
            number, _, sequence, _, _, levels, arguments = struct.unpack(
                "<2IH3B40s", bytes(h.m).ljust(53, b"\0")
            )
            found.append(_Event(number, sequence, levels, arguments, bytes(h.m)))
    return found


def newest_number(r: Rig) -> int | None:
    """Return the number of the newest CURRENT_EVENT_SEQUENCE on the router link."""
    found = [bytes(h.m).ljust(3, b"\0") for h in r.received if h.msgid == CURRENT_EVENT_SEQUENCE]
    return int(struct.unpack("<HB", found[-1])[0]) if found else None


def ask(r: Rig, first: int, last: int, to: tuple[int, int]) -> None:
    """Request events, and run until the replies have arrived."""
    r.clear()
    voice = r.links["router"].voice
    request = struct.pack("<2H2B", first % _NUMBERS, last % _NUMBERS, *to)
    data = pack_frame(REQUEST_EVENT, request, voice, _REQUEST_SEED)
    voice.seq = (voice.seq + 1) % 256
    r.links["router"].socket.sendto(data, r.links["router"].remote)
    r.run(0.6)


def errors(r: Rig) -> list[tuple[int, int, int, int, int]]:
    """Return each RESPONSE_EVENT_ERROR: number, oldest number, system, component, reason."""
    raw = [bytes(h.m).ljust(7, b"\0")[:7] for h in r.received if h.msgid == RESPONSE_EVENT_ERROR]
    return [struct.unpack("<2H3B", data) for data in raw]


def reply(r: Rig, first: int, to: tuple[int, int]) -> str:
    """Request one event. Return what the autopilot replies."""
    ask(r, first, first, to)
    if not errors(r):
        return "event" if received_events(r.received) else "silence"
    number, _, system, component, reason = errors(r)[0]
    return f"error {reason} for the sequence {number == first} to {system == r.id} {component}"


@case("events", "CURRENT_EVENT_SEQUENCE, and REQUEST_EVENT for an event that does not exist")
def events(r: Rig, t: Transcript) -> None:
    r.clear()
    r.run(7.0)
    t.note("CURRENT_EVENT_SEQUENCE comes", newest_number(r) is not None)
    t.note("unavailable", reply(r, 30000, (r.id, 1)))
    t.note("for another vehicle", reply(r, 30000, (7, 1)))


def note_events(t: Transcript, key: str, found: Iterable[_Event]) -> None:
    """Record name, log levels and arguments of the events that both autopilots can send."""
    for event in found:
        if name := _NAMES.get(event.id):
            arguments = event.arguments.rstrip(b"\0").hex()
            t.note(f"{key}: {name}", f"levels {event.levels:#04x} {arguments}".strip())


@case("events of arming", "EVENT on arming and disarming: numbers, levels, arguments, and on which links")
def events_of_arming(r: Rig, t: Transcript) -> None:
    r.station = True
    r.run(1.2)
    for key, done in (("arm", r.arm), ("disarm", r.disarm)):
        r.clear()
        done()
        r.run(4.0)
        note_events(t, key, received_events(r.received))
        numbers = [event.sequence for event in received_events(r.received)]
        steps = {(b - a) % _NUMBERS for a, b in itertools.pairwise(numbers)}
        t.note(f"{key}: numbers are consecutive", steps <= {1})
        t.note(f"{key}: CURRENT_EVENT_SEQUENCE has the last number", newest_number(r) == numbers[-1])
        t.note(
            f"{key}: the same on the ground station link",
            [e.raw for e in received_events(r.on_ground_link)]
            == [e.raw for e in received_events(r.received)],
        )
    r.station = False


@case("events requested again", "REQUEST_EVENT for kept events, for a range, and for events that are too old")
def events_requested(r: Rig, t: Transcript) -> None:
    r.clear()
    r.arm()
    r.disarm()
    r.run(4.0)
    sent, newest = received_events(r.received), newest_number(r)
    if len(sent) < 2 or newest is None:
        t.note("two events", False)
        return
    ask(r, sent[-1].sequence, sent[-1].sequence, (r.id, 1))
    t.note("the last one again", [e.raw for e in received_events(r.received)] == [sent[-1].raw])
    ask(r, sent[-2].sequence, sent[-1].sequence, (r.id, 1))
    t.note("the last two again", [e.raw for e in received_events(r.received)] == [e.raw for e in sent[-2:]])
    old = (newest - 100) % _NUMBERS
    ask(r, old, old, (r.id, 1))
    found = errors(r)
    t.note("too old: errors", len(found))
    if found:
        t.note("too old: number", (found[0][0] - old) % _NUMBERS)
        ask(r, found[0][1], found[0][1], (r.id, 1))
        t.note("too old: the oldest one is sent", len(received_events(r.received)))
    ask(r, old, old + 2, (r.id, 1))
    t.note("three too old: errors", len(errors(r)))
    ask(r, newest + 50, newest + 50, (r.id, 1))  # PX4 sends events of its own in between
    t.note("not sent yet: errors", len(errors(r)))


@case(
    "events in the air",
    "EVENT on take-off, landing, a refused change of mode and a refused disarming",
    ground=False,
)
def events_in_the_air(r: Rig, t: Transcript) -> None:
    r.clear()
    hover(r)
    note_events(t, "take-off", received_events(r.received))
    for key, done in (("mission without items", lambda: r.set_mode(4, 4)), ("disarm", r.disarm)):
        r.clear()
        done()
        r.run(1.0)
        note_events(t, key, received_events(r.received))
    r.clear()
    come_down(r)
    note_events(t, "landing", received_events(r.received))


def _logging(r: Rig) -> str:
    m = r.state["SYS_STATUS"]
    values = {
        "present": m.onboard_control_sensors_present,
        "enabled": m.onboard_control_sensors_enabled,
        "healthy": m.onboard_control_sensors_health,
    }
    return " ".join(word for word, value in values.items() if value & mavlink.MAV_SYS_STATUS_LOGGING)


@case("SYS_STATUS, logging", "MAV_SYS_STATUS_LOGGING while armed, and ten seconds after disarming")
def logging_bit(r: Rig, t: Transcript) -> None:
    r.arm()
    r.run(4.0)
    t.note("armed", _logging(r))
    r.disarm()
    r.run(10.0)
    t.note("disarmed", _logging(r))
